"""Protocol ``finding``: accuracy of plans detected in motion.

Plans detected in recordings of the corpus's test split are compared with their exact annotation.
With ``--fit`` the network that classifies phases is trained first, on the train split.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import nn
from tqdm import tqdm

from conventions.rates import FPS
from model.data.recordings import parse_speaker, read_split
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import load_motion
from model.motion.tracks import track_points, wrist_positions_in_chest_frame
from model.plan.detection import WEIGHTS, PhaseNetwork, hand_features, plan_from_motion
from model.plan.files import read_corpus_textgrid
from model.plan.plan import PHASES, SIDES, GesturePlan, HandPhase
from model.storage.files import written_atomically

BOUNDARY_TOLERANCE_S = 0.1
NOD_AND_BROW_TOLERANCE_S = 0.15
"""Largest distance (s) between a detected and an annotated nod or brow movement."""
SHIFT_S = 0.5
MIN_OVERLAP = 0.3
"""Smallest overlap of a detected and an annotated phase, as a share of their union."""
FIT_EVERY = 6
"""Step through the train split's clips: every sixth is used."""
STEPS, BATCH, FRAMES, RATE = 1200, 16, 300, 6e-3


@dataclass(frozen=True)
class DetectionCounts:
    """Counts of detection: true positives, detected, annotated."""

    num_matched: int = 0
    num_detected: int = 0
    num_annotated: int = 0

    def __add__(self, other: DetectionCounts) -> DetectionCounts:
        return DetectionCounts(
            self.num_matched + other.num_matched,
            self.num_detected + other.num_detected,
            self.num_annotated + other.num_annotated,
        )

    @property
    def f1(self) -> float:
        """Harmonic mean of precision and recall."""
        return 2 * self.num_matched / max(1, self.num_detected + self.num_annotated)

    def as_json(self) -> dict[str, float]:
        """Return rounded F1, precision and recall, and the number of annotations."""
        return {
            "f1": round(self.f1, 3),
            "precision": round(self.num_matched / max(1, self.num_detected), 3),
            "recall": round(self.num_matched / max(1, self.num_annotated), 3),
            "annotated": self.num_annotated,
        }


def match_points(
    detected: Sequence[float], annotated: Sequence[float], within_s: float
) -> DetectionCounts:
    """Match points in time one to one within a tolerance, and count them."""
    free = sorted(annotated)
    num_matched = 0
    for at in sorted(detected):
        nearest = min(free, key=lambda other: abs(other - at), default=None)
        if nearest is not None and abs(nearest - at) <= within_s:
            free.remove(nearest)
            num_matched += 1
    return DetectionCounts(num_matched, len(detected), len(annotated))


def match_intervals(
    detected: Sequence[HandPhase], annotated: Sequence[HandPhase]
) -> DetectionCounts:
    """Match phases one to one that overlap by `MIN_OVERLAP` or more, and count them."""
    free, num_matched = list(annotated), 0
    for one in detected:
        shares = [_overlap(one, other) for other in free]
        if shares and max(shares) >= MIN_OVERLAP:
            free.pop(int(np.argmax(shares)))
            num_matched += 1
    return DetectionCounts(num_matched, len(detected), len(annotated))


def _overlap(one: HandPhase, other: HandPhase) -> float:
    shared = min(one.end_s, other.end_s) - max(one.start_s, other.start_s)
    return shared / (max(one.end_s, other.end_s) - min(one.start_s, other.start_s))


def merge_adjacent_holds(phases: Iterable[HandPhase]) -> list[HandPhase]:
    """Merge adjacent holds, which are annotated separately but cannot be distinguished."""
    joined: list[HandPhase] = []
    for phase in phases:
        if joined and joined[-1].phase == phase.phase == "hold":
            joined[-1] = replace(joined[-1], end_s=phase.end_s)
        else:
            joined.append(phase)
    return joined


def detection_counts_by_metric(
    detected: GesturePlan, annotated: GesturePlan
) -> dict[str, DetectionCounts]:
    """Count matches of a detected plan with an annotated one, by metric."""
    counts: defaultdict[str, DetectionCounts] = defaultdict(DetectionCounts)
    for side in SIDES:
        own, true = detected.hand(side), merge_adjacent_holds(annotated.hand(side))
        for phase in PHASES:
            one, other = ([p for p in phases if p.phase == phase] for phases in (own, true))
            counts[f"{phase}s"] += match_intervals(one, other)
            if phase == "stroke":
                ends = [p.end_s for p in one]
                counts["ends of strokes"] += match_points(
                    ends, [p.end_s for p in other], BOUNDARY_TOLERANCE_S
                )
        edges = [p.end_s for p in own[:-1]]
        counts["boundaries of phases"] += match_points(
            edges, [p.end_s for p in true[:-1]], BOUNDARY_TOLERANCE_S
        )
    counts["nods"] += match_points(
        [n.time_s for n in detected.nods],
        [n.time_s for n in annotated.nods],
        NOD_AND_BROW_TOLERANCE_S,
    )
    for name, sign in (("brows up", 1), ("frowns", -1)):
        ours = [b.time_s for b in detected.brows if sign * b.height > 0]
        theirs = [b.time_s for b in annotated.brows if sign * b.height > 0]
        counts[name] += match_points(ours, theirs, NOD_AND_BROW_TOLERANCE_S)
    counts["blinks"] += match_points(
        [b.time_s for b in detected.blinks],
        [b.time_s for b in annotated.blinks],
        BOUNDARY_TOLERANCE_S,
    )
    ours, theirs = ([s.start_s for s in p.stands if s.start_s > 0] for p in (detected, annotated))
    counts["shifts of weight"] += match_points(ours, theirs, SHIFT_S)
    return dict(counts)


