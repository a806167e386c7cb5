"""Detection of a gesture plan in motion alone, as annotators do it.

A convolutional network (trained on the corpus by `model.evaluation.plan_detection`) classifies
hand phases from the wrist's position and velocity and the other hand's speed; the Viterbi
algorithm decodes them. Events of head, face and legs are detected by rules.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float, Int, Num
from scipy.ndimage import gaussian_filter1d
from scipy.signal import find_peaks
from torch import Tensor, nn

from conventions.joints import JOINT_INDEX
from conventions.rates import FPS
from model.motion.kinematics import RestSkeleton, blendshape_names
from model.motion.motion import Motion
from model.motion.runs import equal_runs, true_runs
from model.motion.tracks import Tracks, track_points, wrist_positions_in_chest_frame
from model.plan.plan import (
    PHASES,
    SIDES,
    Blink,
    Brow,
    FootContact,
    Gaze,
    GesturePlan,
    HandPhase,
    Leg,
    Nod,
    Side,
    Smile,
    Stance,
)

WEIGHTS = Path(__file__).resolve().parents[1] / "assets" / "hand_phases.npz"
DILATIONS = (2, 4, 6)
KERNEL, HIDDEN = 5, 40
NOD_DEG = 2.0
"""Smallest depth of a nod relative to half a second around it (degrees)."""
BROW, FROWN, BLINK, SMILE = 0.14, 0.07, 0.45, 0.08
MIN_PELVIS_OFFSET_SHARE = 0.03
"""Offset of the pelvis on one leg from the middle, as a fraction of the feet's distance."""
STEP_M_S = 0.15
STILL_M_S = 0.1
"""Wrist speed (m/s) below which none of `MOVING_PHASES` is detected."""
MOVING_PHASES = ("preparation", "stroke", "retraction")
SHIFT_DEG_S = 40.0
"""Gaze speed (degrees/s) above which the gaze shifts."""
MIN_LOOK_S, MIN_STAND_S, MIN_SMILE_S, MIN_BEAT_S = 0.15, 0.4, 0.4, 0.12
_MAX_M = 0.99


def plan_from_motion(motion: Motion, skeleton: RestSkeleton) -> GesturePlan:
    """Detect hand phases and events of head, face and legs; gestures have no kinds or words.

    What the motion does not have (face, moving eyes) is not detected.
    """
    tracks = track_points(motion, skeleton)
    places = wrist_positions_in_chest_frame(tracks)
    hands = {
        side: tuple(hand_phases(places[side], places[SIDES[1 - SIDES.index(side)]]))
        for side in SIDES
    }
    brows, smiles, blinks = _face(motion)
    return GesturePlan(
        duration_s=motion.num_frames / FPS,
        left=hands["left"],
        right=hands["right"],
        nods=tuple(_nods(tracks)),
        looks=tuple(_detect_gaze(tracks)),
        brows=brows,
        smiles=smiles,
        blinks=blinks,
        stands=tuple(_detect_stances(tracks)),
        planted=tuple(one for side in SIDES for one in _planted(tracks, side)),
    )


def hand_phases(
    wrist: Float[np.ndarray, "T 3"], other_wrist: Float[np.ndarray, "T 3"]
) -> Iterator[HandPhase]:
    """Detect the phases of one hand over the whole motion."""
    likely, stay, change = _likelihoods(hand_features(wrist, other_wrist))
    states = _most_likely(likely, stay, change)
    smooth = gaussian_filter1d(wrist, 1.0, axis=0)
    speed = np.zeros(len(wrist))
    if len(wrist) > 1:
        speed = np.linalg.norm(np.gradient(smooth, axis=0), axis=1) * FPS
    for first, stop in equal_runs(states):
        if speed[first:stop].max() < STILL_M_S and PHASES[states[first]] in MOVING_PHASES:
            goes_back = PHASES[states[first]] == "retraction"
            states[first:stop] = PHASES.index("rest" if goes_back else "hold")
    for first, stop in equal_runs(states):
        phase = PHASES[states[first]]
        parts = _beats(speed, first, stop) if phase == "beat" else [first, stop]
        for start, end in pairwise(parts):
            out, up, forward = np.clip(smooth[end - 1], -_MAX_M, _MAX_M).round(4).tolist()
            yield HandPhase(start / FPS, end / FPS, phase, (out, up, forward))


