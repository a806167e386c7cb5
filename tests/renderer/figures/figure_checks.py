"""What tests of figures look at: the texts as they are drawn, and boxes that overlap."""

import itertools
from collections.abc import Collection
from typing import Any

import pytest

from renderer.figures.grid_layout import lay_out

NAMES = (
    *("globaldiff/local", "globaldiff/global", "globaldiff/joint", "globaldiff/skeleton.s2"),
    *("globaldiff/full", "asynfusion/lcm"),
)
ODD_NAMES = (
    "globaldiff/skeleton.s2",
    "a_folder_with_a_long_name/2_scott_0_103_103_of_the_second_run_with_everything_in_it.s12",
    "$x^2$_{nothing}\\frac",
    "_" + "x" * 130,
    "éàü",
    "b",
)


def drawn_texts(figure: Any, monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, Any]]:
    """Each text that a drawing really shows, with its box in pixels of 1/144 inch."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.text import Text

    drawn = []
    draw = Text.draw

    def record(self: Text, renderer: object) -> None:
        draw(self, renderer)
        if self.get_visible() and self.get_text().strip():
            drawn.append((self.get_text(), Text.get_window_extent(self, renderer)))

    figure.set_dpi(144)
    lay_out(figure)
    with monkeypatch.context() as patch:
        patch.setattr(Text, "draw", record)
        FigureCanvasAgg(figure).draw()
    return drawn


def overlap(a: Any, b: Any, slack: float = 0.5) -> bool:
    return min(a.x1, b.x1) - max(a.x0, b.x0) > slack and min(a.y1, b.y1) - max(a.y0, b.y0) > slack


def check_apart(
    figure: Any,
    texts: list[tuple[str, Any]],
    panels: dict[str, Any],
    within_panels: Collection[str] = (),
) -> None:
    """No text covers another, a panel or the edge of the figure, and no panel another."""
    for (text_a, box_a), (text_b, box_b) in itertools.combinations(texts, 2):
        is_letter = len(text_a) == len(text_b) == 1  # its box is taller than it
        assert not overlap(box_a, box_b, 6.0 if is_letter else 0.5), f"{text_a!r} covers {text_b!r}"
    for (label_a, a), (label_b, b) in itertools.combinations(panels.items(), 2):
        assert not overlap(a, b), f"{label_a} covers {label_b}"
    for text, box in texts:
        assert box.x0 >= -0.5 and box.y0 >= -0.5, f"{text!r} leaves the figure"
        assert box.x1 <= figure.bbox.x1 + 0.5 and box.y1 <= figure.bbox.y1 + 0.5, text
        if text not in within_panels:
            for label, panel in panels.items():
                assert not overlap(box, panel), f"{text!r} covers {label}"
