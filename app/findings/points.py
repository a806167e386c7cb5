"""What a followed point is called."""

from __future__ import annotations

import re

from renderer.body.tip_vertices import TIP_VERTICES


def point_title(point: str) -> str:
    """A point's name for a person: ``right_middle`` is the 'Right middle fingertip'."""
    words = re.sub(r"(\d)$", r" joint \1", point).replace("_", " ").capitalize()
    if point not in TIP_VERTICES:
        return words
    return f"{words} tip" if point.endswith("thumb") else f"{words} fingertip"
