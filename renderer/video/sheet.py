"""A contact sheet: pictures of one motion in reading order, each above its time."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import UInt8
from PIL import Image, ImageDraw, ImageFont

from conventions.rates import FPS
from renderer.video.compose import band_height, rows_of

_INK = (38, 42, 50)


def contact_sheet(pictures: UInt8[np.ndarray, "N H W C"], frames: Sequence[int]) -> Image.Image:
    """All pictures in rows no wider than a screen, on white, or on nothing if they have alpha.

    Args:
        frames: of the pictures, at 30 per second.

    Raises:
        ValueError: if there is no picture, or not one frame for each.
    """
    if not len(pictures) or len(pictures) != len(frames):
        raise ValueError(f"{len(pictures)} pictures were given for {len(frames)} frames.")
    _, height, width, channels = pictures.shape
    rows = rows_of(len(pictures), width)
    band = band_height(height)
    size = (width * len(rows[0]), (height + band) * len(rows))
    has_alpha = channels == 4
    sheet = Image.new("RGBA" if has_alpha else "RGB", size, (255, 255, 255, 0)[:channels])
    draw = ImageDraw.Draw(sheet)
    font = ImageFont.load_default(0.55 * band)
    for number, row in enumerate(rows):
        for column, index in enumerate(row):
            left, top = column * width, number * (height + band)
            sheet.paste(Image.fromarray(pictures[index]), (left, top))
            middle = (left + width / 2, top + height + band / 2)
            time = f"{frames[index] / FPS:.2f} s"
            draw.text(middle, time, fill=(*_INK, 255)[:channels], font=font, anchor="mm")
    return sheet
