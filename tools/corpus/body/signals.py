"""Curves in time at 30 fps: moves, bumps, noise, sway, hand channels, and calm while listening."""

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d

from conventions.rates import FPS
from model.motion.two_bone_ik import minimum_jerk
from tools.corpus.gesture.gestures import SHAPE_SIZE
from tools.corpus.words.prosody import Utterance


def bump(phase: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """Return 0 outside phases 0 to 1 and 1 at phase .5, with a continuous first derivative."""
    x = np.clip(phase, 0.0, 1.0)
    return 16.0 * x**2 * (1.0 - x) ** 2


def gaussian_bump(
    time_s: Float[np.ndarray, " T"], centre_s: float, width_s: float
) -> Float[np.ndarray, " T"]:
    """Return a Gaussian of standard deviation ``width_s`` that is 1 at ``centre_s``."""
    return np.exp(-0.5 * ((time_s - centre_s) / width_s) ** 2)


def frame_times(num_frames: int) -> Float[np.ndarray, " T"]:
    return np.arange(num_frames) / FPS


def low_pass(signal: Float[np.ndarray, "*shape"], width_s: float) -> Float[np.ndarray, "*shape"]:
    """Smooth along the first axis (time) with a Gaussian of standard deviation ``width_s``."""
    return gaussian_filter1d(signal, width_s * FPS, axis=0)


def smooth_noise(
    rng: np.random.Generator, num_frames: int, sd: float, scale_s: float, channels: int
) -> Float[np.ndarray, "T C"]:
    """Draw Gaussian noise of standard deviation ``sd``, smooth over ``scale_s`` seconds."""
    width = max(scale_s * FPS, 0.5)
    pad = int(4 * width) + 4
    white = rng.normal(size=(num_frames + 2 * pad, channels))
    smooth = gaussian_filter1d(white, width, axis=0)[pad : pad + num_frames]
    return smooth * sd * np.sqrt(2.0 * np.sqrt(np.pi) * width)


def smooth_line(
    rng: np.random.Generator, num_frames: int, sd: float, scale_s: float
) -> Float[np.ndarray, " T"]:
    """Draw one channel of ``smooth_noise``."""
    return smooth_noise(rng, num_frames, sd, scale_s, 1)[:, 0]


def sway(
    rng: np.random.Generator, num_frames: int, sd: float, channels: int
) -> Float[np.ndarray, "T C"]:
    """Draw postural sway: a sum of noises with a spectrum of about 1/f from .05 to 1 Hz."""
    bands = ((3.2, 0.8), (1.4, 0.5), (0.6, 0.28), (0.25, 0.10))
    parts = [smooth_noise(rng, num_frames, sd * share, scale, channels) for scale, share in bands]
    return np.sum(parts, axis=0)


def sway_line(rng: np.random.Generator, num_frames: int, sd: float) -> Float[np.ndarray, " T"]:
    """Draw one channel of ``sway``."""
    return sway(rng, num_frames, sd, 1)[:, 0]


POSITION = slice(0, 3)  # metres, chest frame, x to the body's left
PRONATION, WRIST_FLEX, DEVIATION, ELBOW_OUT = 3, 4, 5, 6  # degrees, degrees, degrees, no unit
FINGERS = slice(7, 7 + SHAPE_SIZE)
NUM_CHANNELS = 7 + SHAPE_SIZE


OFFSET_RAMP_S = (0.2, 1.1)  # start and end of settling after the last word
ONSET_RAMP_S = (0.6, 0.0)  # start and end of waking before the next word


def listening_envelope(
    utterance: Utterance, time_s: Float[np.ndarray, " T"]
) -> Float[np.ndarray, " T"]:
    """Return the calmness (0 to 1): it rises after listening begins and falls before speech."""
    level = np.zeros(len(time_s))
    for span in utterance.listening:
        rise, fall = np.ones(len(time_s)), np.zeros(len(time_s))
        if span.start_s > 0:
            begin, end = OFFSET_RAMP_S
            rise = minimum_jerk((time_s - span.start_s - begin) / (end - begin))
        if span.end_s < utterance.duration_s:
            begin, end = ONSET_RAMP_S
            fall = minimum_jerk((time_s - span.end_s + begin) / (begin - end))
        level += rise - fall
    return np.clip(level, 0.0, 1.0)
