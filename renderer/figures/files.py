"""Writing figures as PNG, SVG and PDF with a caption beside, under one set of settings.

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
from renderer.figures.style import DPI, RC_PARAMS

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
    txt: Path
    """Its caption, which stands beside a figure and not in it."""


@contextmanager
def matplotlib_settings() -> Iterator[None]:
    """matplotlib with its defaults and the figures' settings, for one thread at a time."""
    from matplotlib import style

    with _MATPLOTLIB_LOCK, style.context(["default", RC_PARAMS]):
        yield


def write_figure(figure: "Figure", out_stem: Path, caption: str) -> FigureFiles:
    """Write ``<out_stem>.png``, ``.svg`` and ``.pdf``, without dates, and the caption as ``.txt``,
    in a folder that is made: each whole or not at all. Call under ``matplotlib_settings``."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.backends.backend_pdf import FigureCanvasPdf
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    _make_printable(figure)
    caption = printable(caption)
    out_stem = Path(out_stem)
    out_stem.parent.mkdir(parents=True, exist_ok=True)
    files = FigureFiles(*(out_stem.with_name(f"{out_stem.name}.{e}") for e in FigureFiles._fields))
    unfinished = FigureFiles(*(_temporary_name(path) for path in files))
    figure.set_dpi(DPI)
    _settle(figure)
    try:
        FigureCanvasAgg(figure).print_figure(
            unfinished.png, dpi=DPI, metadata={"Description": caption}
        )
        FigureCanvasSVG(figure).print_figure(
            unfinished.svg, dpi=DPI, metadata={"Date": None, "Description": caption}
        )
        FigureCanvasPdf(figure).print_figure(
            unfinished.pdf, dpi=DPI, metadata={"CreationDate": None, "Subject": caption}
        )
        unfinished.txt.write_text(f"{caption}\n", "utf-8")
        for source, target in zip(unfinished, files, strict=True):
            os.replace(source, target)
    finally:
        for path in unfinished:
            path.unlink(missing_ok=True)
    return files


def _settle(figure: "Figure") -> None:
    """Find all places once: in each format everything stands at the same."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    FigureCanvasAgg(figure).get_renderer()
    if (engine := figure.get_layout_engine()) is not None:
        engine.execute(figure)
        figure.set_layout_engine(None)


def _make_printable(figure: "Figure") -> None:
    """No text of a figure may break the SVG that it is written to, or turn what is around it."""
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        assert isinstance(text, Text)
        text.set_text("\n".join(map(printable, text.get_text().split("\n"))))


def _temporary_name(path: Path) -> Path:
    """A free name in the same folder that keeps the extension."""
    return path.with_name(f".{path.stem}.{uuid.uuid4().hex}{path.suffix}")
