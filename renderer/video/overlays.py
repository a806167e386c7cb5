"""Overlays of a picture: trail, jerk as body colour, legends, notice; in the caller's scales."""

import importlib.util
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Float32, Num, UInt8
from PIL import Image, ImageDraw, ImageFont

from renderer.body.body import Body
from renderer.scene.camera import Camera
from renderer.scene.camera_setup import Panel

TRAIL_FRAMES = 30
"""Default length of a trail: the last second."""
_SMOOTH = 3
"""Samples along each side of a pixel of a trail."""
_INK, _LABEL_BACKGROUND = (28, 32, 40), (255, 255, 255, 216)
_WARNING_COLOR, _ON_LOUD = (196, 52, 0), (255, 255, 255)

# Grey stands still; then lighter to darker, so that neither colour-blindness nor a grey print hides
# which is more (plasma of matplotlib, from its light end).
HEAT_COLORS = np.array(
    [
        [0.80, 0.80, 0.79],
        [0.99, 0.86, 0.25],
        [0.97, 0.58, 0.25],
        [0.85, 0.32, 0.42],
        [0.60, 0.10, 0.58],
        [0.25, 0.02, 0.55],
    ]
)
SPEED_COLORS = np.array([[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]])
"""Viridis of matplotlib: slow is dark, fast is light."""
SPIKE_COLOR = (213, 94, 0)


@dataclass(frozen=True)
class Trail:
    """Recent path of one point."""

    points: Float[np.ndarray, "T 3"]
    """Position of the point in each frame (T, 3), metres."""
    normalized_speeds: Float[np.ndarray, " T"]
    """Speed as a share of the end of the scale, 0 to 1."""
    is_spike: Bool[np.ndarray, " T"]
    """Mask (T,) of frames whose jerk is above the limit; each has a dot."""
    legend: str = ""
    """Legend of colours and dots, in one line."""
    close_up_view: str = ""
    """View of the close-up that also shows the trail; empty for none."""
    is_in_body_panel: bool = True
    """True if the body's own panel shows the trail."""
    length_frames: int = TRAIL_FRAMES
    """Length of the trail in frames before the current one."""


@dataclass(frozen=True)
class HeatMap:
    """Jerk of each joint, shown as colour of the vertices that follow it."""

    normalized_jerk: Float[np.ndarray, "T J"]
    """Jerk as a share of the end of the scale, 0 to 1."""
    legend: str = ""
    """Legend of the end of the scale."""


@dataclass(frozen=True)
class Overlays:
    """Overlays in the pictures of one motion."""

    trail: Trail | None = None
    heat: HeatMap | None = None
    notice: str = ""
    """Notice in large letters below the body."""
    close_up_notice: str = ""
    """Short form of the notice, shown in every close-up."""


def heat_colors(
    body: Body, normalized_jerk: Float[np.ndarray, "T J"]
) -> Iterator[Float32[np.ndarray, "V 3"]]:
    """Yield the linear RGB of each vertex, from its joints' shares and skinning weights."""
    for of_joint in normalized_jerk:
        yield (_along(HEAT_COLORS, body.weights @ of_joint) ** 2).astype(np.float32)


def _along(colors: Num[np.ndarray, "N C"], shares: Float[np.ndarray, "*S"]) -> np.ndarray:
    """Interpolate colours at shares of a scale."""
    stops = np.linspace(0.0, 1.0, len(colors))
    return np.stack([np.interp(shares, stops, channel) for channel in colors.T], axis=-1)


class OverlayPainter:
    """Painter of overlays on pictures that are composed of panels."""

    def __init__(self, overlays: Overlays, panels: Sequence[Panel]) -> None:
        self._trail = overlays.trail
        self._panels = panels
        self._with_trail: list[int] = []
        if overlays.trail is not None:
            shown = {overlays.trail.close_up_view} | (
                {panels[0].view} if overlays.trail.is_in_body_panel else set()
            )
            self._with_trail = [i for i, panel in enumerate(panels) if panel.view in shown]
        self._plates = _static_images(overlays, panels)

    def paint(
        self, picture: UInt8[np.ndarray, "H W C"], frame: int, cameras: Sequence[Camera]
    ) -> UInt8[np.ndarray, "H W C"]:
        """Paint the overlays of a frame on its picture, with the cameras of its panels."""
        painted = Image.fromarray(picture)
        for i in self._with_trail:
            assert self._trail is not None
            drawn = _drawn_trail(self._panels[i], self._trail, frame, cameras[i])
            if drawn is not None:
                painted.paste(drawn[1], drawn[0], drawn[1])
        for place, plate in self._plates:
            painted.paste(plate, place, plate)
        return np.asarray(painted)


PlacedImage = tuple[tuple[int, int], Image.Image]
"""Image to paste on a picture, with the position of its upper left corner."""


