"""Trunk, head and gaze: what they do while the hands gesture."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from model.corpus.body.signals import (
    frame_times,
    gaussian_bump,
    low_pass,
    minimum_jerk,
    smooth_line,
    sway_line,
)
from model.corpus.people.rig import JOINT, euler_matrices
from model.corpus.people.speakers import Speaker
from model.corpus.words.prosody import Utterance

PELVIS_TILT_DEG = -11.0
TREMOR_DEG = 0.06  # of the trunk; even calm people are never perfectly smooth
SPINE = ((3, 0.30, 7.0), (6, 0.35, 4.0), (9, 0.35, 4.0))  # joint, share of the turn, posture in deg


@dataclass(frozen=True)
class Trunk:
    """Pelvis, spine, neck, head and eye rotations, and what legs and face need to know of them."""

    rotations: dict[int, Float[np.ndarray, "T 3 3"]]
    accent: Float[np.ndarray, " T"]
    eyes_deg: Float[np.ndarray, "T 2"]
    """Pitch (down positive) and yaw of the eyes in the head."""
    gaze_shifts: tuple[tuple[float, float], ...]
    """Time and size in degrees of every saccade."""
    breath: Float[np.ndarray, " T"]


def move_trunk(
    utterance: Utterance,
    hands: dict[str, Float[np.ndarray, "T C"]],
    speaker: Speaker,
    rng: np.random.Generator,
) -> Trunk:
    """The trunk follows hands and accents, the head follows the gaze; all of it sways."""
    num_frames = len(hands["left"])
    time_s = frame_times(num_frames)
    left, right = hands["left"][:, :3], hands["right"][:, :3]
    lively, swaying = speaker.energy, speaker.sway
    accents = _accents(utterance, time_s, lively, rng)
    lead = low_pass(right[:, 2] - left[:, 2] + 0.5 * (right[:, 1] - left[:, 1]), 0.1)
    aside = low_pass(left[:, 0] + right[:, 0], 0.12)
    raised = low_pass(np.maximum(left[:, 1], 0) + np.maximum(right[:, 1], 0), 0.2)
    breath = _breath(utterance, time_s, rng)

    pelvis_yaw = sway_line(rng, num_frames, 4.5 * swaying) + 0.7 * accents.yaw
    yaw = 0.2 * pelvis_yaw + 28 * lead + accents.yaw
    yaw += sway_line(rng, num_frames, 2.8 * swaying) + smooth_line(
        rng, num_frames, 2.6 * swaying, 0.2
    )
    pitch = 2.8 * lively * accents.level - 17 * raised
    pitch += sway_line(rng, num_frames, 2.8 * swaying) + smooth_line(
        rng, num_frames, 2.6 * swaying, 0.2
    )
    roll = 15 * aside + accents.roll
    roll += sway_line(rng, num_frames, 2.8 * swaying) + smooth_line(
        rng, num_frames, 2.4 * swaying, 0.2
    )

    yaw, pitch, roll = (
        turn + smooth_line(rng, num_frames, TREMOR_DEG, 0.05) for turn in (yaw, pitch, roll)
    )

    gaze, shifts = _gaze(utterance, time_s, rng)
    head_gaze = low_pass(gaze, 0.11)
    tilt, look = _phrase_attitudes(utterance, time_s, rng)
    chest_yaw = pelvis_yaw + yaw

    def restless(fast: float) -> np.ndarray:
        calm = smooth_line(rng, num_frames, 2.1, 0.9) + smooth_line(rng, num_frames, 0.13, 0.035)
        return calm + smooth_line(rng, num_frames, fast, 0.18)

    head_yaw = -0.62 * chest_yaw + 0.55 * head_gaze[:, 0] + look + accents.tilt
    head_yaw += restless(2.8) - 0.3 * accents.yaw
    head_pitch = -0.5 * pitch + 0.5 * head_gaze[:, 1] + 1.25 * accents.nod + 1.0 + restless(2.5)
    head_roll = -0.45 * roll + tilt + restless(2.5) - 0.12 * head_yaw

    lean = speaker.lean_deg
    pelvis_pitch = PELVIS_TILT_DEG + 0.3 * lean + sway_line(rng, num_frames, 0.9 * swaying)
    pelvis_roll = sway_line(rng, num_frames, 1.5 * swaying)
    rotations = {0: _euler(pelvis_yaw, pelvis_pitch, pelvis_roll)}
    for joint, share, posture in SPINE:
        breathing = 0.9 * breath if joint == JOINT["spine3"] else 0.0
        bent = posture + share * (pitch + 0.3 * lean) + breathing
        rotations[joint] = _euler(share * yaw, bent, share * roll)
    rotations[JOINT["neck"]] = _euler(0.5 * head_yaw, 5 + 0.45 * head_pitch, 0.45 * head_roll)
    rotations[JOINT["head"]] = _euler(0.5 * head_yaw, -6 + 0.55 * head_pitch, 0.55 * head_roll)
    eye_pitch = gaze[:, 1] - 0.5 * head_gaze[:, 1] - 0.3 * accents.nod
    drift = head_yaw + chest_yaw - 0.55 * head_gaze[:, 0]
    eye_yaw = gaze[:, 0] - 0.55 * head_gaze[:, 0] - 0.25 * drift
    eyes = np.stack([np.clip(eye_pitch, -18, 15), np.clip(eye_yaw, -22, 22)], axis=1)
    for joint in (JOINT["left_eye"], JOINT["right_eye"]):
        rotations[joint] = euler_matrices("YX", eyes[:, ::-1])
    return Trunk(rotations, accents.level, eyes, tuple(shifts), breath)


@dataclass(frozen=True)
class _Accents:
    level: Float[np.ndarray, " T"]
    nod: Float[np.ndarray, " T"]
    yaw: Float[np.ndarray, " T"]
    roll: Float[np.ndarray, " T"]
    tilt: Float[np.ndarray, " T"]


def _accents(
    utterance: Utterance, time_s: Float[np.ndarray, " T"], lively: float, rng: np.random.Generator
) -> _Accents:
    """What head and trunk do on stressed words: nods, small turns that decay, tilts."""
    level, nod, yaw, roll, tilt = (np.zeros(len(time_s)) for _ in range(5))
    for word in utterance.words:
        strength = word.accent
        if strength <= 0:
            continue
        since = time_s - word.beat_s
        level += strength * gaussian_bump(since, 0.03, 0.16)
        turn, lean = rng.normal(0, 3.0 * strength * lively, 2)
        rise = minimum_jerk((since + 0.28) / rng.uniform(0.33, 0.5))
        decay = np.exp(-np.maximum(since, 0) / rng.uniform(0.3, 0.9))
        yaw += turn * rise * decay
        roll += 0.7 * lean * rise * decay
        if rng.random() < 0.75:
            depth = strength * rng.uniform(2.0, 6.0) * lively
            width = rng.uniform(0.08, 0.12)
            nod += depth * gaussian_bump(since, 0.05, width)
            nod -= 0.45 * depth * gaussian_bump(since, -0.18, 1.1 * width)
            nod -= 0.20 * depth * gaussian_bump(since, 0.32, 0.14)
        tilt += rng.normal(0, 1.6) * strength * lively * gaussian_bump(since, 0.1, 0.25)
    return _Accents(level, nod, yaw, roll, tilt)


def _phrase_attitudes(
    utterance: Utterance, time_s: Float[np.ndarray, " T"], rng: np.random.Generator
) -> tuple[Float[np.ndarray, " T"], Float[np.ndarray, " T"]]:
    """A head tilt and a sideways look held for each phrase, in degrees."""
    tilt, look = np.zeros(len(time_s)), np.zeros(len(time_s))
    for phrase in utterance.phrases:
        hold = minimum_jerk((time_s - phrase.start_s + 0.3) / 0.6)
        hold -= minimum_jerk((time_s - phrase.end_s - 0.1) / 0.7)
        tilt += rng.normal(0, 2.4) * hold
        look += rng.normal(0, 3.0) * hold
    return tilt, look


def _gaze(
    utterance: Utterance, time_s: Float[np.ndarray, " T"], rng: np.random.Generator
) -> tuple[Float[np.ndarray, "T 2"], list[tuple[float, float]]]:
    """Yaw and pitch of fixations in degrees: at the listener, and away at beginnings of phrases."""
    gaze = np.zeros((len(time_s), 2))
    current = np.zeros(2)
    shifts = []
    starts = [phrase.start_s for phrase in utterance.phrases]
    at_s = 0.6
    while at_s < time_s[-1]:
        begins = min(abs(at_s - start) for start in starts) < 0.5
        away = rng.random() < (0.55 if begins else 0.28)
        target = rng.normal(0, 2.2, 2)
        if away:
            pitch = rng.choice([-1.0, 1.0], p=[0.45, 0.55]) * rng.uniform(2, 9)
            target = np.array([rng.normal(0, 15), pitch])
        gaze += (target - current) * minimum_jerk((time_s - at_s) / 0.09)[:, None]
        shifts.append((float(at_s), float(np.abs(target - current).sum())))
        current = target
        at_s += rng.uniform(0.5, 1.4) if away else rng.gamma(3, 0.75) + 0.4
    return gaze, shifts


def _breath(
    utterance: Utterance, time_s: Float[np.ndarray, " T"], rng: np.random.Generator
) -> Float[np.ndarray, " T"]:
    """A slow wave, and a quicker intake in each pause of speech."""
    breath = 0.5 * np.sin(2 * np.pi * 0.24 * time_s + rng.uniform(0, 2 * np.pi))
    for before, after in zip(utterance.phrases[:-1], utterance.phrases[1:], strict=True):
        pause_s = after.start_s - before.end_s
        if pause_s > 0.3:
            intake = minimum_jerk((time_s - before.end_s) / pause_s)
            breath += 0.9 * intake * np.exp(-np.maximum(time_s - after.start_s, 0) / 1.1)
    return breath


def _euler(
    yaw: Float[np.ndarray, " T"], pitch: Float[np.ndarray, " T"], roll: Float[np.ndarray, " T"]
) -> Float[np.ndarray, "T 3 3"]:
    return euler_matrices("YXZ", np.stack([yaw, pitch, roll], axis=1))
