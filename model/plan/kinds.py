"""Kinds of gestures: their usual hand positions, and the choice of a kind for a stroke.

A user chooses from the palette (`USUAL_STROKE_GOALS`). For a generated plan, a network decides when
and where hands move; the kind is then drawn from statistics of annotated plans (`KindTable`): how
often each speaker makes it, where its strokes end, whether both hands make it, and which words
trigger it. A kind determines the shape and orientation of the hand.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Shaped, UInt8

from conventions.rates import FPS
from model.plan.annotation_files import Interval
from model.plan.plan import GAP_S, SIDES, STILL_PHASES, GesturePlan, HandPhase, Side, fill_gaps

if TYPE_CHECKING:
    from torch import Tensor

Position = tuple[float, float, float]

REST_POSITION: Position = (0.25, -0.26, 0.25)
"""Usual rest position of a wrist: before the body."""
PREPARATION_OFFSET: Position = (-0.066, 0.005, -0.049)
"""Offset of the preparation's goal from the stroke's: nearer to the body."""
USUAL_STROKE_GOALS: Mapping[str, Position] = MappingProxyType({
    "all": (0.33, -0.08, 0.28), "arc": (0.33, -0.13, 0.30), "back": (0.30, 0.12, 0.20),
    "beat": (0.23, -0.20, 0.35), "big": (0.32, 0.00, 0.28), "brush": (0.26, -0.15, 0.32),
    "carry": (0.19, -0.09, 0.33), "chop": (0.19, -0.10, 0.36), "cup_both": (0.11, -0.13, 0.32),
    "dismiss": (0.31, -0.08, 0.36), "down": (0.24, -0.23, 0.36), "drive": (0.19, -0.05, 0.36),
    "five": (0.26, 0.08, 0.27), "forward": (0.18, 0.06, 0.40), "four": (0.20, 0.03, 0.28),
    "frame": (0.18, -0.09, 0.35), "here": (0.22, -0.18, 0.36), "item": (0.15, -0.13, 0.34),
    "knock": (0.17, -0.02, 0.38), "long": (0.31, -0.10, 0.30), "no": (0.26, -0.11, 0.31),
    "offer": (0.23, -0.15, 0.35), "offer_low": (0.28, -0.23, 0.32), "one": (0.24, 0.12, 0.28),
    "open_up": (0.25, -0.13, 0.32), "phone": (0.25, 0.30, 0.21), "point_up": (0.21, 0.12, 0.29),
    "precise": (0.17, 0.02, 0.32), "present": (0.24, -0.11, 0.34), "pull": (0.26, -0.07, 0.24),
    "quote": (0.24, 0.14, 0.27), "roll": (0.15, -0.13, 0.33), "round": (0.15, -0.18, 0.31),
    "self": (0.08, -0.03, 0.21), "set_down": (0.22, -0.19, 0.35), "shrug": (0.32, -0.12, 0.24),
    "small": (0.15, 0.09, 0.31), "small_both": (0.10, -0.08, 0.31), "stop": (0.20, 0.07, 0.38),
    "sweep": (0.34, -0.07, 0.30), "that_side": (0.34, -0.11, 0.32), "there": (0.41, 0.12, 0.28),
    "think": (0.22, 0.06, 0.31), "this_side": (0.35, -0.09, 0.33), "three": (0.26, 0.00, 0.27),
    "together": (0.13, -0.10, 0.32), "turn_out": (0.25, -0.10, 0.30), "two": (0.14, 0.09, 0.24),
    "up": (0.26, 0.17, 0.28), "wave_off": (0.28, -0.06, 0.32), "weigh": (0.24, -0.14, 0.32),
    "wow": (0.24, 0.31, 0.25), "you": (0.17, 0.01, 0.41), "you_open": (0.19, -0.08, 0.41),
})  # fmt: skip
"""Usual stroke end of each kind (medians in the corpus's annotation): out, up, forward."""
TWO_HANDED_KINDS = frozenset({
    "all", "big", "carry", "cup_both", "drive", "frame", "item", "long", "no", "open_up", "present",
    "quote", "roll", "round", "shrug", "small_both", "together", "weigh", "wow",
})  # fmt: skip
"""Kinds that both hands make together."""


def usual_stroke_goal(kind: str) -> Position:
    """Return the usual stroke end of a kind; a default for an unknown kind."""
    return USUAL_STROKE_GOALS.get(kind, USUAL_STROKE_GOALS["offer"])


def preparation_goal(goal: Position) -> Position:
    """Return the goal of the preparation for a stroke that ends at ``goal``."""
    return _moved(goal, PREPARATION_OFFSET)


def default_goal(phase: str, kind: str, before: Position) -> Position:
    """Return the default goal of a phase, given the goal of the phase before it."""
    if phase in ("rest", "retraction"):
        return REST_POSITION
    if phase == "preparation":
        return preparation_goal(usual_stroke_goal(kind))
    if phase == "stroke":
        return usual_stroke_goal(kind)
    if phase == "beat":
        return _moved(before, (0.0, -0.05, 0.01))
    return before


def _moved(place: Position, by: Position) -> Position:
    out, up, forward = (round(a + b, 4) for a, b in zip(place, by, strict=True))
    return out, up, forward


FOLLOW_BEATS = "follow"
"""Kind of small beats of the hand that does not make the gesture."""
BIMANUAL_TOLERANCE_S = 0.15
"""Largest time between strokes of both hands that count as one gesture (s)."""
BEFORE_WORD_S, AFTER_WORD_S = 0.25, 0.15
"""Tolerance for the end of a stroke before a word's start, and after its end (s)."""
MIN_WORD_COUNT, MIN_LIFT = 5, 3.0
"""Least count of a kind on a word, and ratio to its overall share, for the word to trigger it."""
USUAL_GOAL_WEIGHT = 0.65
"""Fraction by which a goal moves to the usual stroke end of a kind that a word triggered."""
PREPARATION_S, STROKE_S, HOLD_S, RETRACTION_S = 0.49, 0.31, 0.3, 0.8
"""Medians in the corpus's annotation (s); the hold's is of those before a retraction."""
STROKE_END_IN_WORD = 0.3
"""Default end of a stroke on a word, as a fraction of the word's duration."""
MIN_REST_S = 0.2
"""Shortest visible remainder of a rest or hold before or after a gesture (s)."""
_MIN_SPREAD_M = 0.03
_PRIOR_STROKES = 20
"""Number of strokes of all speakers that are added to those of each."""


@dataclass(frozen=True)
class GesturePhases:
    """A gesture of one hand: preparation, pre-stroke hold, strokes, holds and beats after them."""

    side: Side
    first_index: int
    """Index of its first phase among the hand's."""
    last_index: int
    """Index of its last phase."""
    last_stroke: HandPhase
    is_bimanual: bool = False
    """True if the other hand's stroke ends at the same time."""


@dataclass(frozen=True)
class KindTable:
    """Statistics of K kinds in annotated plans."""

    names: tuple[str, ...]
    shares_by_speaker: Float[np.ndarray, "speakers K"]
    """Smoothed share of each kind by speaker (speakers, K)."""
    mean_goals: Float[np.ndarray, "K 3"]
    goal_deviations: Float[np.ndarray, "K 3"]
    bimanual_shares: Float[np.ndarray, " K"]
    """Share of gestures of each kind (K,) that both hands make."""
    kind_shares_by_word: Mapping[str, Mapping[str, float]]
    """Share of each triggered kind among the strokes on a word, by word."""
    stroke_shares_by_word: Mapping[str, float] = field(default_factory=dict)
    """Share of a triggering word's occurrences with a stroke, by word."""

    @staticmethod
    def fit(
        plans: Iterable[tuple[GesturePlan, int]],
        num_speakers: int,
        word_counts: Mapping[str, int] = MappingProxyType({}),
    ) -> KindTable:
        """Fit to annotated plans with their speakers' numbers, and counts of words in all plans."""
        counts: defaultdict[int, Counter[str]] = defaultdict(Counter)
        goals: defaultdict[str, list[Position]] = defaultdict(list)
        both: Counter[str] = Counter()
        on_word: defaultdict[str, Counter[str]] = defaultdict(Counter)
        landed: Counter[str] = Counter()
        """Twice the number of gestures on each word: those of both hands count once."""
        kinds: set[str] = {FOLLOW_BEATS}
        for plan, speaker in plans:
            kinds |= {phase.kind for side in SIDES for phase in plan.hand(side)}
            for stroke in group_gesture_phases(plan):
                kind, word = stroke.last_stroke.kind, stroke.last_stroke.word
                counts[speaker][kind] += 1
                goals[kind].append(stroke.last_stroke.goal)
                both[kind] += stroke.is_bimanual
                if word:
                    on_word[word][kind] += 1
                    landed[word] += 1 if stroke.is_bimanual else 2
        names = tuple(sorted(kinds - {""}))
        total = sum(counts.values(), Counter())
        usual = np.array([total[n] + 0.5 * (n in goals) for n in names], float)
        usual /= usual.sum()
        shares = [
            (np.array([counts[n][name] for name in names]) + _PRIOR_STROKES * usual)
            / (counts[n].total() + _PRIOR_STROKES)
            for n in range(num_speakers)
        ]
        at = [np.array(goals[n]) if goals[n] else None for n in names]
        calls = _calls(on_word, dict(zip(names, usual, strict=True)))
        return KindTable(
            names,
            np.stack(shares),
            np.array([np.zeros(3) if g is None else g.mean(0) for g in at]),
            np.array([np.ones(3) if g is None else g.std(0).clip(_MIN_SPREAD_M) for g in at]),
            np.array([(both[n] + 0.5) / (len(goals[n]) + 1) for n in names]),
            calls,
            {
                word: min(1.0, landed[word] / 2 / word_counts[word])
                for word in calls
                if word in word_counts
            },
        )

    def number_or_zero(self, kind: str) -> int:
        """Return the number of a kind, from 1; 0 for none or an unknown one."""
        return self.names.index(kind) + 1 if kind in self.names else 0

    def to_tensors(self) -> dict[str, Tensor]:
        """Return the tensors to save with trained weights."""
        import torch

        words = sorted(self.kind_shares_by_word)
        called = [
            [self.kind_shares_by_word[word].get(name, 0.0) for name in self.names] for word in words
        ]
        arrays = {
            "by_speaker": self.shares_by_speaker, "goal": self.mean_goals,
            "spread": self.goal_deviations, "both": self.bimanual_shares,
            "called": np.array(called).reshape(len(words), len(self.names)),
        }  # fmt: skip
        texts = {"names": self.names, "words": words}
        struck = [self.stroke_shares_by_word.get(word, 0.0) for word in words]
        return {
            **{f"kinds.{name}": torch.tensor(list("\n".join(rows).encode()), dtype=torch.uint8)
               for name, rows in texts.items()},
            "kinds.struck": torch.tensor(struck),
            **{f"kinds.{name}": torch.from_numpy(np.asarray(array, np.float32))
               for name, array in arrays.items()},
        }  # fmt: skip

    @staticmethod
    def from_tensors(tensors: Mapping[str, Shaped[Tensor, " ..."]]) -> KindTable:
        """Make the table from the tensors of `to_tensors`; raises KeyError if one is missing."""
        names, words = (
            tuple(bytes(tensor.byte().tolist()).decode().split("\n")) if len(tensor) else ()
            for tensor in (tensors["kinds.names"], tensors["kinds.words"])
        )
        by_speaker, goal, spread, both, called = (
            tensors[f"kinds.{name}"].double().numpy()
            for name in ("by_speaker", "goal", "spread", "both", "called")
        )
        calls = {
            word: {names[k]: float(row[k]) for k in np.flatnonzero(row)}
            for word, row in zip(words, called, strict=True)
        }
        often = zip(words, tensors["kinds.struck"].tolist(), strict=True)
        struck = {word: share for word, share in often if share > 0}
        return KindTable(names, by_speaker, goal, spread, both, calls, struck)

    def sample_kinds(
        self, plan: GesturePlan, speaker: int, words: Sequence[Interval], rng: np.random.Generator
    ) -> GesturePlan:
        """Draw a kind for every gesture, and set the word of its stroke.

        A word triggers its kinds as often as in annotated plans; the goal then moves towards the
        kind's usual one.
        """
        hands = {side: list(plan.hand(side)) for side in SIDES}
        landed: dict[float, str] = {}
        for stroke in sorted(group_gesture_phases(plan), key=lambda one: one.last_stroke.end_s):
            lands = stroke.last_stroke
            word = _word_at(words, lands.end_s)
            partner = self.simultaneous_kind(landed, lands.end_s) if stroke.is_bimanual else ""
            called = partner or self._called(word, rng)
            kind = called or self.sample_kind(stroke, speaker, rng)
            landed[lands.end_s] = kind
            phases = hands[stroke.side]
            for k in range(stroke.first_index, stroke.last_index + 1):
                phases[k] = replace(phases[k], kind=kind)
            at = stroke.first_index + [p.end_s for p in phases[stroke.first_index :]].index(
                lands.end_s
            )
            goal = lands.goal
            if called and (not partner or self.kind_shares_by_word.get(word)):
                moved = np.asarray(goal) + USUAL_GOAL_WEIGHT * (self._usual_goal(kind) - goal)
                goal = (float(moved[0]), float(moved[1]), float(moved[2]))
            phases[at] = replace(phases[at], word=word, goal=goal)
        left, right = (
            tuple(
                replace(phase, kind=FOLLOW_BEATS)
                if phase.phase == "beat" and not phase.kind
                else phase
                for phase in hands[side]
            )
            for side in SIDES
        )
        return replace(plan, left=left, right=right)

    def add_word_strokes(
        self, plan: GesturePlan, words: Sequence[Interval], rng: np.random.Generator
    ) -> GesturePlan:
        """Add strokes on words that often have one, where hands are still.

        A planner with the sound alone has strokes on stressed words; some words have a gesture most
        of the time ("nobody", "again", "big") and get one as often as annotated speakers make it.
        Random numbers are drawn for every word, used or not, so that plans of one text share them.
        """
        hands = {side: list(fill_gaps(plan.hand(side), plan.duration_s)) for side in SIDES}
        has_changed = False
        for word in words:
            obeys, which, hand = rng.random(3)
            text = word.text.lower()
            if obeys >= self.stroke_shares_by_word.get(text, 0.0) or _has_stroke(plan, word):
                continue
            shares = self.kind_shares_by_word[text]
            kind = list(shares)[sample_index(np.array(list(shares.values())), which)]
            stroke_end_s = word.start_s + STROKE_END_IN_WORD * (word.end_s - word.start_s)
            is_both = self.bimanual_shares[self.names.index(kind)] > 0.5
            still = {side: _still_at(hands[side], stroke_end_s) for side in SIDES}
            free = [(side, k) for side, k in still.items() if k is not None]
            if not free or (is_both and len(free) < len(SIDES)):
                continue
            out, up, forward = self._usual_goal(kind).tolist()
            for side, k in free if is_both else [free[int(hand * len(free))]]:
                struck = _struck(hands[side][k], stroke_end_s, (out, up, forward), kind, text)
                hands[side][k : k + 1] = struck
                has_changed = True
        if not has_changed:
            return plan
        return replace(plan, left=tuple(hands["left"]), right=tuple(hands["right"]))

    @staticmethod
    def simultaneous_kind(kinds_by_end_s: Mapping[float, str], stroke_end_s: float) -> str:
        """Return the kind of the gesture that ends together with this one, or ""."""
        return next(
            (
                kind
                for at, kind in kinds_by_end_s.items()
                if abs(at - stroke_end_s) < BIMANUAL_TOLERANCE_S
            ),
            "",
        )

    def sample_kind(self, gesture: GesturePhases, speaker: int, rng: np.random.Generator) -> str:
        """Draw a kind by a gesture's goal and its speaker."""
        off = (np.asarray(gesture.last_stroke.goal) - self.mean_goals) / self.goal_deviations
        score = np.log(self.shares_by_speaker[speaker].clip(1e-9)) - np.log(
            self.goal_deviations
        ).sum(1)
        score -= 0.5 * (off**2).sum(1)
        both = self.bimanual_shares.clip(1e-3, 1 - 1e-3)
        score += np.log(both if gesture.is_bimanual else 1 - both)
        share = np.exp(score - score.max())
        return self.names[int(rng.choice(len(share), p=share / share.sum()))]

    def _called(self, word: str, rng: np.random.Generator) -> str:
        chance = rng.random()
        for kind, share in self.kind_shares_by_word.get(word, {}).items():
            chance -= share
            if chance < 0:
                return kind
        return ""

    def _usual_goal(self, kind: str) -> Float[np.ndarray, 3]:
        return self.mean_goals[self.names.index(kind)]


def sample_index(shares: Float[np.ndarray, " K"], uniform: float) -> int:
    """Return the index that a random number from 0 to 1 selects by unnormalised shares."""
    edges = np.cumsum(shares.astype(np.float64))
    return int(min(np.searchsorted(edges, uniform * edges[-1], side="right"), len(edges) - 1))


def group_gesture_phases(plan: GesturePlan) -> list[GesturePhases]:
    """Return the gestures of both hands, after Kita et al. (1998).

    A gesture is its preparation, the hold before its stroke, the stroke, and the holds and beats
    after it. Strokes in direct succession are one gesture, unless their kinds differ; a gap between
    them is a hold (`fill_gaps`), after which another gesture begins.
    """
    strokes: list[GesturePhases] = []
    for side in SIDES:
        phases = plan.hand(side)
        k = 0
        while k < len(phases):
            if phases[k].phase not in ("preparation", "stroke"):
                k += 1
                continue
            first = k
            while k < len(phases) and phases[k].phase == "preparation":
                k += 1
            while k < len(phases) and phases[k].phase == "hold":
                k += 1
            lands = k
            while k < len(phases) and phases[k].phase == "stroke":
                if k > lands and _are_separate(phases[lands], phases[k]):
                    break
                lands, k = k, k + 1
            while k < len(phases) and phases[k].phase in ("hold", "beat"):
                k += 1
            if lands < len(phases) and phases[lands].phase == "stroke":
                strokes.append(GesturePhases(side, first, k - 1, phases[lands]))
    ends = {
        side: np.array([s.last_stroke.end_s for s in strokes if s.side == side]) for side in SIDES
    }

    def meets(stroke: GesturePhases) -> bool:
        other = ends[SIDES[1 - SIDES.index(stroke.side)]]
        return bool(
            len(other) and np.abs(other - stroke.last_stroke.end_s).min() < BIMANUAL_TOLERANCE_S
        )

    return [replace(stroke, is_bimanual=meets(stroke)) for stroke in strokes]


def _are_separate(stroke: HandPhase, then: HandPhase) -> bool:
    """Check whether two strokes without another phase between them are two gestures."""
    differ = bool(stroke.kind and then.kind) and stroke.kind != then.kind
    return differ or then.start_s - stroke.end_s > GAP_S


def kind_numbers(plan: GesturePlan, num_frames: int, table: KindTable) -> UInt8[np.ndarray, "T 2"]:
    """Return the number of the gesture type of each hand in each frame whose centre it covers."""
    kinds = np.zeros((num_frames, 2), np.uint8)
    for column, side in enumerate(SIDES):
        for phase in plan.hand(side):
            ends_s = phase.start_s, phase.end_s
            first, stop = (max(0, int(np.ceil(end_s * FPS - 0.5))) for end_s in ends_s)
            kinds[first:stop, column] = table.number_or_zero(phase.kind)
    return kinds


def _calls(
    on_word: Mapping[str, Counter[str]], usual: Mapping[str, float]
) -> dict[str, dict[str, float]]:
    calls = {}
    for word, counts in on_word.items():
        shares = {
            kind: count / counts.total()
            for kind, count in counts.items()
            if count >= MIN_WORD_COUNT and count / counts.total() > MIN_LIFT * usual[kind]
        }
        if shares:
            calls[word] = shares
    return calls


def _word_at(words: Sequence[Interval], time_s: float) -> str:
    near = [word for word in words if _is_on(word, time_s)]
    nearest = min(near, key=lambda w: abs(0.5 * (w.start_s + w.end_s) - time_s), default=None)
    return "" if nearest is None else nearest.text.lower()


def _is_on(word: Interval, time_s: float) -> bool:
    return word.start_s - BEFORE_WORD_S <= time_s <= word.end_s + AFTER_WORD_S


def _has_stroke(plan: GesturePlan, word: Interval) -> bool:
    return any(
        phase.phase == "stroke" and _is_on(word, phase.end_s)
        for side in SIDES
        for phase in plan.hand(side)
    )


def _still_at(phases: Sequence[HandPhase], stroke_end_s: float) -> int | None:
    """Return the rest or hold with room for preparation, stroke and a short hold around a time."""
    begins_s = stroke_end_s - STROKE_S - PREPARATION_S - MIN_REST_S
    for k, phase in enumerate(phases):
        if phase.start_s <= begins_s and stroke_end_s + HOLD_S <= phase.end_s:
            return k if phase.phase in STILL_PHASES else None
    return None


def _struck(
    old: HandPhase, stroke_end_s: float, goal: Position, kind: str, word: str
) -> list[HandPhase]:
    """Insert a stroke into a rest or hold, and return the new phases with the remainder."""
    strikes_s, readies_s = stroke_end_s - STROKE_S, stroke_end_s - STROKE_S - PREPARATION_S
    out, up, forward = (at + off for at, off in zip(goal, PREPARATION_OFFSET, strict=True))
    new = [
        replace(old, end_s=readies_s),
        HandPhase(readies_s, strikes_s, "preparation", (out, up, forward), kind),
        HandPhase(strikes_s, stroke_end_s, "stroke", goal, kind, word),
    ]
    retracts_s = stroke_end_s + HOLD_S
    rests_s = retracts_s + RETRACTION_S
    if old.phase != "rest" or rests_s + MIN_REST_S > old.end_s:
        return [*new, HandPhase(stroke_end_s, old.end_s, "hold", goal, kind)]
    return [
        *new,
        HandPhase(stroke_end_s, retracts_s, "hold", goal, kind),
        HandPhase(retracts_s, rests_s, "retraction", old.goal, kind),
        replace(old, start_s=rests_s),
    ]