def _drawn_trail(panel: Panel, trail: Trail, frame: int, camera: Camera) -> PlacedImage | None:
    """Draw the trail up to a frame within a panel; parts outside are cut off."""
    frames = np.arange(max(0, frame - trail.length_frames), frame + 1)
    way = camera.project(trail.points[frames], panel.width, panel.height)
    if not np.isfinite(way).all():
        return None
    thick, size = max(2.0, panel.width / 130), (panel.width, panel.height)
    low = np.floor(way.min(axis=0) - 3 * thick).clip(0, size).astype(int)
    high = np.ceil(way.max(axis=0) + 3 * thick).clip(0, size).astype(int)
    if (high <= low).any():
        return None
    layer = Image.new("RGBA", tuple(_SMOOTH * (high - low)), (255, 255, 255, 0))
    draw = ImageDraw.Draw(layer)
    places = [tuple(place) for place in (way - low) * _SMOOTH]
    colors = _along(SPEED_COLORS, trail.normalized_speeds[frames]).astype(int)
    for width_px, is_halo in ((1.8 * thick, True), (thick, False)):
        for i in range(1, len(places)):
            color = (255, 255, 255) if is_halo else tuple(colors[i])
            line = int(_SMOOTH * width_px * (0.45 + 0.55 * i / len(places)))
            draw.line((places[i - 1], places[i]), fill=(*color, 255), width=max(line, 1))
            _dot(draw, places[i], line / 2, (*color, 255))
    for place, is_spike in zip(places, trail.is_spike[frames], strict=True):
        if is_spike:
            _dot(draw, place, _SMOOTH * 1.5 * thick, (255, 255, 255, 255))
            _dot(draw, place, _SMOOTH * 1.1 * thick, (*SPIKE_COLOR, 255))
    small = layer.resize((int(high[0] - low[0]), int(high[1] - low[1])), Image.Resampling.BOX)
    return (panel.left + int(low[0]), panel.top + int(low[1])), small


def _dot(draw: ImageDraw.ImageDraw, place, radius: float, color) -> None:
    x, y = place
    draw.ellipse((x - radius, y - radius, x + radius, y + radius), fill=color)


def _static_images(overlays: Overlays, panels: Sequence[Panel]) -> list[PlacedImage]:
    """Return the overlays that are the same in all pictures."""
    body = panels[0]
    size = max(11.0, 0.036 * body.width)
    plates: list[PlacedImage] = []
    bottom = body.top + body.height
    if overlays.notice:
        band = _band(overlays.notice, body.width, 1.5 * size)
        bottom -= band.height
        plates.append(((body.left, bottom), band))
    if overlays.close_up_notice:
        tag = _band(overlays.close_up_notice, None, 1.1 * size)
        plates += [((panel.left + 4, panel.top + 4), tag) for panel in panels[1:]]
    legends = []
    if overlays.heat is not None:
        legends.append(_legend(HEAT_COLORS * 255, overlays.heat.legend, size, body.width))
    if overlays.trail is not None and overlays.trail.is_in_body_panel:
        legends.append(_legend(SPEED_COLORS, overlays.trail.legend, size, body.width))
    for legend in legends:
        bottom -= legend.height + 4
        plates.append(((body.left + 4, bottom), legend))
    return plates


def _band(words: str, width: int | None, size: float) -> Image.Image:
    """Draw a band with large letters, as wide as its text if ``width`` is None."""
    font = _fitting(words, size, width)
    box = (width or int(font.getlength(words) + size), int(1.5 * size))
    band = Image.new("RGBA", box, (*_WARNING_COLOR, 255))
    middle = (box[0] / 2, box[1] / 2)
    ImageDraw.Draw(band).text(middle, words, fill=(*_ON_LOUD, 255), font=font, anchor="mm")
    return band


def _legend(colors: Num[np.ndarray, "N C"], words: str, size: float, width: int) -> Image.Image:
    """Draw a colour scale and its meaning on a plate."""
    bar, high = int(3.2 * size), int(0.6 * size)
    font = _fitting(words, size, int(width - bar - 2 * size))
    box = (int(bar + font.getlength(words) + 1.5 * size), int(1.5 * size))
    plate = Image.new("RGBA", box, _LABEL_BACKGROUND)
    ramp = _along(colors, np.linspace(0.0, 1.0, bar)).astype(np.uint8)
    strip = Image.fromarray(np.tile(ramp[None], (high, 1, 1)))
    plate.paste(strip, (int(0.4 * size), (box[1] - high) // 2))
    left = (bar + 0.9 * size, box[1] / 2)
    ImageDraw.Draw(plate).text(left, words, fill=(*_INK, 255), font=font, anchor="lm")
    return plate


def _fitting(words: str, size: float, width: int | None) -> ImageFont.FreeTypeFont:
    """Return a font of this height, or smaller to fit the width."""
    font = ImageFont.truetype(_font_file(), size)
    if width is not None and font.getlength(words) > 0.96 * width:
        font = font.font_variant(size=size * 0.96 * width / font.getlength(words))
    return font


def _font_file() -> str:
    """Return a font with units such as m/s³, which Pillow's lacks, from matplotlib's data."""
    spec = importlib.util.find_spec("matplotlib")
    assert spec is not None and spec.origin is not None
    return str(Path(spec.origin).parent / "mpl-data" / "fonts" / "ttf" / "DejaVuSans-Bold.ttf")
