"""Composition of videos: side by side, or two overlaid as ghost, wipe or flicker; contact sheets.

ffmpeg decodes and encodes in its own process, so memory does not grow with the length.
"""

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import UInt8
from PIL import Image, ImageDraw, ImageFont

from conventions.rates import FPS
from renderer.scene.camera_setup import Panel
from renderer.video.encoder import Encoder, VideoError, VideoInfo, probe_video

MAX_WIDTH_PX, MAX_HEIGHT_PX = 1920, 1080
"""Largest size of a comparison (pixels), which fits most screens; larger ones are scaled down."""
_SMALLEST_LABEL = 0.35
"""Smallest readable height of letters, as a share of the band; longer labels are cut."""
_INK, _PAPER = (38, 42, 50), (255, 255, 255)
_YUV_FILTER = "scale=out_color_matrix=bt709:out_range=tv,format=yuv420p"


OverlayMode = Literal["ghost", "wipe", "flicker"]
FLICKER_FRAMES = 15
"""Frames between changes (half a second): far too slow to cause photosensitive seizures."""


@dataclass(frozen=True)
class SuperposedPair:
    """Overlay of two videos: the second over the first's body panel, with its close-ups."""

    mode: OverlayMode
    """Kind of overlay; a ghost prints each video in its ink."""
    width: int
    height: int
    """Size of the result (pixels)."""
    body: Panel
    """Panel of the body in both videos and in the result."""
    second_close_ups: tuple[Panel, ...] = ()
    """Close-ups of the second video, at the same positions as in the result."""
    wipe_position_px: int = 0
    """Columns of the body's panel that show the first video, for a wipe."""
    ghost_colors: Sequence[str] = ("#d55e00", "#0072b2")
    """Colours of a ghost, as #rrggbb."""

    @property
    def half_side_px(self) -> int:
        """Shorter side of half the picture, which sets the size of labels."""
        return min(self.width // 2, self.height)


def compose_videos(
    videos: Sequence[Path],
    labels: Sequence[str],
    out: Path,
    speech_wav: Path | None = None,
    on_progress: Callable[[float], None] = lambda share: None,
    should_cancel: Callable[[], bool] = lambda: False,
    num_columns: int | None = None,
    pair: SuperposedPair | None = None,
) -> None:
    """Compose videos side by side with bands of labels above each row, or overlay two of them.

    Rows, about equally long, are as many as leave the pictures largest on a screen. Frame n of the
    result shows frame n of every video; a shorter video holds its last frame.

    Args:
        labels: one for each video; drawn smaller, or cut, if it is too long for its picture.
        num_columns: columns of each row but the last; None for the largest pictures.

    Raises:
        Cancelled: if ``should_cancel`` returns true; no file is left.
        VideoError: if a video cannot be read, sizes do not fit, or ffmpeg fails; no file is left.
    """
    facts = [probe_video(video) for video in videos]
    lengths = [each.num_frames for each in facts]
    if pair is None:
        _check_same_shape(videos, facts)
        first = facts[0]
        grid = fit_grid(len(videos), first.width, first.height, num_columns)
        shorter = min(grid.picture_width, grid.picture_height)
        bands = [
            draw_label_band([labels[i] for i in row], grid.picture_width, shorter, grid.width)
            for row in grid.rows
        ]
        graph = _side_by_side_filter(
            _hold_last_frame(lengths), grid, is_smaller=grid.picture_width != first.width
        )
    else:
        for video, each in zip(videos, facts, strict=True):
            if each.width > pair.width or each.height > pair.height:
                raise VideoError(
                    f"{video.name} has {each.width} x {each.height} pixels; at most {pair.width} x "
                    f"{pair.height} fit in the overlay."
                )
        label_colors = pair.ghost_colors if pair.mode == "ghost" else None
        bands = [
            draw_label_band(labels, pair.width // 2, pair.half_side_px, pair.width, label_colors)
        ]
        graph = _overlay_filter(_hold_last_frame(lengths), pair)
    with tempfile.TemporaryDirectory() as folder:
        pictures = [Path(folder, f"labels{number}.png") for number in range(len(bands))]
        for band, path in zip(bands, pictures, strict=True):
            Image.fromarray(band).save(path)
        inputs = [part for each in (*videos, *pictures) for part in ("-i", str(each))]
        joined = ("-filter_complex", ";".join(graph), "-map", "[out]")
        with Encoder(out, inputs, joined, max(lengths), speech_wav) as encoder:
            encoder.wait_with_progress(on_progress, should_cancel)


def _check_same_shape(videos: Sequence[Path], facts: Sequence[VideoInfo]) -> None:
    first = facts[0]
    for video, other in zip(videos, facts, strict=True):
        if (other.width, other.height) != (first.width, first.height):
            raise VideoError(
                f"{video.name} has {other.width} x {other.height} pixels and {videos[0].name} has "
                f"{first.width} x {first.height}; videos side by side must have the same size."
            )


def _hold_last_frame(lengths: Sequence[int]) -> list[str]:
    """Return a filter for each input video that holds its last frame until the longest ends."""
    return [
        f"[{i}:v]setpts=PTS-STARTPTS,tpad=stop={max(lengths) - length}:stop_mode=clone"
        for i, length in enumerate(lengths)
    ]


def _with_label_band(
    picture: str, band_input: int, out: str, width: int, band: int, left: int = 0
) -> str:
    """Return a filter that puts a picture on white below its band of labels."""
    return (
        f"{picture}pad={width}:ih+{band}:{left}:{band}:white[under{band_input}];"
        f"[{band_input}:v]format=rgb24,{_YUV_FILTER}[band{band_input}];"
        f"[under{band_input}][band{band_input}]overlay=0:0:eof_action=repeat{out}"
    )


@dataclass(frozen=True)
class Grid:
    """Layout of equal pictures in rows."""

    rows: tuple[range, ...]
    """Indices of the pictures in each row, from the top; the last row may be shorter."""
    picture_width: int
    picture_height: int

    @property
    def width(self) -> int:
        return self.picture_width * len(self.rows[0])

    @property
    def label_band_height_px(self) -> int:
        """Height of the labels above each row (pixels)."""
        return label_band_height(min(self.picture_width, self.picture_height))


def fit_grid(
    num_pictures: int, picture_width: int, picture_height: int, num_columns: int | None = None
) -> Grid:
    """Return the grid with the largest pictures on a screen, never enlarged.

    Of equal ones it has the fewest rows.
    """
    best, best_scale = None, 0.0
    columns = [-(-num_pictures // num_rows) for num_rows in range(1, num_pictures + 1)]
    for number in columns if num_columns is None else [num_columns]:
        rows = _rows(num_pictures, number)
        room = MAX_HEIGHT_PX / len(rows) - label_band_height(min(picture_width, picture_height))
        scale = min(MAX_WIDTH_PX / len(rows[0]) / picture_width, room / picture_height, 1.0)
        if best is None or scale > best_scale:
            width, height = (
                2 * int(scale * side / 2 + 1e-6) for side in (picture_width, picture_height)
            )
            best, best_scale = Grid(rows, width, height), scale
    assert best is not None
    return best


def split_into_rows(num_pictures: int, picture_width: int) -> tuple[range, ...]:
    """Return the picture indices of each row, with as many per row as fit a screen's width."""
    longest = max(1, MAX_WIDTH_PX // picture_width)
    num_rows = -(-num_pictures // longest)
    return _rows(num_pictures, -(-num_pictures // num_rows))


def _rows(count: int, num_columns: int) -> tuple[range, ...]:
    return tuple(range(i, min(i + num_columns, count)) for i in range(0, count, num_columns))


def _side_by_side_filter(held: Sequence[str], grid: Grid, *, is_smaller: bool) -> list[str]:
    """Return ffmpeg's filter graph of stacked rows, each below its band."""
    fitted = f",scale={grid.picture_width}:{grid.picture_height}:flags=bicubic" * is_smaller
    parts = [f"{each}{fitted}[v{i}]" for i, each in enumerate(held)]
    for number, row in enumerate(grid.rows):
        joined = "".join(f"[v{i}]" for i in row)
        joined += f"hstack=inputs={len(row)}," if len(row) > 1 else ""
        left = _left_edge(len(row), grid.picture_width, grid.width)
        parts.append(
            _with_label_band(
                joined,
                len(held) + number,
                f"[row{number}]",
                grid.width,
                grid.label_band_height_px,
                left,
            )
        )
    stack = "".join(f"[row{number}]" for number in range(len(grid.rows)))
    how = f"vstack=inputs={len(grid.rows)}" if len(grid.rows) > 1 else "null"
    return [*parts, f"{stack}{how}[out]"]


def _left_edge(num_pictures: int, picture_width: int, width: int) -> int:
    """Return the left edge of a centred row; even, as yuv420p halves both axes."""
    return 2 * ((width - num_pictures * picture_width) // 4)


def _overlay_filter(held: Sequence[str], pair: SuperposedPair) -> list[str]:
    """Return ffmpeg's filter graph of an overlay: both padded to the result, the second on top."""
    whole = [f"{each},pad={pair.width}:{pair.height}:0:0:white" for each in held]
    body = pair.body
    sides = [f"[side{i}]" for i in range(len(pair.second_close_ups))]
    parts = [
        f"{whole[0]},split=2[first][base]",
        f"{whole[1]},split={1 + len(sides)}[second]{''.join(sides)}",
    ]
    where, when = (body.left, body.top), ""
    match pair.mode:
        case "ghost":
            grey = f"{_crop(body)},scale=in_color_matrix=bt709:in_range=tv,format=gbrp,{_GREY}"
            parts += [
                f"[first]{grey},{_tint(pair.ghost_colors[0])}[under]",
                f"[second]{grey},{_tint(pair.ghost_colors[1])}[upper]",
                f"[under][upper]blend=all_mode=darken,{_YUV_FILTER}[over]",
            ]
        case "wipe":
            edge = max(0, min(pair.wipe_position_px, body.width - 2)) // 2 * 2
            right = Panel("", body.left + edge, body.top, body.width - edge, body.height)
            line = f"drawbox=0:0:2:{right.height}:white:fill"
            parts += ["[first]nullsink", f"[second]{_crop(right)},{line}[over]"]
            where = (right.left, right.top)
        case "flicker":
            turn = FLICKER_FRAMES / FPS
            parts += ["[first]nullsink", f"[second]{_crop(body)}[over]"]
            when = f":enable='gte(mod(t+{0.5 / FPS:.6f},{2 * turn:g}),{turn:g})'"
    laid = f"[base][over]overlay={where[0]}:{where[1]}{when}"
    for side, panel in zip(sides, pair.second_close_ups, strict=True):
        parts += [f"{laid}{side[:-1]}under]", f"{side}{_crop(panel)}{side[:-1]}over]"]
        laid = f"{side[:-1]}under]{side[:-1]}over]overlay={panel.left}:{panel.top}"
    band = label_band_height(pair.half_side_px)
    return [*parts, _with_label_band(f"{laid},", len(held), "[out]", pair.width, band)]


_GREY = "colorchannelmixer=" + ":".join(
    f"{to}{of}={share}"
    for to in "rgb"
    for of, share in (("r", 0.2126), ("g", 0.7152), ("b", 0.0722))
)


def _tint(ink: str) -> str:
    """Return a filter that prints a grey picture in an ink on white."""
    shares = [int(ink[at : at + 2], 16) for at in (1, 3, 5)]
    return "lutrgb=" + ":".join(
        f"{channel}='{share}+{1 - share / 255:.4f}*val'"
        for channel, share in zip("rgb", shares, strict=True)
    )


def _crop(panel: Panel) -> str:
    return f"crop={panel.width}:{panel.height}:{panel.left}:{panel.top}"


def label_band_height(shorter_side_px: int) -> int:
    """Return a label band's height in pixels: even, in proportion to a picture's shorter side."""
    return 2 * max(12, round(shorter_side_px / 28))


def draw_label_band(
    labels: Sequence[str],
    picture_width: int,
    shorter_side_px: int,
    width: int | None = None,
    label_colors: Sequence[str] | None = None,
) -> UInt8[np.ndarray, "B W 3"]:
    """Draw the band above a row of pictures, with each label in one line, centred on its picture.

    The row is centred in the ``width`` of the band if that is wider.
    """
    height = label_band_height(shorter_side_px)
    width = width or picture_width * len(labels)
    left = _left_edge(len(labels), picture_width, width)
    band = Image.new("RGB", (width, height), _PAPER)
    draw = ImageDraw.Draw(band)
    widest = 0.94 * picture_width
    for index, label in enumerate(" ".join(label.split()) for label in labels):
        size = height * 0.55
        font = ImageFont.load_default(size)
        if draw.textlength(label, font) > widest:
            shrunk = size * widest / draw.textlength(label, font)
            font = ImageFont.load_default(max(shrunk, _SMALLEST_LABEL * height))
        num_letters = len(label)
        while draw.textlength(label, font) > widest:
            num_letters -= 1
            label = label[:num_letters] + "..."
        middle = (left + picture_width * (index + 0.5), height / 2)
        draw.text(
            middle,
            label,
            fill=label_colors[index] if label_colors else _INK,
            font=font,
            anchor="mm",
        )
    return np.asarray(band)


def contact_sheet(pictures: UInt8[np.ndarray, "N H W C"], frames: Sequence[int]) -> Image.Image:
    """Draw all pictures in rows that fit a screen, on white, or transparent if they have alpha."""
    _, height, width, channels = pictures.shape
    rows = split_into_rows(len(pictures), width)
    band = label_band_height(height)
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
