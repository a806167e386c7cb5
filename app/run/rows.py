"""The motions of one run, generated or given, and what is known of them before they are
measured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.run.ask import MAX_COMPARED
from app.run.followed_point import TipSource
from app.run.output.telling import Reporter
from conventions.names import REFERENCE_NAME, SampleName

if TYPE_CHECKING:
    import numpy as np

    from model.formats.read import Reading
    from model.generation.base import Windowing
    from model.motion.motion import Motion
    from renderer.body.body import Body


@dataclass(frozen=True)
class Rows:
    """All by name, the reference last."""

    measured: Mapping[str, Motion]
    staged: Mapping[str, Motion]
    """As the stage plays them: of the given no more than fit, laid onto each other; of the
    generated behind the filter."""
    drawn: Mapping[str, Motion]
    """As figures have them: no more than fit."""
    timeline: dict[str, Any]
    body: Body
    tip: TipSource
    sound: Path | None
    """Of videos; None where there is no speech."""
    onsets_s: np.ndarray | None
    windows: Mapping[str, Windowing]
    """How each was cut, where that is known."""
    heard: np.ndarray | None = None
    """Of the speech frame by frame, for how late given motions are."""
    mean_speeds: np.ndarray | None = None
    notes: tuple[str, ...] = ()
    """Of reading the given ones; they go to the numbers."""
    readings: Mapping[str, Reading] = field(default_factory=dict)
    """Of the given."""
    origin: Mapping[str, Any] = field(default_factory=dict)
    """What made the generated, for the record."""

    @property
    def is_made(self) -> bool:
        return bool(self.origin)


def names_that_fit(names: list[str], reporter: Reporter) -> list[str]:
    """All, or where they are too many the first sample of each system and the reference."""
    if len(names) <= MAX_COMPARED:
        return names
    reference = [name for name in names if name == REFERENCE_NAME]
    first = [name for name in names if name not in reference and SampleName.parse(name).number == 1]
    fitting = [*first[: MAX_COMPARED - len(reference)], *reference]
    reporter.note(
        f"Comparison and figure hold at most {MAX_COMPARED} motions; they show "
        f"{', '.join(fitting)}."
    )
    return fitting