def train_phase_network(folder: Path, names: Sequence[str], out: Path) -> None:
    """Train the phase network on clips, and write it for `model.plan.detection`."""
    torch.manual_seed(0)
    rng = np.random.default_rng(0)
    features, states, phases = [], [], []
    for name in tqdm(names, desc="clips"):
        plan, places = _recorded(folder, name)
        for side, other in (SIDES, SIDES[::-1]):
            features.append(hand_features(places[side], places[other]))
            states.append(_states(plan.hand(side), len(features[-1])))
            phases.append(_joined(plan.hand(side)))
    mean, std = np.concatenate(features).mean(0), np.concatenate(features).std(0)
    network = PhaseNetwork(len(mean))
    optimizer = torch.optim.AdamW(network.parameters(), RATE / 2, weight_decay=1e-3)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, RATE, total_steps=STEPS)
    long = [k for k, one in enumerate(features) if len(one) >= FRAMES]
    for _ in tqdm(range(STEPS), desc="steps"):
        x, y = zip(
            *(_drawn(features[k], states[k], std, rng) for k in rng.choice(long, BATCH)),
            strict=True,
        )
        scores = network(torch.from_numpy((np.stack(x) - mean) / std).float()).transpose(1, 2)
        loss = nn.functional.cross_entropy(
            scores, torch.from_numpy(np.stack(y)), label_smoothing=0.02
        )
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
    statistics = {"mean": mean, "std": std, **_duration_statistics(phases)}
    for name, tensor in network.state_dict().items():
        array = tensor.numpy().astype(np.float16)
        statistics[name.replace("inner.", "inner")] = (
            array[..., 0] if name == "last.weight" else array
        )
    with written_atomically(out) as part, part.open("wb") as file:
        np.savez_compressed(file, **statistics)


def _recorded(folder: Path, name: str):
    tracks = track_points(load_motion(folder / f"smplxflame_30/{name}.npz"), open_body_skeleton())
    plan = read_corpus_textgrid(folder / f"textgrid/{name}.TextGrid")
    return plan, wrist_positions_in_chest_frame(tracks)


def _states(phases: Sequence[HandPhase], num_frames: int) -> Int[np.ndarray, " T"]:
    states, time_s = np.zeros(num_frames, int), (np.arange(num_frames) + 0.5) / FPS
    for phase in phases:
        states[(time_s >= phase.start_s) & (time_s < phase.end_s)] = PHASES.index(phase.phase)
    return states


def _drawn(
    features: Float[np.ndarray, "T 10"],
    states: Int[np.ndarray, " T"],
    std: Float[np.ndarray, " 10"],
    rng: np.random.Generator,
) -> tuple[Float[np.ndarray, "n 10"], Int[np.ndarray, " n"]]:
    """Draw a stretch of a clip, scaled and shifted at random, because people differ."""
    first = int(rng.integers(0, len(features) - FRAMES + 1))
    wide = rng.uniform(0.7, 1.5)
    window = features[first : first + FRAMES].copy()
    window[:, [*range(7), 8]] *= wide  # places, velocities, speed, its gain
    window[:, 7] = np.log(window[:, 6] + 0.02)
    return window + rng.normal(0, 0.15, (1, 10)) * std, states[first : first + FRAMES]


def _joined(phases: Sequence[HandPhase]) -> list[tuple[int, float]]:
    """Return index and length (frames) of each phase, with equal neighbours merged."""
    joined: list[tuple[int, float]] = []
    for phase in phases:
        state, lasts = PHASES.index(phase.phase), FPS * (phase.end_s - phase.start_s)
        if joined and joined[-1][0] == state:
            joined[-1] = state, joined[-1][1] + lasts
        else:
            joined.append((state, lasts))
    return joined


def _duration_statistics(clips: Sequence[Sequence[tuple[int, float]]]) -> dict[str, np.ndarray]:
    """Compute the mean lengths of phases (frames) and the frequencies of their successors."""
    count = np.ones((len(PHASES), len(PHASES)))
    lasts: list[list[float]] = [[FPS / 2] for _ in PHASES]
    for phases in clips:
        for state, frames in phases:
            lasts[state].append(frames)
        for (one, _), (other, _) in pairwise(phases):
            count[one, other] += 1
    return {
        "next": (count / count.sum(axis=1, keepdims=True)).astype(np.float32),
        "frames": np.array([np.mean(one) for one in lasts], np.float32),
    }


def running_detection_scores(
    folder: Path, clips: int | None, trains_first: bool
) -> Iterator[dict[str, dict[str, float]]]:
    """Yield, after each clip, the scores of all clips so far by metric."""
    total: defaultdict[str, DetectionCounts] = defaultdict(DetectionCounts)
    speakers: defaultdict[str, DetectionCounts] = defaultdict(DetectionCounts)
    split = read_split(folder)
    if trains_first:
        learned = [name for name, of in split.items() if of == "train"][::FIT_EVERY]
        train_phase_network(folder, learned, WEIGHTS)
    for name in [name for name, of in split.items() if of == "test"][:clips]:
        motion = load_motion(folder / f"smplxflame_30/{name}.npz")
        annotated = read_corpus_textgrid(folder / f"textgrid/{name}.TextGrid")
        counts = detection_counts_by_metric(
            plan_from_motion(motion, open_body_skeleton()), annotated
        )
        for metric, one in counts.items():
            total[metric] += one
        speakers[parse_speaker(name)[1]] += counts["strokes"]
        by_speaker = {name: round(one.f1, 3) for name, one in sorted(speakers.items())}
        answers = {metric: one.as_json() for metric, one in total.items()}
        yield {**answers, "f1 of strokes": by_speaker}
