"""Several videos side by side in lock-step, and pictures of one motion on a contact sheet."""

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from PIL import Image, ImageDraw, ImageFont

from conventions.rates import FPS
from renderer.video.encoder import (
    DEFAULT_CRF,
    Cancelled,
    Encoder,
    VideoError,
    VideoFacts,
    check_sound,
    encoding,
    read_facts,
)

MAX_VIDEOS = 12
MAX_WIDTH_PX, MAX_HEIGHT_PX = 1920, 1080
"""What most screens show whole; larger comparisons are made smaller."""
_SMALLEST_LABEL = 0.35
"""Letters this high, as a share of the band, can still be read; longer labels are cut."""
_INK, _PAPER = (38, 42, 50), (255, 255, 255)


def compose_videos(
    videos: Sequence[Path],
    labels: Sequence[str],
    out: Path,
    speech_wav: Path | None = None,
    crf: int = DEFAULT_CRF,
    on_progress: Callable[[float], None] | None = None,
    should_cancel: Callable[[], bool] | None = None,
    num_columns: int | None = None,
) -> None:
    """Write videos beside one another, each row with a band of labels above its pictures.

    Rows, about equally long, are as many as leave the pictures largest on a screen. Frame n of the
    result shows frame n of every video; a shorter video holds its last frame. ffmpeg decodes and
    encodes in its own process, so memory does not grow with the length.

    Args:
        labels: one for each video; drawn smaller, or cut, if it is too long for its picture.
        on_progress: called with the share done, 0 to 1.
        should_cancel: asked several times a second.
        num_columns: of each row but the last; None as many as leave the pictures largest.

    Raises:
        Cancelled: if ``should_cancel`` said so; no file is left.
        ValueError: if there are no or too many videos, or labels do not match them.
        VideoError: if a video cannot be read, sizes differ, or ffmpeg fails; no file is left.
    """
    if not 1 <= len(videos) <= MAX_VIDEOS:
        raise ValueError(f"{len(videos)} videos were given; 1 to {MAX_VIDEOS} fit side by side.")
    if len(labels) != len(videos):
        raise ValueError(f"{len(labels)} labels were given for {len(videos)} videos.")
    facts = [read_facts(video) for video in videos]
    first = facts[0]
    for video, other in zip(videos, facts, strict=True):
        if (other.width, other.height) != (first.width, first.height):
            raise VideoError(
                f"{video.name} has {other.width} x {other.height} pixels and {videos[0].name} "
                f"{first.width} x {first.height}; only equal sizes can stand side by side."
            )
    check_sound(speech_wav)
    num_frames = max(each.num_frames for each in facts)
    grid = fit_grid(len(videos), first.width, first.height, num_columns)
    with tempfile.TemporaryDirectory() as folder:
        inputs = [part for video in videos for part in ("-i", str(video))]
        for number, row in enumerate(grid.rows):
            path = Path(folder) / f"labels{number}.png"
            names = [labels[i] for i in row]
            shorter = min(grid.picture_width, grid.picture_height)
            band = label_band(names, grid.picture_width, shorter, grid.width)
            Image.fromarray(band).save(path)
            inputs += ["-i", str(path)]
        if speech_wav is not None:
            inputs += ["-i", str(speech_wav)]
        sound_input = None if speech_wav is None else len(videos) + len(grid.rows)
        encoder = Encoder(
            out,
            [
                *inputs,
                *("-filter_complex", _filter(facts, grid, num_frames), "-map", "[out]"),
                *encoding(num_frames, crf, sound_input),
            ],
            stdin=False,
        )
        run_encoder(encoder, num_frames, on_progress, should_cancel)


def run_encoder(
    encoder: Encoder,
    num_frames: int,
    on_progress: Callable[[float], None] | None,
    should_cancel: Callable[[], bool] | None,
) -> None:
    """See an encoder that is fed nothing through to its end; arguments as of `compose_videos`."""
    encoder.start()
    try:
        for num_done in encoder.progress():
            if should_cancel is not None and should_cancel():
                raise Cancelled(f"Composing {encoder.out.name} was cancelled.")
            if on_progress is not None:
                on_progress(min(num_done / num_frames, 1.0))
    except BaseException:
        encoder.abort()
        raise
    encoder.finish()


