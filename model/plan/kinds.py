"""Which gesture a stroke is: told by where it ends, who makes it, and the word it lands on.

A network draws when hands move and where to; the kind is drawn after it from what the annotated
plans show: how often each speaker makes it, where its strokes end, whether both hands make it, and
which words call for it. A kind decides the shape and turn of the hand.
"""

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from conventions.joints import JOINT_INDEX
from model.motion.tracks import Tracks
from model.plan.plan import SIDES, GesturePlan, HandPhase, Side

NO_KIND = ""
FOLLOWING = "follow"
"""Small beats of the hand that takes no part."""
TOGETHER_S = 0.15
"""Strokes of both hands that end so close together are one gesture."""
BEFORE_WORD_S, AFTER_WORD_S = 0.25, 0.15
"""A stroke that ends so long before a word begins, or after it ends, still lands on it."""
LEAST_CALLS, LEAST_LIFT = 5, 3.0
"""A word calls for a kind that landed on it so often, and so much more than on any word."""
FAITH = 0.65
"""How far a goal moves to where strokes of the kind that a word called for usually end."""
_MIN_SPREAD_M = 0.03


@runtime_checkable
class Spoken(Protocol):
    """A word with its times."""

    @property
    def start_s(self) -> float: ...
    @property
    def end_s(self) -> float: ...
    @property
    def text(self) -> str: ...


@dataclass(frozen=True)
class Stroke:
    """Where a gesture of one hand lands: the last of its strokes."""

    side: Side
    first: int
    """Its first phase among the hand's."""
    last: int
    """The last phase that belongs to it."""
    lands: HandPhase
    both: bool = False
    """The other hand lands with it."""


