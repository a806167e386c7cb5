"""Colours and typography of the page: a Gradio theme with the page's own typeface."""

from __future__ import annotations

from pathlib import Path

from gradio.themes.base import Base
from gradio.themes.utils import sizes
from gradio.themes.utils.colors import Color

_INK = Color(
    name="ink",
    c50="#f7f9fb", c100="#eef2f6", c200="#dfe6ed", c300="#c3cfda", c400="#93a4b5",
    c500="#566a7d", c600="#4b5d70", c700="#35465a", c800="#1f2d3d", c900="#131d29", c950="#0c131c",
)  # fmt: skip
_LAGOON = Color(
    name="lagoon",
    c50="#eef8fb", c100="#d6edf4", c200="#afdbe8", c300="#7bc0d6", c400="#429fbf",
    c500="#1f84a8", c600="#0f6d8c", c700="#0e5872", c800="#10485d", c900="#123c4e", c950="#0a2736",
)  # fmt: skip


_FOLDER = Path(__file__).with_name("css")
CSS = _FOLDER / "page.css"
PLAYER_CSS = tuple(
    _FOLDER / name for name in ("player.css", "stage.css", "tiers.css", "editing.css")
)
"""Style sheets that the player needs in addition to the theme."""
HEAD_CSS = (_FOLDER / "frame.css", *PLAYER_CSS, _FOLDER / "measures.css", _FOLDER / "live.css")
_PRELOADED = (
    ("web/inter.woff2", "font"),
    ("stage/facts.json", "fetch"),
    ("live/body.glb", "fetch"),
)


def head_style() -> str:
    """Return `HEAD_CSS` as HTML for the head of the page, where Gradio does not rewrite it.

    The browser fetches what the first bodies need while Gradio's own scripts start.
    """
    links = [
        f'<link rel="preload" href="{url}" as="{kind}" crossorigin>' for url, kind in _PRELOADED
    ]
    return "".join(links) + "".join(f"<style>{path.read_text()}</style>" for path in HEAD_CSS)


def make_theme() -> Base:
    """Make a theme of greys with one blue and rounded corners; light and dark."""
    sans = ["Inter", "system-ui", "Segoe UI", "Roboto", "sans-serif"]
    return Base(
        primary_hue=_LAGOON,
        secondary_hue=_LAGOON,
        neutral_hue=_INK,
        font=sans,
        font_mono=["ui-monospace", "SFMono-Regular", "Menlo", "monospace"],
        radius_size=sizes.radius_md,
        spacing_size=sizes.spacing_md,
        text_size=sizes.text_md,
    ).set(
        body_background_fill="*neutral_50",
        body_background_fill_dark="*neutral_950",
        body_text_color_subdued="*neutral_500",
        body_text_color_subdued_dark="*neutral_400",
        block_info_text_color="*neutral_500",
        block_info_text_color_dark="*neutral_400",
        block_background_fill="white",
        block_background_fill_dark="*neutral_900",
        block_border_color="*neutral_200",
        block_border_color_dark="*neutral_800",
        block_border_width="1px",
        block_shadow="none",
        block_label_background_fill="transparent",
        block_label_text_color="*neutral_600",
        block_title_text_weight="600",
        block_title_text_color="*neutral_800",
        block_title_text_color_dark="*neutral_100",
        button_primary_background_fill="*primary_600",
        button_primary_background_fill_hover="*primary_700",
        button_primary_background_fill_dark="*primary_600",
        link_text_color_dark="*primary_300",
        link_text_color_hover_dark="*primary_200",
        link_text_color_visited_dark="*primary_300",
        button_primary_text_color="white",
        button_large_text_weight="600",
        checkbox_border_color_dark="*neutral_400",
        checkbox_label_background_fill_dark="*neutral_800",
        checkbox_label_background_fill_selected="*primary_50",
        checkbox_label_background_fill_selected_dark="*primary_950",
        checkbox_label_border_color_selected="*primary_400",
        checkbox_label_text_color_selected="*neutral_900",
        input_background_fill="white",
        input_background_fill_dark="*neutral_950",
        input_border_width="1px",
        input_border_color="*neutral_300",
        input_border_color_dark="*neutral_700",
        slider_color="*primary_600",
    )
