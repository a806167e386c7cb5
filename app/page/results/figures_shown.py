"""The figures of a run on the page: each large on click, with its sentences and its files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from copy import copy
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from app import text
from app.findings.sentences import sentences_of
from app.page.parts import markup
from app.page.parts.glossary import explained
from app.page.routes.media import MediaAddresses
from app.run.requests.request import Artefact

if TYPE_CHECKING:
    from model.diagnostics import Diagnostics

_DOWNLOADS = ("png", "svg", "pdf")


class FiguresShown:
    """Collects the figures of one run as they become whole."""

    def __init__(self, addresses: MediaAddresses, visitor: str) -> None:
        self._addresses = addresses
        self._visitor = visitor
        self._paths: dict[str, dict[str, Path]] = {}
        self._urls: dict[Path, str] = {}
        self._sentences: Mapping[str, str] = {}

    def take(self, artefact: Artefact) -> None:
        """Note a file; other kinds than figures are passed over."""
        if artefact.kind == "figure":
            ending = artefact.path.suffix.lstrip(".")
            self._paths.setdefault(artefact.path.stem, {})[ending] = artefact.path

    def take_files(self, paths: Iterable[Path]) -> None:
        """Note the figures among the files of a run."""
        for path in paths:
            if path.suffix in (".png", ".svg", ".pdf"):
                self.take(Artefact("figure", path.stem, path))

    def html(self, diagnostics: Diagnostics | None = None) -> str:
        """All figures so far; with their sentences once there are numbers."""
        if diagnostics:
            self._sentences = sentences_of(diagnostics)
        return "".join(
            _figure(stem, {each: self._url(path) for each, path in paths.items()}, self._sentences)
            for stem, paths in self._paths.items()
            if "png" in paths
        )

    def for_visitor(self, visitor: str) -> FiguresShown:
        """The same for another browser, under addresses of its own."""
        other = copy(self)
        other._visitor, other._urls = visitor, {}
        return other

    def _url(self, path: Path) -> str:
        if path not in self._urls:
            self._urls[path] = self._addresses.address(path, self._visitor)
        return self._urls[path]


def _figure(stem: str, urls: Mapping[str, str], sentences: Mapping[str, str]) -> str:
    about = text.FIGURES.get(stem, text.FigureText(stem, "", ()))
    links = "".join(
        f'<a href="{escape(urls[ending])}" download="{escape(stem)}.{ending}">{ending.upper()}</a>'
        for ending in _DOWNLOADS
        if ending in urls
    )
    said = "".join(
        f"<p>{explained(sentences[key])}</p>" for key in about.says if sentences.get(key)
    )
    return (
        f"{markup.heading(about.title, about.help)}"
        f'<figure class="plot"><button type="button" class="zoom" '
        f'aria-label="{text.ENLARGE_FIGURE.format(title=escape(about.title))}">'
        f'<img src="{escape(urls["png"])}" alt="{escape(about.title)}"></button>'
        f'<figcaption>{said}<p class="links">{links}</p></figcaption></figure>'
    )
