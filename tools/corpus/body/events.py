"""What trunk, face and legs do and when, as their curves are made from it; for the annotation."""

from dataclasses import dataclass

from model.plan.plan import Look, Nod, Smile, Stand
from tools.corpus.words.prosody import Span


@dataclass(frozen=True)
class BrowMove:
    """Brows go up, or for a height below 0 into a frown, and back as a Gaussian."""

    time_s: float
    height: float
    """At the peak, 0 to 1."""
    width_s: float
    """Standard deviation."""


@dataclass(frozen=True)
class Blink:
    """Lids are shut at ``time_s``; ``duration_s`` is how long they are half shut or more."""

    time_s: float
    duration_s: float


@dataclass(frozen=True)
class BodyEvents:
    """Everything of one clip that is not a hand's."""

    nods: tuple[Nod, ...]
    gaze: tuple[Look, ...]
    brows: tuple[BrowMove, ...]
    smiles: tuple[Smile, ...]
    blinks: tuple[Blink, ...]
    stances: tuple[Stand, ...]
    steps: dict[str, tuple[Span, ...]]
    """By side: while the foot is in the air."""