@dataclass(frozen=True)
class KindTable:
    """What annotated plans show of kinds; K of them."""

    names: tuple[str, ...]
    by_speaker: Float[np.ndarray, "speakers K"]
    """Shares, smoothed; row 0 is everybody's."""
    goal: Float[np.ndarray, "K 3"]
    spread: Float[np.ndarray, "K 3"]
    both: Float[np.ndarray, " K"]
    """Share that both hands make together."""
    calls: Mapping[str, Mapping[str, float]]
    """By word, the share of strokes on it that are of a kind it calls for."""
    struck: Mapping[str, float] = field(default_factory=dict)
    """By such a word, how often a stroke lands on it when it is said."""

    @staticmethod
    def fit(
        plans: Iterable[tuple[GesturePlan, int]],
        num_speakers: int,
        said: Mapping[str, int] = MappingProxyType({}),
    ) -> "KindTable":
        """From annotated plans, each with its speaker's number.

        Args:
            said: how often each word is said in all of them.
        """
        counts: defaultdict[int, Counter[str]] = defaultdict(Counter)
        goals: defaultdict[str, list[tuple[float, float, float]]] = defaultdict(list)
        both: Counter[str] = Counter()
        on_word: defaultdict[str, Counter[str]] = defaultdict(Counter)
        landed: defaultdict[str, float] = defaultdict(float)
        names: set[str] = {FOLLOWING}
        for plan, speaker in plans:
            names |= {phase.kind for side in SIDES for phase in plan.hand(side)}
            for stroke in strokes_of(plan):
                kind = stroke.lands.kind
                counts[speaker][kind] += 1
                goals[kind].append(stroke.lands.goal)
                both[kind] += stroke.both
                if stroke.lands.word:
                    on_word[stroke.lands.word][kind] += 1
                    landed[stroke.lands.word] += 0.5 if stroke.both else 1.0
        ordered = tuple(sorted(names - {NO_KIND}))
        total = sum(counts.values(), Counter())
        everybody = np.array([total[name] for name in ordered], float) + 0.5 * np.array(
            [name in goals for name in ordered]
        )
        everybody /= everybody.sum()
        shares = np.stack(
            [
                (np.array([counts[n][name] for name in ordered]) + 20 * everybody)
                / (counts[n].total() + 20)
                for n in range(num_speakers)
            ]
        )
        calls = _calls(on_word, dict(zip(ordered, everybody, strict=True)))
        return KindTable(
            names=ordered,
            by_speaker=shares,
            goal=np.array(
                [np.mean(goals[n], axis=0) if goals[n] else np.zeros(3) for n in ordered]
            ),
            spread=np.array(
                [
                    np.std(goals[n], axis=0).clip(_MIN_SPREAD_M) if goals[n] else np.ones(3)
                    for n in ordered
                ]
            ),
            both=np.array([(both[n] + 0.5) / (len(goals[n]) + 1) for n in ordered]),
            calls=calls,
            struck={word: min(1.0, landed[word] / said[word]) for word in calls if word in said},
        )

    def place(self, kind: str) -> int:
        """The number of a kind from 1 on; 0 is none, or one that is not known."""
        return self.names.index(kind) + 1 if kind in self.names else 0

    def tensors(self) -> dict[str, Tensor]:
        """What weights carry of it."""
        words = sorted(self.calls)
        called = np.zeros((len(words), len(self.names)), np.float32)
        for row, word in enumerate(words):
            for kind, share in self.calls[word].items():
                called[row, self.names.index(kind)] = share
        return {
            "kinds.names": _as_tensor(self.names),
            "kinds.words": _as_tensor(words),
            "kinds.struck": torch.tensor([self.struck.get(word, 0.0) for word in words]),
            **{
                f"kinds.{name}": torch.from_numpy(np.asarray(array, np.float32))
                for name, array in {
                    "by_speaker": self.by_speaker,
                    "goal": self.goal,
                    "spread": self.spread,
                    "both": self.both,
                    "called": called,
                }.items()
            },
        }

    @staticmethod
    def of_tensors(tensors: Mapping[str, Tensor]) -> "KindTable":
        """The inverse of `tensors`.

        Raises:
            KeyError: if one is missing.
        """
        names, words = (_as_names(tensors[f"kinds.{name}"]) for name in ("names", "words"))
        by_speaker, goal, spread, both, called = (
            tensors[f"kinds.{name}"].double().numpy()
            for name in ("by_speaker", "goal", "spread", "both", "called")
        )
        calls = {
            word: {names[k]: float(row[k]) for k in np.flatnonzero(row)}
            for word, row in zip(words, called, strict=True)
        }
        often = tensors["kinds.struck"].tolist()
        struck = {word: share for word, share in zip(words, often, strict=True) if share > 0}
        return KindTable(names, by_speaker, goal, spread, both, calls, struck)

    def drawn(
        self,
        plan: GesturePlan,
        speaker: int,
        words: Sequence[Spoken],
        rng: np.random.Generator,
    ) -> GesturePlan:
        """The plan with a kind for every gesture, and the words that its strokes land on; a word
        that calls for a kind gets it as often as people obey it, and the goal moves there."""
        hands = {side: list(plan.hand(side)) for side in SIDES}
        landed: dict[float, str] = {}
        for stroke in sorted(strokes_of(plan), key=lambda one: one.lands.end_s):
            lands = stroke.lands
            word = _word_at(words, lands.end_s)
            partner = self.partner(landed, lands.end_s)
            called = self._called(word, rng) if not (stroke.both and partner) else partner
            kind = called or self.likely(stroke, speaker, rng)
            landed[lands.end_s] = kind
            phases = hands[stroke.side]
            for k in range(stroke.first, stroke.last + 1):
                phases[k] = replace(phases[k], kind=kind)
            at = stroke.first + [p.end_s for p in phases[stroke.first :]].index(lands.end_s)
            goal = lands.goal
            if called and not (stroke.both and partner and not self.calls.get(word)):
                usual = self.goal[self.names.index(kind)]
                moved = np.asarray(goal) + FAITH * (usual - goal)
                goal = (float(moved[0]), float(moved[1]), float(moved[2]))
            phases[at] = replace(phases[at], word=word, goal=goal)
        for side in SIDES:
            hands[side] = [
                replace(phase, kind=FOLLOWING)
                if phase.phase == "beat" and not phase.kind
                else phase
                for phase in hands[side]
            ]
        return replace(plan, left=tuple(hands["left"]), right=tuple(hands["right"]))

    @staticmethod
    def partner(landed: Mapping[float, str], lands_s: float) -> str:
        """Of gestures by when they land, the kind of one that lands with this; empty if none."""
        return next((kind for at, kind in landed.items() if abs(at - lands_s) < TOGETHER_S), "")

    def _called(self, word: str, rng: np.random.Generator) -> str:
        shares = self.calls.get(word, {})
        chance = rng.random()
        for kind, share in shares.items():
            chance -= share
            if chance < 0:
                return kind
        return NO_KIND

    def likely(self, stroke: Stroke, speaker: int, rng: np.random.Generator) -> str:
        """A kind by where a gesture ends and whose it is."""
        off = (np.asarray(stroke.lands.goal) - self.goal) / self.spread
        score = np.log(self.by_speaker[speaker].clip(1e-9)) - np.log(self.spread).sum(1)
        score -= 0.5 * (off**2).sum(1)
        both = self.both.clip(1e-3, 1 - 1e-3)
        score += np.log(both if stroke.both else 1 - both)
        share = np.exp(score - score.max())
        return self.names[int(rng.choice(len(share), p=share / share.sum()))]


