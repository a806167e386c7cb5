"""Videos of a study that differ in what they show and in nothing else that can be measured.

Picture: H.264 at a fixed rate, without B-frames, a key frame each second, no encoder's note, then
filled up so that the n-th pictures of all videos of a scene have exactly the same number of bytes
(a fixed quality would make jittery motion the larger file). A light grain, the same in every video,
takes what bits a calm picture leaves, so that hardly anything has to be filled up. One thread: with
more, x264's rate control gives other bytes each time. Sound: one AAC stream for each speech, copied
into every file.
"""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from app.errors import RunError
from app.study.make.mp4 import blank_user_data, frames_of, joined
from conventions.rates import FPS
from model.speech.audio import write_wav
from model.storage.files import written_atomically
from renderer.video.encoder import VideoError, run_ffmpeg

TARGET_LUFS = -23.0
"""Programme loudness of EBU R128."""
PEAK_DBFS = -1.0
"""What the limiter lets through; speech at -23 LUFS seldom reaches it."""
SILENT_LUFS = -60.0

BITS_PER_PIXEL = 0.2
MIN_BIT_RATE = 100_000
MAX_ENCODINGS = 4
RATE_TOLERANCE = 0.004
"""Of the rate that the encoder was asked for."""
RATE_STEP = 0.01
"""Between the rates of two videos of a scene, so that chance does not decide which is filled up
more; see `app.study.export`."""
_GRAIN = "noise=c0s=4:c0f=t:all_seed=7"

LONG_AGO_S = 946_684_800
"""2000-01-01, the modification time of every file that participants get."""

_BITEXACT = ("-map_metadata", "-1", "-map_chapters", "-1", "-fflags", "+bitexact",
             "-flags", "+bitexact")  # fmt: skip
_X264 = "level=40:force-cfr=1:colorprim=bt709:transfer=bt709:colormatrix=bt709"
_TICKS = 1_200_000 // FPS
"""Of one frame, in the time base of ffmpeg's reader of bare H.264; it rounds by itself."""
_LEAST_BOX = 8


def encode_speech(waveform: np.ndarray, out: Path, clip: str) -> None:
    """Speech at 16 kHz as one AAC track of -23 LUFS.

    Raises:
        RunError: if the excerpt is silent.
    """
    with tempfile.TemporaryDirectory() as folder:
        wav = Path(folder) / "excerpt.wav"
        write_wav(wav, waveform)
        loudness = measure_loudness(wav)
        if loudness < SILENT_LUFS:
            raise RunError(f"The excerpt of clip {clip!r} is silent; take a longer or another one.")
        gain_db = TARGET_LUFS - loudness
        limit = 10 ** (PEAK_DBFS / 20)
        level = f"volume={gain_db:.3f}dB,alimiter=limit={limit:.4f}:level=false,aresample=48000"
        with written_atomically(out) as part:
            run_ffmpeg(
                *("-i", str(wav), "-af", level, "-ac", "1", "-c:a", "aac", "-b:a", "128k"),
                *(*_BITEXACT, str(part)),
            )


def measure_loudness(path: Path) -> float:
    """Integrated loudness of the sound in a file by EBU R128, in LUFS; -70 is silence."""
    said = run_ffmpeg(
        *("-i", str(path), "-map", "0:a:0", "-af", "ebur128=framelog=quiet", "-f", "null", "-"),
        log="info",
    )
    found = re.findall(r"I:\s+(-?[\d.]+) LUFS", said)
    if not found:
        raise VideoError(f"The loudness of {path.name} could not be measured.")
    return float(found[-1])


def bit_rate(size: int) -> int:
    """Bits per second of a square picture of that many pixels."""
    return max(MIN_BIT_RATE, round(BITS_PER_PIXEL * size * size * FPS))


def encode_picture(drawn: Path, out: Path, size: int, share: float = 1.0) -> None:
    """The picture of a video as a bare H.264 stream of the fixed rate, with a light grain.

    Args:
        share: of the rate, which is held as nearly as the encoder can.
    """
    wanted = share * bit_rate(size)
    rate, best = wanted, None
    with tempfile.TemporaryDirectory(dir=out.parent) as folder:
        for number in range(MAX_ENCODINGS):
            part = Path(folder) / f"{number}.h264"
            frames = _encode(drawn, part, round(rate))
            found = 8 * FPS * part.stat().st_size / frames
            if best is None or abs(found - wanted) < abs(best[0] - wanted):
                best = found, part
            if abs(found - wanted) <= RATE_TOLERANCE * wanted:
                break
            rate *= wanted / found
        assert best is not None
        os.replace(best[1], out)


def _encode(drawn: Path, out: Path, rate: int) -> int:
    """Number of frames."""
    run_ffmpeg(
        *("-threads", "1", "-filter_threads", "1", "-i", str(drawn), "-map", "0:v:0", "-an"),
        *("-vf", _GRAIN, "-c:v", "libx264", "-preset", "fast", "-threads", "1"),
        *("-pix_fmt", "yuv420p", "-b:v", str(rate), "-minrate", str(rate), "-maxrate", str(rate)),
        *("-bufsize", str(rate // 2), "-bf", "0", "-g", str(FPS), "-keyint_min", str(FPS)),
        *("-sc_threshold", "0", "-x264-params", _X264),
        *_BITEXACT,
        # x264 writes its settings into the stream (NAL type 6), and what fills a frame up (12).
        *("-bsf:v", "filter_units=remove_types=6|12", "-f", "h264", str(out)),
    )
    frames = frames_of(out.read_bytes())
    out.write_bytes(joined(frames))
    return len(frames)


def join(stream: Path, track: Path | None, out: Path) -> None:
    """Picture, and sound if there is any, copied as they are into one mp4."""
    sound = () if track is None else ("-i", str(track), "-map", "0:v:0", "-map", "1:a:0")
    with written_atomically(out) as part:
        run_ffmpeg(
            *("-framerate", str(FPS), "-f", "h264", "-i", str(stream), *sound, "-c", "copy"),
            *("-bsf:v", f"setts=ts=N*{_TICKS}:duration={_TICKS}"),
            *(*_BITEXACT, "-write_btrt", "0", "-movflags", "+faststart", str(part)),
        )
        blank_user_data(part)


def pad_alike(videos: Sequence[Path]) -> None:
    """Append an empty `free` box until all files have the same length."""
    sizes = {path: path.stat().st_size for path in videos}
    target = max(sizes.values())
    if any(0 < target - size < _LEAST_BOX for size in sizes.values()):
        target += _LEAST_BOX
    for path, size in sizes.items():
        if size < target:
            box = (target - size).to_bytes(4, "big") + b"free" + bytes(target - size - _LEAST_BOX)
            with written_atomically(path) as part:
                part.write_bytes(path.read_bytes() + box)


def set_time(path: Path) -> None:
    """Give a file or folder the time that all of them have."""
    os.utime(path, (LONG_AGO_S, LONG_AGO_S))


def sound_digest(path: Path) -> str | None:
    """Digest of a video's sound as it is stored; None when it has none."""
    try:
        return run_ffmpeg("-i", str(path), "-map", "0:a", "-c", "copy", "-f", "hash", "-").strip()
    except VideoError as error:
        if "matches no streams" in str(error):
            return None
        raise


def picture_stream(path: Path) -> bytes:
    """The picture of a video as a bare H.264 stream."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "picture.h264"
        copy = ("-map", "0:v:0", "-c", "copy", "-bsf:v", "h264_mp4toannexb", "-f", "h264")
        run_ffmpeg("-i", str(path), *copy, str(out))
        return out.read_bytes()
