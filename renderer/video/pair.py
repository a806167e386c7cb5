"""Two videos of one place laid over each other: as a ghost, behind a wipe, or taking turns."""

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

from PIL import Image

from conventions.rates import FPS
from renderer.scene.panels import Panel
from renderer.video.compose import band_height, label_band, run_encoder
from renderer.video.encoder import (
    DEFAULT_CRF,
    Encoder,
    VideoError,
    check_size,
    check_sound,
    encoding,
    read_facts,
)

Overlay = Literal["ghost", "wipe", "flicker"]
OVERLAYS: tuple[Overlay, ...] = get_args(Overlay)
FLICKER_FRAMES = 15
"""One change in half a second: far below what can do harm to anyone."""


@dataclass(frozen=True)
class PairLayout:
    """How two pictures share one."""

    width: int
    height: int
    body: Panel
    """Where both bodies stand, in each of the pictures and in the whole."""
    beside: tuple[Panel, ...] = ()
    """Close-ups of the second, which its picture has where the whole has them."""
    edge: int = 0
    """Of a wipe: so many columns of the body's panel show the first."""

    @property
    def shorter(self) -> int:
        """Side of half the picture, by which names are as large as they are."""
        return min(self.width // 2, self.height)


def compose_pair(
    videos: Sequence[Path],
    labels: Sequence[str],
    overlay: Overlay,
    layout: PairLayout,
    out: Path,
    speech_wav: Path | None = None,
    crf: int = DEFAULT_CRF,
    on_progress: Callable[[float], None] | None = None,
    should_cancel: Callable[[], bool] | None = None,
    inks: Sequence[str] = ("#d55e00", "#0072b2"),
) -> None:
    """Write the first of two videos with the second laid over its body and beside it.

    A ghost has each printed in its own ink, one over the other. A shorter video holds its last
    frame.

    Args:
        labels: of both, in a band above.
        on_progress, should_cancel: as of `renderer.video.compose.compose_videos`.
        inks: of a ghost, as #rrggbb.

    Raises:
        Cancelled: if ``should_cancel`` said so; no file is left.
        ValueError: if the sizes cannot be.
        VideoError: if a video cannot be read, or ffmpeg fails; no file is left.
    """
    check_size(layout.width, layout.height)
    facts = [read_facts(video) for video in videos]
    for video, each in zip(videos, facts, strict=True):
        if each.width > layout.width or each.height > layout.height:
            raise VideoError(f"{video.name} is larger than the picture that it is to lie in.")
    check_sound(speech_wav)
    num_frames = max(each.num_frames for each in facts)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "labels.png"
        band = label_band(
            labels,
            layout.width // 2,
            layout.shorter,
            layout.width,
            inks if overlay == "ghost" else None,
        )
        Image.fromarray(band).save(path)
        inputs = [part for each in (*videos, path) for part in ("-i", str(each))]
        if speech_wav is not None:
            inputs += ["-i", str(speech_wav)]
        holds = [num_frames - each.num_frames for each in facts]
        encoder = Encoder(
            out,
            [
                *inputs,
                *("-filter_complex", _filter(overlay, layout, holds, inks), "-map", "[out]"),
                *encoding(num_frames, crf, None if speech_wav is None else 3),
            ],
            stdin=False,
        )
        run_encoder(encoder, num_frames, on_progress, should_cancel)


def _filter(overlay: Overlay, layout: PairLayout, holds: Sequence[int], inks: Sequence[str]) -> str:
    """ffmpeg's filter graph: both padded to the whole; what the second has in it laid over it."""
    size = f"{layout.width}:{layout.height}"
    band = band_height(layout.shorter)
    body = layout.body
    beside = [_crop(panel) for panel in layout.beside]
    names = [f"[side{i}]" for i in range(len(beside))]
    whole = [
        f"[{i}:v]setpts=PTS-STARTPTS,tpad=stop={hold}:stop_mode=clone,pad={size}:0:0:white"
        for i, hold in enumerate(holds)
    ]
    parts = [
        f"{whole[0]},split=2[first][base]",
        f"{whole[1]},split={1 + len(beside)}[second]{''.join(names)}",
        *(f"{name}{crop}{name[:-1]}c]" for name, crop in zip(names, beside, strict=True)),
    ]
    match overlay:
        case "ghost":
            grey = f"{_crop(body)},scale=in_color_matrix=bt709:in_range=tv,format=gbrp,{_GREY}"
            back = "scale=out_color_matrix=bt709:out_range=tv,format=yuv420p"
            parts += [
                f"[first]{grey},{_printed(inks[0])}[under]",
                f"[second]{grey},{_printed(inks[1])}[upper]",
                f"[under][upper]blend=all_mode=darken,{back}[over]",
            ]
            where, when = (body.left, body.top), ""
        case "wipe":
            edge = max(0, min(layout.edge, body.width - 2)) // 2 * 2
            right = Panel("", body.left + edge, body.top, body.width - edge, body.height)
            line = f"drawbox=0:0:2:{right.height}:white:fill"
            parts += ["[first]nullsink", f"[second]{_crop(right)},{line}[over]"]
            where, when = (right.left, right.top), ""
        case "flicker":
            turn = FLICKER_FRAMES / FPS
            parts += ["[first]nullsink", f"[second]{_crop(body)}[over]"]
            where = (body.left, body.top)
            when = f":enable='gte(mod(t+{0.5 / FPS:.6f},{2 * turn:g}),{turn:g})'"
    parts.append(f"[base][over]overlay={where[0]}:{where[1]}{when}[laid]")
    last = "laid"
    for i, panel in enumerate(layout.beside):
        parts.append(f"[{last}][side{i}c]overlay={panel.left}:{panel.top}[laid{i}]")
        last = f"laid{i}"
    colours = "format=rgb24,scale=out_color_matrix=bt709:out_range=tv,format=yuv420p"
    parts += [
        f"[{last}]pad={layout.width}:ih+{band}:0:{band}:white[room]",
        f"[2:v]{colours}[band]",
        "[room][band]overlay=0:0:eof_action=repeat[out]",
    ]
    return ";".join(parts)


_GREY = "colorchannelmixer=" + ":".join(
    f"{to}{of}={share}"
    for to in "rgb"
    for of, share in (("r", 0.2126), ("g", 0.7152), ("b", 0.0722))
)


def _printed(ink: str) -> str:
    """White paper, dark in this ink where the grey picture is dark."""
    shares = [int(ink[at : at + 2], 16) for at in (1, 3, 5)]
    return "lutrgb=" + ":".join(
        f"{channel}='{share}+{1 - share / 255:.4f}*val'"
        for channel, share in zip("rgb", shares, strict=True)
    )


def _crop(panel: Panel) -> str:
    return f"crop={panel.width}:{panel.height}:{panel.left}:{panel.top}"