def hand_features(
    wrist: Float[np.ndarray, "T 3"], other_wrist: Float[np.ndarray, "T 3"]
) -> Float[np.ndarray, "T 10"]:
    """Compute classifier features: position relative to the hand's usual one, velocity, speeds."""
    own, beside = (gaussian_filter1d(path, 1.0, axis=0) for path in (wrist, other_wrist))
    if len(own) < 2:
        return np.zeros((len(own), 10), np.float32)
    velocity, swing = (np.gradient(path, axis=0) * FPS for path in (own, beside))
    speed, beside_speed = (np.linalg.norm(v, axis=1, keepdims=True) for v in (velocity, swing))
    out, _, forward = np.median(own, axis=0)
    home = np.array([out, np.percentile(own[:, 1], 10), forward])
    gain = np.gradient(speed, axis=0) * FPS / 5
    parts = [own - home, velocity, speed, np.log(speed + 0.02), gain, np.log(beside_speed + 0.02)]
    return np.concatenate(parts, axis=1).astype(np.float32)


class PhaseNetwork(nn.Module):
    """Network that scores each phase in each frame, from standardised `hand_features`."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = nn.Conv1d(channels, HIDDEN, KERNEL, padding=KERNEL // 2)
        self.inner = nn.ModuleList(
            nn.Conv1d(HIDDEN, HIDDEN, KERNEL, padding=KERNEL // 2 * d, dilation=d)
            for d in DILATIONS
        )
        self.last = nn.Conv1d(HIDDEN, len(PHASES), 1)

    def forward(self, features: Float[Tensor, "B T channels"]) -> Float[Tensor, "B T phases"]:
        hidden = torch.relu(self.first(features.transpose(1, 2)))
        for layer in self.inner:
            hidden = hidden + torch.relu(layer(hidden))
        return self.last(hidden).transpose(1, 2)


@cache
def _weights() -> tuple[PhaseNetwork, dict[str, np.ndarray]]:
    """Load the network with the mean durations of phases and their transition probabilities."""
    with np.load(WEIGHTS, allow_pickle=False) as data:
        weights = {name: data[name].astype(np.float32) for name in data.files}
    network = PhaseNetwork(len(weights["mean"]))
    state = {
        name: torch.from_numpy(weights[name.replace("inner.", "inner")]).view_as(tensor)
        for name, tensor in network.state_dict().items()
    }
    network.load_state_dict(state)
    return network.eval().requires_grad_(False), weights


def _likelihoods(
    features: Float[np.ndarray, "T 10"],
) -> tuple[
    Float[np.ndarray, "T phases"], Float[np.ndarray, " phases"], Float[np.ndarray, "phases phases"]
]:
    """Return log probabilities of phases per frame, of staying in each, and of transitions."""
    network, weights = _weights()
    scores = network(torch.from_numpy((features - weights["mean"]) / weights["std"])[None])[0]
    leave = 1 / weights["frames"]
    change = np.log(weights["next"]) + np.log(leave)[:, None]
    return scores.log_softmax(1).numpy(), np.log(1 - leave), change


def _most_likely(
    likely: Float[np.ndarray, "T phases"],
    stay: Float[np.ndarray, " phases"],
    change: Float[np.ndarray, "phases phases"],
) -> Int[np.ndarray, " T"]:
    """Find the most likely sequence of phases by the Viterbi algorithm."""
    step = change.copy()
    np.fill_diagonal(step, stay)
    score, came = likely[0], np.zeros(likely.shape, int)
    for t in range(1, len(likely)):
        through = score[:, None] + step
        came[t] = through.argmax(axis=0)
        score = through.max(axis=0) + likely[t]
    states = np.full(len(likely), int(score.argmax()))
    for t in range(len(likely) - 1, 0, -1):
        states[t - 1] = came[t, states[t]]
    return states


def _beats(speed: Float[np.ndarray, " T"], first: int, stop: int) -> list[int]:
    """Return the boundaries of consecutive beats, which are where the hand reverses."""
    least = round(MIN_BEAT_S * FPS)
    turns, _ = find_peaks(-speed[first:stop], distance=least)
    inside = [first + int(k) for k in turns if least <= k <= stop - first - least]
    return [first, *inside, stop]


def _spans(is_on: Bool[np.ndarray, " T"], least_s: float) -> list[tuple[int, int]]:
    return [(first, stop) for first, stop in true_runs(is_on) if (stop - first) / FPS >= least_s]


def _seconds(frames: Num[np.ndarray, " N"]) -> list[float]:
    return [round((float(k) + 0.5) / FPS, 4) for k in frames]


def _nods(tracks: Tracks) -> Iterator[Nod]:
    """Detect nods: the head moves down relative to half a second around it."""
    ahead = tracks.R_world_joint[:, JOINT_INDEX["head"], 1, 2].astype(np.float64)
    down = -np.degrees(np.arcsin(np.clip(ahead, -1, 1)))
    moved = gaussian_filter1d(down, 1.0) - gaussian_filter1d(down, 6.0)
    peaks, properties = find_peaks(moved, prominence=NOD_DEG)
    for at_s, depth in zip(_seconds(peaks), properties["prominences"], strict=True):
        yield Nod(at_s, round(float(depth), 3))


def _detect_gaze(tracks: Tracks) -> Iterator[Gaze]:
    """Detect stretches with a steady gaze, relative to the mean direction of the chest."""
    eyes = tracks.R_world_joint[:, JOINT_INDEX["left_eye"], :, 2].astype(np.float64)
    chest = tracks.R_world_joint[:, JOINT_INDEX["spine3"], :, 2].astype(np.float64).mean(axis=0)
    yaw = np.unwrap(np.arctan2(eyes[:, 0], eyes[:, 2])) - np.arctan2(chest[0], chest[2])
    ways = np.degrees(np.stack([yaw, -np.arcsin(np.clip(eyes[:, 1], -1, 1))], axis=1))
    if len(ways) < 2:
        return
    speed = np.linalg.norm(np.gradient(gaussian_filter1d(ways, 1.0, axis=0), axis=0), axis=1) * FPS
    stays = _spans(speed < SHIFT_DEG_S, MIN_LOOK_S)
    if not stays:
        return
    ends = [*(first for first, _ in stays[1:]), len(ways)]
    for (first, stop), end in zip(stays, ends, strict=True):
        to_left, down = ways[first:stop].mean(axis=0).round(2).tolist()
        yield Gaze(first / FPS, end / FPS, to_left, down)


def _face(motion: Motion) -> tuple[tuple[Brow, ...], tuple[Smile, ...], tuple[Blink, ...]]:
    if motion.expression_basis != "arkit52":
        return (), (), ()
    names = blendshape_names()

    def unit(*units: str) -> Float[np.ndarray, " T"]:
        columns = motion.expressions[:, [names.index(name) for name in units]]
        return columns.mean(axis=1).astype(np.float64)

    frown = gaussian_filter1d(unit("browDownLeft", "browDownRight"), 1.0)
    raised = gaussian_filter1d(unit("browInnerUp"), 1.0) - frown
    ups, _ = find_peaks(raised, prominence=BROW)
    downs, _ = find_peaks(frown, prominence=FROWN)
    brows = [
        Brow(at, round(min(1.0, float(raised[k])), 4))
        for k, at in zip(ups, _seconds(ups), strict=True)
        if raised[k] > 0
    ]
    brows += [
        Brow(at, round(max(-1.0, -float(frown[k])), 4))
        for k, at in zip(downs, _seconds(downs), strict=True)
    ]
    lids = np.pad(unit("eyeBlinkLeft", "eyeBlinkRight"), 1)
    shut, _ = find_peaks(lids, height=BLINK, prominence=0.3)
    smile = gaussian_filter1d(unit("mouthSmileLeft", "mouthSmileRight"), 6.0)
    smiles = [
        Smile(first / FPS, stop / FPS, round(min(1.0, float(smile[first:stop].mean())), 4))
        for first, stop in _spans(smile > SMILE, MIN_SMILE_S)
    ]
    in_time = tuple(sorted(brows, key=lambda brow: brow.time_s))
    return in_time, tuple(smiles), tuple(map(Blink, _seconds(shut - 1)))


def _detect_stances(tracks: Tracks) -> Iterator[Stance]:
    """Detect the leg by the ankle that the pelvis is above."""
    left, right = (tracks.joints[:, JOINT_INDEX[f"{side}_ankle"]][:, [0, 2]] for side in SIDES)
    apart = left - right
    off = tracks.joints[:, 0][:, [0, 2]] - 0.5 * (left + right)
    share = (off * apart).sum(axis=1) / np.maximum((apart**2).sum(axis=1), 1e-4)
    share = gaussian_filter1d(share, 4.0)
    leg = np.where(
        share > MIN_PELVIS_OFFSET_SHARE, 1, np.where(share < -MIN_PELVIS_OFFSET_SHARE, -1, 0)
    )
    legs: dict[int, Leg] = {1: "left", -1: "right", 0: "both"}
    at = 0
    for first, stop in equal_runs(leg):
        if (stop - first) / FPS < MIN_STAND_S and stop < len(leg):
            continue  # too short: a shift to the other leg
        yield Stance(at / FPS, stop / FPS, legs[int(leg[first])])
        at = stop


def _planted(tracks: Tracks, side: Side) -> Iterator[FootContact]:
    foot = gaussian_filter1d(tracks.joints[:, JOINT_INDEX[f"{side}_ankle"]], 1.0, axis=0)
    if len(foot) < 2:
        return
    speed = np.linalg.norm(np.gradient(foot, axis=0), axis=1) * FPS
    for first, stop in _spans(speed < STEP_M_S, 0.0):
        yield FootContact(first / FPS, stop / FPS, side)
