"""Animation of trunk, head and gaze."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from conventions.joints import JOINT_INDEX
from model.plan.plan import Gaze, Nod
from tools.corpus.body.signals import (
    frame_times,
    gaussian_bump,
    low_pass,
    minimum_jerk,
    smooth_line,
    sway_line,
)
from tools.corpus.people.rig import euler_matrices
from tools.corpus.people.speaker import Speaker
from tools.corpus.words.prosody import Utterance

PELVIS_TILT_DEG = -11.0
CALMER = 0.65  # share of the sway removed while the speaker listens
TREMOR_DEG = 0.06  # tremor of the trunk; even calm people are never perfectly smooth
SPINE = ((3, 0.30, 7.0), (6, 0.35, 4.0), (9, 0.35, 4.0))  # joint, share of the turn, posture in deg


@dataclass(frozen=True)
class Trunk:
    """Pelvis, spine, neck, head and eye rotations, and curves for legs and face."""

    rotations: dict[int, Float[np.ndarray, "T 3 3"]]
    accent: Float[np.ndarray, " T"]
    eyes_deg: Float[np.ndarray, "T 2"]
    """Pitch (down positive) and yaw of the eyes in the head (degrees)."""
    breath: Float[np.ndarray, " T"]
    nods: tuple[Nod, ...]
    gaze: tuple[Gaze, ...]
    """Fixations, which cover the clip."""


def move_trunk(
    utterance: Utterance,
    hands: dict[str, Float[np.ndarray, "T C"]],
    calm: Float[np.ndarray, " T"],
    speaker: Speaker,
    rng: np.random.Generator,
) -> Trunk:
    """Animate the trunk by hands and accents, the head by gaze, with less sway where ``calm``."""
    num_frames = len(hands["left"])
    time_s = frame_times(num_frames)
    left, right = hands["left"][:, :3], hands["right"][:, :3]
    lively, swaying = speaker.energy, speaker.sway
    left_over = 1.0 - CALMER * calm
    accents = _accents(utterance, time_s, lively, rng)
    lead = low_pass(right[:, 2] - left[:, 2] + 0.5 * (right[:, 1] - left[:, 1]), 0.1)
    aside = low_pass(left[:, 0] + right[:, 0], 0.12)
    raised = low_pass(np.maximum(left[:, 1], 0) + np.maximum(right[:, 1], 0), 0.2)
    breath = _breath(utterance, time_s, rng)

    pelvis_yaw = left_over * sway_line(rng, num_frames, 4.5 * swaying) + 0.7 * accents.yaw
    yaw = 0.2 * pelvis_yaw + 28 * lead + accents.yaw
    yaw += left_over * _restless(rng, num_frames, 2.8 * swaying, 2.6 * swaying)
    pitch = 2.8 * lively * accents.level - 17 * raised
    pitch += left_over * _restless(rng, num_frames, 2.8 * swaying, 2.6 * swaying)
    roll = 15 * aside + accents.roll
    roll += left_over * _restless(rng, num_frames, 2.8 * swaying, 2.4 * swaying)

    yaw, pitch, roll = (
        turn + smooth_line(rng, num_frames, TREMOR_DEG, 0.05) for turn in (yaw, pitch, roll)
    )

    fixations = _gaze(utterance, time_s, rng)
    gaze = _gaze_curve(fixations, time_s)
    head_gaze = low_pass(gaze, 0.11)
    tilt, look = _phrase_attitudes(utterance, time_s, rng)
    chest_yaw = pelvis_yaw + yaw

    def restless(fast: float) -> np.ndarray:
        slow = smooth_line(rng, num_frames, 2.1, 0.9) + smooth_line(rng, num_frames, 0.13, 0.035)
        return left_over * (slow + smooth_line(rng, num_frames, fast, 0.18))

    head_yaw = -0.62 * chest_yaw + 0.55 * head_gaze[:, 0] + look + accents.tilt
    head_yaw += restless(2.8) - 0.3 * accents.yaw
    head_pitch = -0.5 * pitch + 0.5 * head_gaze[:, 1] + accents.nod + 1.0 + restless(2.5)
    head_roll = -0.45 * roll + tilt + restless(2.5) - 0.12 * head_yaw

    lean = speaker.lean_deg
    pelvis_pitch = (
        PELVIS_TILT_DEG + 0.3 * lean + left_over * sway_line(rng, num_frames, 0.9 * swaying)
    )
    pelvis_roll = left_over * sway_line(rng, num_frames, 1.5 * swaying)
    rotations = {0: _euler(pelvis_yaw, pelvis_pitch, pelvis_roll)}
    for joint, share, posture in SPINE:
        breathing = 0.9 * breath if joint == JOINT_INDEX["spine3"] else 0.0
        bent = posture + share * (pitch + 0.3 * lean) + breathing
        rotations[joint] = _euler(share * yaw, bent, share * roll)
    rotations[JOINT_INDEX["neck"]] = _euler(0.5 * head_yaw, 5 + 0.45 * head_pitch, 0.45 * head_roll)
    rotations[JOINT_INDEX["head"]] = _euler(
        0.5 * head_yaw, -6 + 0.55 * head_pitch, 0.55 * head_roll
    )
    eye_pitch = gaze[:, 1] - 0.5 * head_gaze[:, 1] - 0.24 * accents.nod
    drift = head_yaw + chest_yaw - 0.55 * head_gaze[:, 0]
    eye_yaw = gaze[:, 0] - 0.55 * head_gaze[:, 0] - 0.25 * drift
    eyes = np.stack([np.clip(eye_pitch, -18, 15), np.clip(eye_yaw, -22, 22)], axis=1)
    for joint in (JOINT_INDEX["left_eye"], JOINT_INDEX["right_eye"]):
        rotations[joint] = euler_matrices("YX", eyes[:, ::-1])
    return Trunk(rotations, accents.level, eyes, breath, accents.nods, fixations)


def _restless(
    rng: np.random.Generator, num_frames: int, slow_deg: float, fast_deg: float
) -> Float[np.ndarray, " T"]:
    """Draw sway plus quicker small movements."""
    slow = sway_line(rng, num_frames, slow_deg)
    return slow + smooth_line(rng, num_frames, fast_deg, 0.2)


@dataclass(frozen=True)
class _Accents:
    level: Float[np.ndarray, " T"]
    nod: Float[np.ndarray, " T"]
    yaw: Float[np.ndarray, " T"]
    roll: Float[np.ndarray, " T"]
    tilt: Float[np.ndarray, " T"]
    nods: tuple[Nod, ...]


def _accents(
    utterance: Utterance, time_s: Float[np.ndarray, " T"], lively: float, rng: np.random.Generator
) -> _Accents:
    """Draw movements of head and trunk on stressed words: nods, decaying turns, tilts."""
    level, nod, yaw, roll, tilt = (np.zeros(len(time_s)) for _ in range(5))
    nods: list[Nod] = []
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
            depth = strength * rng.uniform(2.5, 7.5) * lively
            width = rng.uniform(0.08, 0.12)
            nod += depth * gaussian_bump(since, 0.05, width)
            nod -= 0.45 * depth * gaussian_bump(since, -0.18, 1.1 * width)
            nod -= 0.20 * depth * gaussian_bump(since, 0.32, 0.14)
            nods.append(Nod(word.beat_s + 0.05, float(depth)))
        tilt += rng.normal(0, 1.6) * strength * lively * gaussian_bump(since, 0.1, 0.25)
    for nod_event in _listeners_nods(utterance, lively, rng):
        nod += nod_event.depth_deg * gaussian_bump(time_s, nod_event.time_s, 0.12)
        nods.append(nod_event)
    return _Accents(level, nod, yaw, roll, tilt, tuple(nods))


def _listeners_nods(utterance: Utterance, lively: float, rng: np.random.Generator) -> list[Nod]:
    """Draw one to three nods in a row now and then, each smaller than the one before."""
    nods = []
    for span in utterance.listening:
        at_s = span.start_s + rng.uniform(0.7, 2.0)
        while at_s < span.end_s - 0.5:
            depth_deg = rng.uniform(3.0, 7.0) * lively**0.5
            for _ in range(rng.integers(1, 4)):
                if at_s < span.end_s - 0.3:
                    nods.append(Nod(float(at_s), float(depth_deg)))
                at_s += rng.uniform(0.42, 0.6)
                depth_deg *= rng.uniform(0.5, 0.8)
            at_s += rng.uniform(1.2, 3.0)
    return nods


def _phrase_attitudes(
    utterance: Utterance, time_s: Float[np.ndarray, " T"], rng: np.random.Generator
) -> tuple[Float[np.ndarray, " T"], Float[np.ndarray, " T"]]:
    """Draw a head tilt and a sideways turn for each phrase (degrees)."""
    tilt, look = np.zeros(len(time_s)), np.zeros(len(time_s))
    for phrase in utterance.phrases:
        hold = minimum_jerk((time_s - phrase.start_s + 0.3) / 0.6)
        hold -= minimum_jerk((time_s - phrase.end_s - 0.1) / 0.7)
        tilt += rng.normal(0, 2.4) * hold
        look += rng.normal(0, 3.0) * hold
    return tilt, look


def _gaze(
    utterance: Utterance, time_s: Float[np.ndarray, " T"], rng: np.random.Generator
) -> tuple[Gaze, ...]:
    """Draw fixations: on the listener, and away from the listener at beginnings of phrases."""
    starts = [phrase.start_s for phrase in utterance.phrases]
    changes = [(0.0, 0.0, 0.0)]
    at_s = 0.6
    while at_s < time_s[-1]:
        begins = min(abs(at_s - start) for start in starts) < 0.5
        listens = any(span.start_s < at_s < span.end_s for span in utterance.listening)
        away = rng.random() < (0.55 if begins else 0.15 if listens else 0.28)
        yaw, pitch = rng.normal(0, 2.2, 2)
        if away:
            pitch = rng.choice([-1.0, 1.0], p=[0.45, 0.55]) * rng.uniform(2, 9)
            yaw = rng.normal(0, 15)
        changes.append((at_s, float(yaw), float(pitch)))
        at_s += rng.uniform(0.5, 1.4) if away else rng.gamma(3, 0.75) + 0.4
    ends = [*(start for start, _, _ in changes[1:]), utterance.duration_s]
    return tuple(
        Gaze(start, end, yaw, pitch) for (start, yaw, pitch), end in zip(changes, ends, strict=True)
    )


def _gaze_curve(
    fixations: tuple[Gaze, ...], time_s: Float[np.ndarray, " T"]
) -> Float[np.ndarray, "T 2"]:
    """Return gaze yaw and pitch (degrees), with saccades of 90 ms between the fixations."""
    gaze = np.zeros((len(time_s), 2))
    for before, after in pairwise(fixations):
        step = np.array([after.yaw_deg - before.yaw_deg, after.pitch_deg - before.pitch_deg])
        gaze += step * minimum_jerk((time_s - after.start_s) / 0.09)[:, None]
    return gaze


def _breath(
    utterance: Utterance, time_s: Float[np.ndarray, " T"], rng: np.random.Generator
) -> Float[np.ndarray, " T"]:
    """Return the breath curve: a slow wave, and a quicker intake in each pause of speech."""
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
