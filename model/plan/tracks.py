"""A plan as numbers of each frame, as a network follows it.

Of each hand ten: where its goals lead it (out, up, forward), a pulse where a phase ends, and which
phase it is in; of the rest of the body nine.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import gaussian_filter1d

from conventions.rates import FPS
from model.plan.plan import (
    PHASES,
    SIDES,
    STILL,
    Gaze,
    GesturePlan,
    HandPhase,
    Planted,
    Side,
    Smile,
    Stand,
    without_gaps,
)

HAND_NUMBERS = 4 + len(PHASES)
BODY_TRACKS = ("nod", "yaw", "pitch", "brow", "smile", "blink", "stand", "left foot", "right foot")
NUM_TRACKS = 2 * HAND_NUMBERS + len(BODY_TRACKS)
FACE_TRACKS = slice(2 * HAND_NUMBERS, 2 * HAND_NUMBERS + BODY_TRACKS.index("blink") + 1)
"""Those that a face shows: how the head goes, and brows, smiles and blinks."""
NUM_FACE_TRACKS = FACE_TRACKS.stop - FACE_TRACKS.start
_GOAL, _END, _PHASE = slice(0, 3), 3, slice(4, 4 + len(PHASES))

PULSE_FRAMES = 1.5
"""Deviation of a pulse at a phase's end, and of the edges of phases."""
NOD_S, BROW_S, BLINK_S = 0.1, 0.15, 0.05
"""Deviations of the pulses of a nod, a brow's rise and a blink."""
NOD_DEG, LOOK_DEG = 5.0, 10.0
"""What counts 1."""
GLANCE_S = 0.09
"""How long a gaze takes to shift."""


def hand_tracks(side: Side) -> slice:
    """The numbers of one hand."""
    first = SIDES.index(side) * HAND_NUMBERS
    return slice(first, first + HAND_NUMBERS)


def body_track(name: str) -> int:
    """Place of one of `BODY_TRACKS`."""
    return 2 * HAND_NUMBERS + BODY_TRACKS.index(name)


def tracks_of(plan: GesturePlan, num_frames: int) -> Float[np.ndarray, "T tracks"]:
    """The plan's numbers; frame k stands for the time (k + .5) / 30 s."""
    time_s = (np.arange(num_frames) + 0.5) / FPS
    tracks = np.zeros((num_frames, NUM_TRACKS), np.float32)
    for side in SIDES:
        phases = without_gaps(plan.hand(side), num_frames / FPS)
        tracks[:, hand_tracks(side)] = _of_hand(phases, time_s)

    def pulses(name: str, times: Sequence[tuple[float, float]], deviation_s: float) -> None:
        for at_s, size in times:
            tracks[:, body_track(name)] += size * _bell((time_s - at_s) / deviation_s)

    pulses("nod", [(nod.time_s, nod.depth_deg / NOD_DEG) for nod in plan.nods], NOD_S)
    pulses("brow", [(brow.time_s, brow.height) for brow in plan.brows], BROW_S)
    pulses("blink", [(blink.time_s, 1.0) for blink in plan.blinks], BLINK_S)
    for before, look in pairwise((Gaze(-1.0, 0.0, 0.0, 0.0), *plan.looks)):
        share = _min_jerk((time_s - look.start_s) / GLANCE_S)
        tracks[:, body_track("yaw")] += share * (look.yaw_deg - before.yaw_deg) / LOOK_DEG
        tracks[:, body_track("pitch")] += share * (look.pitch_deg - before.pitch_deg) / LOOK_DEG
    for smile in plan.smiles:
        tracks[:, body_track("smile")] += smile.size * _while(smile, time_s)
    for stand in plan.stands:
        sign = {"left": 1.0, "right": -1.0, "both": 0.0}[stand.leg]
        tracks[:, body_track("stand")] += sign * _while(stand, time_s)
    for one in plan.planted:
        tracks[:, body_track(f"{one.foot} foot")] += _while(one, time_s)
    for name, frames in (("smile", 6), ("stand", 6), ("left foot", 1), ("right foot", 1)):
        column = tracks[:, body_track(name)]
        tracks[:, body_track(name)] = gaussian_filter1d(column, frames)
    return tracks


def at_rest(plan: GesturePlan, frames: range) -> Float[np.ndarray, " T"]:
    """How much both hands rest in some frames, 0 to 1; edges are as soft as those of phases. Before
    and after the plan hands stay as they are at its ends."""
    margin = round(4 * PULSE_FRAMES)
    wide = range(frames.start - margin, frames.stop + margin)
    time_s = ((np.array(wide) + 0.5) / FPS).clip(0.5 / FPS, plan.duration_s - 0.5 / FPS)
    rests = np.ones(len(wide), bool)
    for side in SIDES:
        hand = np.zeros(len(wide), bool)
        for phase in without_gaps(plan.hand(side), plan.duration_s):
            if phase.phase == "rest":
                hand |= (phase.start_s <= time_s) & (time_s < phase.end_s)
        rests &= hand
    soft = gaussian_filter1d(rests.astype(float), PULSE_FRAMES)
    return soft[margin : margin + len(frames)]


def goal_path(
    phases: Sequence[HandPhase], time_s: Float[np.ndarray, " T"]
) -> Float[np.ndarray, "T 3"]:
    """Where a hand's goals lead it, by minimum jerk within each phase: a path that only the phase
    of a time and the one before it decide. There must be a phase, and no gap between two."""
    goals = np.array([phase.goal for phase in phases])
    path = np.tile(goals[0], (len(time_s), 1))
    for before, goal, phase in zip(goals[:-1], goals[1:], phases[1:], strict=True):
        since = time_s >= phase.start_s
        share = _min_jerk((time_s[since] - phase.start_s) / (phase.end_s - phase.start_s))
        path[since] = before + share[:, None] * (goal - before)
    return path


def _of_hand(
    phases: tuple[HandPhase, ...], time_s: Float[np.ndarray, " T"]
) -> Float[np.ndarray, "T numbers"]:
    numbers = np.zeros((len(time_s), HAND_NUMBERS))
    numbers[:, _GOAL] = goal_path(phases, time_s)
    for phase in phases:
        if phase.phase not in STILL:
            since = (time_s - phase.end_s) * FPS / PULSE_FRAMES
            numbers[:, _END] = np.maximum(numbers[:, _END], _bell(since))
        numbers[:, _PHASE.start + PHASES.index(phase.phase)] += _while(phase, time_s)
    numbers[:, _PHASE] = gaussian_filter1d(numbers[:, _PHASE], PULSE_FRAMES, axis=0)
    return numbers


def _bell(x: Float[np.ndarray, " T"]) -> Float[np.ndarray, " T"]:
    return np.exp(-0.5 * x**2)


def _min_jerk(share: Float[np.ndarray, " T"]) -> Float[np.ndarray, " T"]:
    s = np.clip(share, 0.0, 1.0)
    return s**3 * (10 - 15 * s + 6 * s**2)


def _while(
    event: HandPhase | Smile | Stand | Planted, time_s: Float[np.ndarray, " T"]
) -> Bool[np.ndarray, " T"]:
    """Frames whose middle lies in it."""
    return (time_s >= event.start_s) & (time_s < event.end_s)