@dataclass(frozen=True)
class Grid:
    """How equal pictures stand beside and below one another."""

    rows: tuple[range, ...]
    """Which pictures stand in which row, from the top; the last row may be shorter."""
    picture_width: int
    picture_height: int

    @property
    def width(self) -> int:
        return self.picture_width * len(self.rows[0])

    @property
    def band(self) -> int:
        """Height of the labels above each row."""
        return band_height(min(self.picture_width, self.picture_height))


def fit_grid(
    count: int, picture_width: int, picture_height: int, num_columns: int | None = None
) -> Grid:
    """The grid in which pictures are largest on a screen, and never larger than they are; of two
    such the one of fewer rows.

    Args:
        num_columns: where they are given.
    """
    best, best_scale = None, 0.0
    columns = [-(-count // num_rows) for num_rows in range(1, count + 1)]
    for number in columns if num_columns is None else [num_columns]:
        rows = _rows(count, number)
        room = MAX_HEIGHT_PX / len(rows) - band_height(min(picture_width, picture_height))
        scale = min(MAX_WIDTH_PX / len(rows[0]) / picture_width, room / picture_height, 1.0)
        if best is None or scale > best_scale:
            width, height = (
                2 * int(scale * side / 2 + 1e-6) for side in (picture_width, picture_height)
            )
            best, best_scale = Grid(rows, width, height), scale
    assert best is not None
    return best


def rows_of(count: int, picture_width: int) -> tuple[range, ...]:
    """Which pictures stand in which row where as many stand side by side as a screen is wide."""
    longest = max(1, MAX_WIDTH_PX // picture_width)
    return _rows(count, -(-count // -(-count // longest)))


def _rows(count: int, num_columns: int) -> tuple[range, ...]:
    return tuple(range(i, min(i + num_columns, count)) for i in range(0, count, num_columns))


def _filter(facts: Sequence[VideoFacts], grid: Grid, num_frames: int) -> str:
    """ffmpeg's filter graph: hold last frames, stack rows, lay each row's band above it."""
    picture_width, band, width, rows = grid.picture_width, grid.band, grid.width, grid.rows
    fitted = f"scale={picture_width}:{grid.picture_height}:flags=bicubic"
    shrink = "" if picture_width == facts[0].width else f",{fitted}"
    parts = [
        f"[{i}:v]setpts=PTS-STARTPTS{shrink},"
        f"tpad=stop={num_frames - each.num_frames}:stop_mode=clone[v{i}]"
        for i, each in enumerate(facts)
    ]
    for number, row in enumerate(rows):
        joined = "".join(f"[v{i}]" for i in row)
        joined += f"hstack=inputs={len(row)}" if len(row) > 1 else "null"
        left = _left_edge(len(row), picture_width, width)
        colours = "format=rgb24,scale=out_color_matrix=bt709:out_range=tv,format=yuv420p"
        parts += [
            f"{joined},pad={width}:ih+{band}:{left}:{band}:white[room{number}]",
            f"[{len(facts) + number}:v]{colours}[band{number}]",
            f"[room{number}][band{number}]overlay=0:0:eof_action=repeat[row{number}]",
        ]
    stack = "".join(f"[row{number}]" for number in range(len(rows)))
    parts.append(stack + (f"vstack=inputs={len(rows)}" if len(rows) > 1 else "null") + "[out]")
    return ";".join(parts)


def _left_edge(count: int, picture_width: int, width: int) -> int:
    """Where a row begins that stands in the middle; even, as yuv420p halves both axes."""
    return 2 * ((width - count * picture_width) // 4)


def band_height(picture_height: int) -> int:
    """Height of the label band in pixels: even, and in proportion to the picture.

    Of a picture that is taller than wide, the width counts.
    """
    return 2 * max(12, round(picture_height / 28))


def label_band(
    labels: Sequence[str],
    picture_width: int,
    picture_height: int,
    width: int | None = None,
    inks: Sequence[str] | None = None,
) -> UInt8[np.ndarray, "B W 3"]:
    """The band above a row of pictures, each label in one line, centred over its picture.

    Args:
        width: of the band, if it is wider than its row, which then stands in the middle.
        inks: that labels are written in, as #rrggbb.
    """
    height = band_height(picture_height)
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
        kept = len(label)
        while draw.textlength(label, font) > widest:
            kept -= 1
            label = label[:kept] + "..."
        middle = (left + picture_width * (index + 0.5), height / 2)
        draw.text(middle, label, fill=inks[index] if inks else _INK, font=font, anchor="mm")
    return np.asarray(band)


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
