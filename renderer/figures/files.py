"""Writing figures as PNG, SVG and PDF, under one set of matplotlib's settings.

matplotlib is imported at the first figure, and without pyplot: no windows, no global list of
figures. Figures are made one at a time, because matplotlib's settings belong to the process. The
same input gives the same bytes: no dates, a fixed salt for the names inside the SVG.
"""

import os
import threading
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from conventions.names import printable
from renderer.figures.style import PNG_DPI, RC_PARAMS, VECTOR_DPI

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MATPLOTLIB_LOCK = threading.RLock()


class FigureError(ValueError):
    """A figure cannot be made from what was given; the message says why."""


class FigureFiles(NamedTuple):
    """Where a figure was written."""

    png: Path
    svg: Path
    pdf: Path


@contextmanager
def matplotlib_settings() -> Iterator[None]:
    """matplotlib with its defaults and the figures' settings, for one thread at a time."""
    from matplotlib import style

    with _MATPLOTLIB_LOCK, style.context(["default", RC_PARAMS]):
        yield


def write_figure(figure: "Figure", out_stem: Path, description: str) -> FigureFiles:
    """Write a figure in all three formats, without dates; call under ``matplotlib_settings``."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.backends.backend_pdf import FigureCanvasPdf
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    _make_printable(figure)
    description = printable(description)
    out_stem = Path(out_stem)
    out_stem.parent.mkdir(parents=True, exist_ok=True)
    files = FigureFiles(*(out_stem.with_name(f"{out_stem.name}.{e}") for e in FigureFiles._fields))
    unfinished = FigureFiles(*(_temporary_name(path) for path in files))
    try:
        FigureCanvasAgg(figure).print_figure(
            unfinished.png, dpi=PNG_DPI, metadata={"Description": description}
        )
        FigureCanvasSVG(figure).print_figure(
            unfinished.svg, dpi=VECTOR_DPI, metadata={"Date": None, "Description": description}
        )
        FigureCanvasPdf(figure).print_figure(
            unfinished.pdf, dpi=VECTOR_DPI, metadata={"CreationDate": None, "Subject": description}
        )
        for source, target in zip(unfinished, files, strict=True):
            os.replace(source, target)
    finally:
        for path in unfinished:
            path.unlink(missing_ok=True)
    return files


def _make_printable(figure: "Figure") -> None:
    """No text of a figure may break the SVG that it is written to, or turn what is around it."""
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        assert isinstance(text, Text)
        text.set_text("\n".join(map(printable, text.get_text().split("\n"))))


def _temporary_name(path: Path) -> Path:
    """A free name in the same folder that keeps the extension."""
    return path.with_name(f".{path.stem}.{uuid.uuid4().hex}{path.suffix}")