def drawn_by(shares: Float[np.ndarray, " K"], chance: float) -> int:
    """Which of some, by their shares (of any sum) and a chance from 0 to 1."""
    edges = np.cumsum(shares.astype(np.float64))
    return int(min(np.searchsorted(edges, chance * edges[-1], side="right"), len(edges) - 1))


def strokes_of(plan: GesturePlan) -> list[Stroke]:
    """The gestures of both hands: preparation and strokes, with the holds and beats after them."""
    found: list[Stroke] = []
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
            lands = k
            while k < len(phases) and phases[k].phase == "stroke":
                lands, k = k, k + 1
            while k < len(phases) and phases[k].phase in ("hold", "beat"):
                k += 1
            if lands < len(phases) and phases[lands].phase == "stroke":
                found.append(Stroke(side, first, k - 1, phases[lands]))
    ends = {side: np.array([s.lands.end_s for s in found if s.side == side]) for side in SIDES}

    def meets(stroke: Stroke) -> bool:
        other = ends[SIDES[1 - SIDES.index(stroke.side)]]
        return bool(len(other) and np.abs(other - stroke.lands.end_s).min() < TOGETHER_S)

    return [replace(stroke, both=meets(stroke)) for stroke in found]


def _calls(
    on_word: Mapping[str, Counter[str]], usual: Mapping[str, float]
) -> dict[str, dict[str, float]]:
    calls = {}
    for word, counts in on_word.items():
        shares = {
            kind: count / counts.total()
            for kind, count in counts.items()
            if count >= LEAST_CALLS and count / counts.total() > LEAST_LIFT * usual[kind]
        }
        if shares:
            calls[word] = shares
    return calls


def _word_at(words: Sequence[Spoken], time_s: float) -> str:
    near = [
        word
        for word in words
        if word.start_s - BEFORE_WORD_S <= time_s <= word.end_s + AFTER_WORD_S
    ]
    nearest = min(
        near, key=lambda word: abs(0.5 * (word.start_s + word.end_s) - time_s), default=None
    )
    return "" if nearest is None else nearest.text.lower()


def _as_tensor(names: Sequence[str]) -> Tensor:
    return torch.tensor(list("\n".join(names).encode()), dtype=torch.uint8)


def _as_names(tensor: Tensor) -> tuple[str, ...]:
    return tuple(bytes(tensor.byte().tolist()).decode().split("\n")) if len(tensor) else ()


OUTWARD: dict[Side, tuple[float, float, float]] = {
    "left": (1.0, 1.0, 1.0),
    "right": (-1.0, 1.0, 1.0),
}
"""What turns the chest's axes into out, up and forward, and back."""


def wrist_places(tracks: Tracks) -> dict[Side, Float[np.ndarray, "T 3"]]:
    """Metres from the chest joint in the chest's frame: out to the hand's own side, up, forward."""
    chest = JOINT_INDEX["spine3"]
    turned = tracks.global_rot[:, chest].astype(np.float64)
    places: dict[Side, Float[np.ndarray, "T 3"]] = {}
    for side in SIDES:
        off = tracks.joints[:, JOINT_INDEX[f"{side}_wrist"]] - tracks.joints[:, chest]
        places[side] = np.einsum("tij,ti->tj", turned, off) * np.array(OUTWARD[side])
    return places
