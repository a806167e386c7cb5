"""Pieces of HTML for the report; everything that comes in as text is escaped."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

from matplotlib.figure import Figure

from app.study.report.figures import svg_of
from app.study.report.text import NO_BREAK
from conventions.names import printable


def safe(text: str) -> str:
    """Anyone's text for a page."""
    return escape(NO_BREAK.join(map(printable, text.split(NO_BREAK))))


def figure_of(figure: Figure, name: str, description: str, caption: str = "") -> str:
    """An inline figure; ``name`` keeps its ids apart from those of others on the page."""
    below = f"<figcaption>{safe(caption)}</figcaption>" if caption else ""
    svg = svg_of(figure, name, description)
    return f'<div class="wide"><figure>{svg}{below}</figure></div>'


def table(
    caption: str, header: Sequence[str], rows: Iterable[Sequence[str]], names: int = 1
) -> str:
    """A table whose first ``names`` columns are names."""

    is_name = ' class="name"'

    def cells(tag: str, values: Sequence[str]) -> str:
        return "".join(
            f"<{tag}{is_name * (place < names)}>{safe(value)}</{tag}>"
            for place, value in enumerate(values)
        )

    lines = "".join(f"<tr>{cells('td', row)}</tr>" for row in rows)
    return (
        f'<div class="wide"><table><caption>{safe(caption)}</caption>'
        f"<thead><tr>{cells('th', header)}</tr></thead><tbody>{lines}</tbody></table></div>"
    )


def bullets(sentences: Iterable[str]) -> str:
    """A list of sentences."""
    return "<ul>" + "".join(f"<li>{safe(sentence)}</li>" for sentence in sentences) + "</ul>"
