"""Components that show the results of a run in a tab, and HTML of figures and files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from html import escape
from pathlib import Path
from typing import Any, get_args

import gradio as gr

from app import text
from app.page.parts import markup
from app.page.parts.markup import add_tooltips, html_hidden_if_empty, player_component
from app.page.routes.media import FileToUrl
from app.run.requests.parts import FIGURE_PANELS, FigureWidth
from renderer.figures.style import CONTENTS_SUFFIX, FIGURE_FORMATS


class ResultParts:
    """Result components of one tab; empty ones are hidden."""

    def __init__(self, prefix: str = "", ready: str = text.READY) -> None:
        self.message = html_hidden_if_empty(prefix + "message")
        self.status = gr.HTML(markup.idle_status(ready), elem_id=prefix + "status")
        self.clips = gr.HTML("", visible=False, apply_default_css=False, elem_id=prefix + "clips")
        """Table over several clips."""
        self.clip = gr.Radio([], label="Shown below", visible=False, elem_id=prefix + "clip")
        """Selection of the clip shown below, by the token of its run."""
        self.verdict = html_hidden_if_empty(prefix + "verdict")
        self.player = player_component(prefix)
        with gr.Row(elem_classes="seen-video"):
            self.viewer_video = html_hidden_if_empty(prefix + "seen")
            """Progress of recording the viewer as a video, then the link to the video."""
            how: dict[str, Any] = {"visible": False, "size": "sm", "scale": 0, "min_width": 90}
            self.viewer_video_cancel = gr.Button(text.CANCEL, elem_id=prefix + "seen-cancel", **how)
        self.viewer_video_start = gr.Button(elem_classes="seen-start told-elsewhere")
        """Hidden button clicked by the viewer."""
        self.take_start = gr.Button(elem_classes="take-start told-elsewhere")
        """Hidden button clicked by the plan editor."""
        self.figures = html_hidden_if_empty(prefix + "figures", part="figures")
        self.numbers = html_hidden_if_empty(
            prefix + "numbers", "measures.js", "mountMeasures", "numbers"
        )
        self.downloads = html_hidden_if_empty(prefix + "downloads", part="files")
        self.runs = html_hidden_if_empty(prefix + "runs", "runs.js", "mountRuns")
        """Link to the opened run, and list of the visitor's own."""

    @property
    def all(self) -> list[Any]:
        return [*vars(self).values()]


NO_SENTENCES: Mapping[str, str] = {}


def figures_html(
    files: Iterable[Path], to_url: FileToUrl, sentences: Mapping[str, str] = NO_SENTENCES
) -> str:
    """Format the figures among some files, each with the findings of the metrics."""
    figures: dict[str, dict[str, Path]] = {}
    for path in files:
        stem, _, ending = path.name.rpartition(".")
        if path.name.endswith(CONTENTS_SUFFIX):
            stem, ending = path.name.removesuffix(CONTENTS_SUFFIX), CONTENTS_SUFFIX
        figures.setdefault(stem, {})[ending] = path
    shown = "".join(
        _figure(
            stem,
            _addresses(paths, to_url),
            sentences,
            paths["txt"].read_text("utf-8") if "txt" in paths else "",
            to_url(paths[CONTENTS_SUFFIX]) if CONTENTS_SUFFIX in paths else "",
        )
        for stem, paths in figures.items()
        if "png" in paths
    )
    return f'<div class="figures">{shown}</div>' if shown else ""


def _addresses(paths: Mapping[str, Path], to_url: FileToUrl) -> dict[str, str]:
    """Return the URL of a figure in each format; missing formats are drawn on request."""
    urls = {form: to_url(paths[form]) for form in FIGURE_FORMATS if form in paths}
    if CONTENTS_SUFFIX in paths:
        contents = to_url(paths[CONTENTS_SUFFIX])
        urls |= {form: f"{contents}&as={form}" for form in FIGURE_FORMATS if form not in paths}
    return urls


def _figure(
    stem: str, urls: Mapping[str, str], sentences: Mapping[str, str], caption: str, contents: str
) -> str:
    about = text.FIGURES.get(stem, text.FigureText(stem, "", ()))
    links = "".join(download_link(url, f"{stem}.{end}", end.upper()) for end, url in urls.items())
    captions = "".join(
        f"<p>{add_tooltips(sentences[key])}</p>"
        for key in about.sentence_keys
        if sentences.get(key)
    )
    beside = (
        f"<details><summary>{text.CAPTION}</summary><p>{escape(caption)}</p></details>"
        if caption
        else ""
    )
    redraw = _redraw_form(contents) if stem == "figure6" and contents else ""
    return (
        f"<section>{markup.heading(about.title, about.help)}"
        f'<figure class="plot of-{escape(stem)}">'
        f'<a class="zoom" href="{escape(urls["png"])}" target="_blank" '
        f'aria-label="{text.ENLARGE_FIGURE.format(title=escape(about.title))}">'
        f'<img src="{escape(urls["png"])}" alt="{escape(about.title)}"></a>'
        f'<figcaption>{captions}{beside}<p class="links">{links}</p>'
        f"{redraw}</figcaption></figure></section>"
    )


def _redraw_form(contents: str) -> str:
    """Format a form that downloads Figure 6 with other panels, frames or width."""
    panels = "".join(
        f'<label><input type="checkbox" name="panels" value="{letter}" checked>{letter} {what}'
        "</label>"
        for letter, what in FIGURE_PANELS.items()
    )
    widths = "".join(f"<option>{width}</option>" for width in reversed(get_args(FigureWidth)))
    buttons = "".join(
        f'<button name="as" value="{form}">{form.upper()}</button>' for form in FIGURE_FORMATS
    )
    return (
        f"<details><summary>{text.REDRAW}</summary>"
        f'<form method="get" target="_blank" action="{escape(contents.partition("?")[0])}">'
        f'{panels}<label>Frames <input name="frames" placeholder="every 50" size="16"></label>'
        f'<label>Width <select name="width">{widths}</select></label><span>{buttons}</span>'
        "</form></details>"
    )


def download_link(url: str, name: str, words: str = "") -> str:
    """Format a link that downloads a file under a name."""
    return f'<a href="{escape(url)}" download="{escape(name)}">{escape(words or name)}</a>'


def file_list_html(paths: Iterable[Path], to_url: FileToUrl) -> str:
    """Format links to single files, folded."""
    items = "".join(
        f"<li>{download_link(to_url(path), path.name)}"
        f"<span>{_size(path.stat().st_size)}</span></li>"
        for path in paths
    )
    return f"<details><summary>Single files</summary><ul>{items}</ul></details>"


def _size(num_bytes: int) -> str:
    return f"{num_bytes / 1e6:.1f} MB" if num_bytes >= 1e5 else f"{num_bytes / 1e3:.1f} kB"
