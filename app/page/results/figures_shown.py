"""The figures of a run on the page: each large on click, with its sentences and its files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from app import text
from app.findings.sentences import sentences_of
from app.page.parts import markup
from app.page.serving.media import MediaDesk
from app.run.request import Artefact

if TYPE_CHECKING:
    from model.measures.diagnostics import Diagnostics

_DOWNLOADS = ("png", "svg", "pdf")


class FiguresShown:
    """Collects the figures of one run as they become whole."""

    def __init__(self, desk: MediaDesk, visitor: str) -> None:
        self._desk = desk
        self._visitor = visitor
        self._urls: dict[str, dict[str, str]] = {}

    def take(self, artefact: Artefact) -> None:
        """Note a file; other kinds than figures are passed over."""
        if artefact.kind == "figure":
            ending = artefact.path.suffix.lstrip(".")
            url = self._desk.offer(artefact.path, self._visitor)
            self._urls.setdefault(artefact.path.stem, {})[ending] = url

    def take_files(self, paths: Iterable[Path]) -> None:
        """Note the figures among the files of a run."""
        for path in paths:
            if path.suffix in (".png", ".svg", ".pdf"):
                self.take(Artefact("figure", path.stem, path))

    def html(self, diagnostics: Diagnostics | None = None) -> str:
        """All figures so far; with their sentences once there are numbers."""
        sentences = sentences_of(diagnostics) if diagnostics else {}
        return "".join(
            _figure(stem, urls, sentences) for stem, urls in self._urls.items() if "png" in urls
        )


def _figure(stem: str, urls: Mapping[str, str], sentences: Mapping[str, str]) -> str:
    about = text.FIGURES.get(stem, text.FigureText(stem, "", ()))
    links = "".join(
        f'<a href="{escape(urls[ending])}" download="{escape(stem)}.{ending}">{ending.upper()}</a>'
        for ending in _DOWNLOADS
        if ending in urls
    )
    said = "".join(f"<p>{escape(sentences[key])}</p>" for key in about.says if sentences.get(key))
    return (
        f"{markup.heading(about.title, about.help)}"
        f'<figure class="plot"><button type="button" class="zoom" '
        f'aria-label="{text.ENLARGE_FIGURE.format(title=escape(about.title))}">'
        f'<img src="{escape(urls["png"])}" alt="{escape(about.title)}"></button>'
        f'<figcaption>{said}<p class="links">{links}</p></figcaption></figure>'
    )
