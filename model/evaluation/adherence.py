"""Protocol ``adherence``: agreement of generated motion with the plan.

Plans are drawn for clips of the test split, generated, edited at random and generated again where
they differ. It measures whether strokes end when the plan has them, the requested hand moves and
the other stays, larger gestures are larger and higher ones higher, resting hands rest, and the
edited motion is as smooth as the unedited. Recordings with their own annotation show the accuracy
of these metrics.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d

from conventions.joints import JOINT_INDEX
from conventions.rates import FPS, SAMPLE_RATE
from model.data.recordings import parse_speaker, read_motion_and_speech, read_split
from model.evaluation.frechet import Features, frechet_distance, motion_features
from model.generation.base import System
from model.generation.regenerate import GenerationState, regenerate
from model.generation.windows import GenerateOptions, draw_conditions
from model.metrics.posture import foot_slide
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion, first_frames
from model.motion.tracks import Tracks, track_points, wrist_positions_in_chest_frame
from model.networks.autoencoder import load_motion_encoder
from model.plan.editing import (
    GestureKey,
    add_gesture,
    change_hands,
    delete_gesture,
    gestures,
    move_gesture,
    raise_gesture,
    scale_gesture,
    set_hold,
)
from model.plan.files import read_corpus_textgrid
from model.plan.kinds import REST_POSITION, USUAL_STROKE_GOALS
from model.plan.plan import SIDES, GesturePlan, HandPhase, PlanError, PlanResult, Side
from model.plan.plan_features import hand_tracks, plan_tracks
from model.speech.audio import Speech
from model.systems.helpers.config import FGD_ENCODER
from model.systems.registry import default_planning_system, load_system

FEET = [JOINT_INDEX["left_foot"], JOINT_INDEX["right_foot"]]
SPEECH_S = 12.0
"""Length of the speech of each clip (s)."""
LAG_TOLERANCE_S = 0.1
MAX_LAG_S = 0.4
MIN_PATH_CORRELATION = 0.5
"""Smallest correlation of the wrist's path with the plan's at which a stroke counts as made."""
MIN_PATH_LENGTH_SHARE = 0.5
"""Smallest share of the planned path length that the requested hand must move."""
STILL_M_S = 0.12
"""Largest mean speed (m/s) of a wrist that rests, or is to stay while the other moves."""
EDITS = ("move", "hold", "delete", "add", "hand", "size", "height")
SIZES = (0.6, 1.0, 1.5)
HEIGHTS_M = (-0.12, 0.0, 0.12)
WristPositions = Mapping[Side, Float[np.ndarray, "T 3"]]


def stroke_lags(
    wrists: WristPositions, plan: GesturePlan, frames: range = range(10**9)
) -> list[float]:
    """Compute the delays (s) of stroke ends against the plan; NaN if no stroke is made.

    The wrist's path from the stroke's preparation to half a second after it is compared with the
    planned one at every shift; the shift with the highest correlation is the delay. Strokes that
    end outside of ``frames`` are left out.
    """
    num_frames = len(wrists["left"])
    planned = plan_tracks(plan, num_frames).astype(np.float64)
    most = round(MAX_LAG_S * FPS)
    lags = []
    for side in SIDES:
        path = planned[:, hand_tracks(side)][:, :3]
        for phase in plan.hand(side):
            end = round(phase.end_s * FPS)
            if phase.phase != "stroke" or end not in frames:
                continue
            first, stop = round(phase.start_s * FPS) - 12, end + 9
            if first - most < 0 or stop + most > num_frames:
                continue
            lags.append(_lag(path[first:stop], wrists[side], first, most))
    return lags


def _lag(
    planned: Float[np.ndarray, "n 3"], path: Float[np.ndarray, "T 3"], first: int, most: int
) -> float:
    wish = planned - planned.mean(axis=0)
    likeness = []
    for shift in range(-most, most + 1):
        made = path[first + shift : first + shift + len(wish)]
        made = made - made.mean(axis=0)
        norm = np.linalg.norm(made) * np.linalg.norm(wish)
        likeness.append(float((made * wish).sum() / norm) if norm > 1e-9 else 0.0)
    best = int(np.argmax(likeness))
    return (best - most) / FPS if likeness[best] >= MIN_PATH_CORRELATION else math.nan


def rest_speeds(wrists: WristPositions, plan: GesturePlan) -> list[float]:
    """Compute the mean speed (m/s) of each resting wrist, for rests of .8 s or more."""
    speeds = []
    for side in SIDES:
        speed = _speed(wrists[side])
        for phase in plan.hand(side):
            if phase.phase == "rest" and phase.end_s - phase.start_s >= 0.8:
                first, stop = round((phase.start_s + 0.25) * FPS), round((phase.end_s - 0.25) * FPS)
                if first < len(speed):
                    speeds.append(float(speed[first:stop].mean()))
    return speeds


def only_one_hand_moves(
    wrists: WristPositions, plan: GesturePlan, gesture: GestureKey
) -> bool | None:
    """Check whether only the requested hand moves; None if the other is planned to move as well."""
    phases = _phases_of(plan, gesture)
    first, stop = round(phases[0].start_s * FPS), round(phases[-1].end_s * FPS)
    other = SIDES[1 - SIDES.index(gesture.side)]
    planned = plan_tracks(plan, len(wrists["left"])).astype(np.float64)
    around = slice(max(0, first - 4), stop + 4)
    stays = _path_length(planned[around, hand_tracks(other)][:, :3]) <= 0.02
    wish = _path_length(planned[first:stop, hand_tracks(gesture.side)][:, :3])
    if not stays or wish < 0.05:
        return None
    moves_enough = _path_length(wrists[gesture.side][first:stop]) >= MIN_PATH_LENGTH_SHARE * wish
    return moves_enough and bool(_speed(wrists[other])[first:stop].mean() < STILL_M_S)


def _phases_of(plan: GesturePlan, gesture: GestureKey) -> list[HandPhase]:
    """Return preparation and stroke of a gesture."""
    phases = plan.hand(gesture.side)
    at = [abs(p.end_s - gesture.stroke_end_s) if p.phase == "stroke" else math.inf for p in phases]
    last = int(np.argmin(at))
    first = last - 1 if last and phases[last - 1].phase == "preparation" else last
    return list(phases[first : last + 1])


def _path_length(path: Float[np.ndarray, "n 3"]) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()) if len(path) > 1 else 0.0


def _speed(path: Float[np.ndarray, "T 3"]) -> Float[np.ndarray, " T"]:
    smooth = gaussian_filter1d(path, 1.0, axis=0)
    return np.linalg.norm(np.gradient(smooth, axis=0), axis=1) * FPS


def random_edit(
    plan: GesturePlan, rng: np.random.Generator
) -> tuple[PlanResult, GestureKey | None]:
    """Return a random valid edit and its gesture unless deleted; raises PlanError if none."""
    for _ in range(100):
        there = [g for side in SIDES for g in gestures(plan, side)]
        name = EDITS[rng.integers(len(EDITS))]
        try:
            if there and name != "add":
                edited, gesture = _changed(plan, there[rng.integers(len(there))], name, rng)
            else:
                kind = str(rng.choice(list(USUAL_STROKE_GOALS)))
                at_s = round(float(rng.uniform(1.0, plan.duration_s - 1.0)), 3)
                gesture = GestureKey(SIDES[rng.integers(2)], at_s)
                edited = add_gesture(plan, kind, at_s, gesture.side)
        except PlanError:
            continue
        return edited, gesture
    raise PlanError("None of the random edits could be applied to the plan.")


def _changed(
    plan: GesturePlan, old: GestureKey, name: str, rng: np.random.Generator
) -> tuple[PlanResult, GestureKey | None]:
    by = float(rng.uniform(0.2, 1.5))
    if name == "move":
        to_s = round(old.stroke_end_s + float(rng.uniform(-1.5, 1.5)), 3)
        return move_gesture(plan, old, to_s), GestureKey(old.side, to_s)
    if name == "delete":
        return delete_gesture(plan, old), None
    if name == "hand":
        other = SIDES[1 - SIDES.index(old.side)]
        return change_hands(plan, old, other), GestureKey(other, old.stroke_end_s)
    if name == "hold":
        return set_hold(plan, old, by), old
    if name == "size":
        return scale_gesture(plan, old, 0.5 + by), old
    return raise_gesture(plan, old, 0.2 * (by - 0.85)), old


Scores = defaultdict[str, list[float]]
"""Results by metric, one number per observation."""


def mean_scores(scores: Scores) -> dict[str, dict[str, float]]:
    """Return mean and number of the results by metric."""
    return {
        name: {"mean": float(np.nanmean(values)), "count": len(values)}
        for name, values in sorted(scores.items())
        if values
    }


def _within_tolerance(lags: Sequence[float]) -> list[float]:
    return [float(abs(lag) <= LAG_TOLERANCE_S + 1e-6) for lag in lags]  # NaN is not


def _jerk_and_sliding(tracks: Tracks, frames: range) -> tuple[float, float]:
    """Compute the jerk of all joints (m/s^3) and the sliding of feet (m/s) in some frames."""
    joints = tracks.joints[frames.start : frames.stop]
    jerk = np.linalg.norm(np.diff(joints, n=3, axis=0), axis=-1).mean() * FPS**3
    return float(jerk), foot_slide(joints[:, FEET])


def generate_and_score(
    system: System,
    speech: Speech,
    speaker: str,
    num_edits: int,
    rng: np.random.Generator,
    scores: Scores,
) -> list[Motion]:
    """Generate a clip and edited versions, add results to ``scores``, and return the motions.

    The unedited motion is the first, then each edited one.
    """
    skeleton = open_body_skeleton()
    options = GenerateOptions(speaker, seed=int(rng.integers(1000)))
    (plan,) = draw_conditions(system, speech, options)
    first = regenerate(system, speech, replace(options, conditions=(plan,)))
    tracks = track_points(first.motion, skeleton)
    wrists = wrist_positions_in_chest_frame(tracks)
    scores["wrist still in planned rests"] += [
        float(s < STILL_M_S) for s in rest_speeds(wrists, plan)
    ]

    def again(changed: GesturePlan) -> GenerationState:
        return regenerate(system, speech, replace(options, conditions=(changed,)), first)

    motions = [first.motion]
    for _ in range(num_edits):
        edited, gesture = random_edit(plan, rng)
        made = again(edited.plan)
        motions.append(made.motion)
        new_tracks = track_points(made.motion, skeleton)
        new = wrist_positions_in_chest_frame(new_tracks)
        if gesture is not None:
            end = round(gesture.stroke_end_s * FPS)
            own = GesturePlan(plan.duration_s).with_hand(
                gesture.side, edited.plan.hand(gesture.side)
            )
            lags = stroke_lags(new, own, range(end - 1, end + 2))
            scores["edited stroke on time"] += _within_tolerance(lags)
            alone = only_one_hand_moves(new, edited.plan, gesture)
            if alone is not None:
                scores["edited hand moves, other hand does not"].append(float(alone))
        for part in made.changed_frames:
            if len(part) > 15:
                jerk, slide = _jerk_and_sliding(new_tracks, part)
                jerk_before, slide_before = _jerk_and_sliding(tracks, part)
                scores["jerk, edited / unedited"].append(jerk / jerk_before)
                if slide_before > 0:
                    scores["foot sliding, edited / unedited"].append(slide / slide_before)
    there = [g for side in SIDES for g in gestures(plan, side)]
    inside = [g for g in there if 1 < g.stroke_end_s < plan.duration_s - 1]
    for k in rng.permutation(len(inside))[: max(1, num_edits // 4)]:
        gesture = inside[k]
        larger = _varied(plan, gesture, SIZES, scale_gesture, again)
        scores["gesture sizes in planned order"] += _pairwise_order(
            [distance_from_rest_m(one, gesture) for one in larger]
        )
        higher = _varied(plan, gesture, HEIGHTS_M, raise_gesture, again)
        scores["gesture heights in planned order"] += _pairwise_order(
            [_lands_at(one, gesture)[1] for one in higher]
        )
    return motions


def fgd_before_and_after_edits(clips: Sequence[Sequence[Features]]) -> dict[str, dict[str, float]]:
    """Compute the FGD to recorded motion of unedited and edited motion, and their ratio.

    ``clips`` holds the codes of each clip: recorded, unedited, edited ones. Edited motion is
    compared in sets of as many clips (mean over edits). Empty for a single clip.
    """
    if len(clips) < 2:
        return {}
    recorded, plain, *edited = (np.concatenate(one) for one in zip(*clips, strict=True))
    before = frechet_distance(recorded, plain)
    after = float(np.mean([frechet_distance(recorded, one) for one in edited]))
    values = {"unedited": before, "edited": after, "edited / unedited": after / before}
    return {f"FGD, {name}": {"mean": value, "count": len(clips)} for name, value in values.items()}


def _varied(
    plan: GesturePlan,
    gesture: GestureKey,
    values: Sequence[float],
    change: Callable[[GesturePlan, GestureKey, float], PlanResult],
    again: Callable[[GesturePlan], GenerationState],
) -> list[WristPositions]:
    """Return wrist positions for each value in turn; empty if the plan rejects one."""
    steps = []
    for value in values:
        try:
            edited = change(plan, gesture, value)
        except PlanError:
            return []
        tracks = track_points(again(edited.plan).motion, open_body_skeleton())
        steps.append(wrist_positions_in_chest_frame(tracks))
    return steps


def _pairwise_order(measured: Sequence[float]) -> list[float]:
    """Return for each pair of neighbours 1 if the second is larger, else 0."""
    return [float(b > a) for a, b in pairwise(measured)]


def distance_from_rest_m(wrists: WristPositions, gesture: GestureKey) -> float:
    """Compute a gesture's size: the distance of the stroke's end from the rest position (m)."""
    return math.dist(_lands_at(wrists, gesture), REST_POSITION)


def _lands_at(wrists: WristPositions, gesture: GestureKey) -> Float[np.ndarray, " 3"]:
    at = round(gesture.stroke_end_s * FPS)
    return wrists[gesture.side][at - 2 : at + 3].mean(axis=0)


def score_recording(motion: Motion, plan: GesturePlan, scores: Scores) -> None:
    """Evaluate recorded motion against its annotation."""
    wrists = wrist_positions_in_chest_frame(track_points(motion, open_body_skeleton()))
    scores["recorded: strokes on time"] += _within_tolerance(stroke_lags(wrists, plan))
    there = [g for side in SIDES for g in gestures(plan, side)]
    alone = [
        only_one_hand_moves(wrists, plan, g)
        for g in there
        if 1 < g.stroke_end_s < plan.duration_s - 1
    ]
    scores["recorded: one hand moves, other hand does not"] += [
        float(each) for each in alone if each is not None
    ]


def evaluate_adherence(
    folder: Path, weights: Path, num_clips: int, num_edits: int, seed: int
) -> Iterator[dict[str, dict[str, float]]]:
    """Run the protocol with ``num_edits`` edits of each clip.

    Yields the results of all clips so far by metric after each clip.
    """
    scores, rng = Scores(list), np.random.default_rng(seed)
    system = load_system(default_planning_system(), weights)
    encoder, encoded_clips = load_motion_encoder(weights, FGD_ENCODER), []
    names = [n for n, split in read_split(folder).items() if split == "test"]
    clip_names = [n for n in names if parse_speaker(n)[1] in system.speakers]
    for name in rng.permutation(np.array(clip_names))[:num_clips].tolist():
        motion, speech = read_motion_and_speech(folder, name)
        cut = Speech(speech.waveform[: round(SPEECH_S * SAMPLE_RATE)], speech.sha256)
        plan = read_corpus_textgrid(folder / "textgrid" / f"{name}.TextGrid")
        recorded = first_frames(motion, cut.num_motion_frames)
        score_recording(recorded, _until(plan, cut.duration_s), scores)
        made = generate_and_score(system, cut, parse_speaker(name)[1], num_edits, rng, scores)
        codes = [motion_features(encoder, motion) for motion in (recorded, *made)]
        encoded_clips.append([one for one in codes if one is not None])
        yield mean_scores(scores) | fgd_before_and_after_edits(encoded_clips)


def _until(plan: GesturePlan, end_s: float) -> GesturePlan:
    """Return the hands of a plan up to some time."""
    hands = {side: tuple(p for p in plan.hand(side) if p.end_s <= end_s) for side in SIDES}
    return GesturePlan(end_s, left=hands["left"], right=hands["right"])
