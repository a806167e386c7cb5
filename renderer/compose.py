"""Several videos side by side in lock-step, each under its name, with one sound track."""

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from PIL import Image, ImageDraw, ImageFont

from renderer.video import (
    DEFAULT_CRF,
    Cancelled,
    Encoder,
    VideoError,
    VideoFacts,
    check_sound,
    encoding,
    read_facts,
)

MAX_VIDEOS = 6
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
) -> None:
    """Write one row of videos, with a band of labels above the pictures.

    Frame n of the result shows frame n of every video; a shorter video holds its last frame.
    ffmpeg decodes and encodes in its own process, so memory does not grow with the length.

    Args:
        labels: one for each video; drawn smaller, or cut, if it is too long for its picture.
        on_progress: called with the share done, 0 to 1.
        should_cancel: asked several times a second.

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
    with tempfile.TemporaryDirectory() as folder:
        band = Path(folder) / "labels.png"
        Image.fromarray(label_band(labels, first.width, first.height)).save(band)
        inputs = [part for video in videos for part in ("-i", str(video))]
        inputs += ["-i", str(band)]
        if speech_wav is not None:
            inputs += ["-i", str(speech_wav)]
        encoder = Encoder(
            out,
            [
                *inputs,
                *("-filter_complex", _row_filter(facts, num_frames), "-map", "[out]"),
                *encoding(num_frames, crf, None if speech_wav is None else len(videos) + 1),
            ],
            stdin=False,
        )
        _run(encoder, num_frames, on_progress, should_cancel)


def _run(
    encoder: Encoder,
    num_frames: int,
    on_progress: Callable[[float], None] | None,
    should_cancel: Callable[[], bool] | None,
) -> None:
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


def _row_filter(facts: Sequence[VideoFacts], num_frames: int) -> str:
    """ffmpeg's filter graph: hold last frames, stack, make room for the band, lay it on top."""
    count = len(facts)
    held = [
        f"[{i}:v]setpts=PTS-STARTPTS,tpad=stop={num_frames - each.num_frames}:stop_mode=clone[v{i}]"
        for i, each in enumerate(facts)
    ]
    row = "".join(f"[v{i}]" for i in range(count))
    row += f"hstack=inputs={count}[row]" if count > 1 else "null[row]"
    band = band_height(facts[0].height)
    return ";".join(
        [
            *held,
            row,
            f"[row]pad=iw:ih+{band}:0:{band}[room]",
            f"[{count}:v]format=rgb24,scale=out_color_matrix=bt709:out_range=tv,format=yuv420p[band]",
            "[room][band]overlay=0:0:eof_action=repeat[out]",
        ]
    )


def band_height(picture_height: int) -> int:
    """Height of the label band in pixels: even, and in proportion to the picture."""
    return 2 * max(12, round(picture_height / 28))


def label_band(
    labels: Sequence[str], picture_width: int, picture_height: int
) -> UInt8[np.ndarray, "B W 3"]:
    """The band above a row of pictures, each label centred over its picture."""
    height = band_height(picture_height)
    band = Image.new("RGB", (picture_width * len(labels), height), _PAPER)
    draw = ImageDraw.Draw(band)
    widest = 0.94 * picture_width
    for index, label in enumerate(labels):
        size = height * 0.55
        font = ImageFont.load_default(size)
        if draw.textlength(label, font) > widest:
            shrunk = size * widest / draw.textlength(label, font)
            font = ImageFont.load_default(max(shrunk, _SMALLEST_LABEL * height))
        kept = len(label)
        while draw.textlength(label, font) > widest:
            kept -= 1
            label = label[:kept] + "..."
        middle = (picture_width * (index + 0.5), height / 2)
        draw.text(middle, label, fill=_INK, font=font, anchor="mm")
    return np.asarray(band)
