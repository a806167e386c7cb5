"""How a family is explained to a person: its ladder of systems, and what its paper claims."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ExplainedSystem:
    """A system that adds one thing to the one before."""

    system: str
    adds: str
    meaning: str
    equation: str
    """In TeX, without the signs of HTML."""
    source: str
    look_for: str


@dataclass(frozen=True)
class Beside:
    """A system that stands beside the ladder."""

    system: str
    title: str
    meaning: str


@dataclass(frozen=True)
class Ladder:
    """Systems that differ by one thing each, from the first to the last."""

    title: str
    introduction: str
    rungs: tuple[ExplainedSystem, ...]
    beside: tuple[Beside, ...] = ()

    @property
    def systems(self) -> tuple[str, ...]:
        """All that it explains."""
        return tuple(each.system for each in (*self.rungs, *self.beside))


@dataclass(frozen=True)
class Claim:
    """What a paper says of the jerk of its systems, which is held against every run."""

    sentence: str
    """That systems of ``less`` jerk less than ``more``, in words that follow "the paper's claim,
    that"."""
    more: str
    less: tuple[str, ...]
    plain: str
    full: str
    """As ``plain`` with all that the paper adds: it should jerk no more."""
    added: str
    """What that is, as the subject of a sentence within one that has named ``full``."""
