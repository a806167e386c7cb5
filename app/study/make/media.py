"""Encoding of study videos that differ only in content, and in nothing else that can be measured.

Picture: H.264 at a fixed rate, without B-frames, a key frame each second, no encoder's note, then
padded so that the n-th frames of all videos of a scene have exactly the same number of bytes (a
fixed quality would make jittery motion the larger file). A light grain, the same in every video,
uses the bits that calm motion leaves, so that hardly any padding is needed. The padding of a frame
is a message that decoders skip (SEI, user data), of bytes that cannot be compressed, like those of
the picture. One thread: with more, x264's rate control gives other bytes each time. Sound: one AAC
stream for each speech, copied into every file.

The metadata of a file (boxes, times, size of each frame) are parsed without ffmpeg.
"""

from __future__ import annotations

import hashlib
import os
import re
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float32

from app.errors import RunError
from conventions.rates import FPS
from model.speech.audio import write_wav
from model.storage.files import write_atomically, written_atomically
from renderer.video.encoder import VideoError, run_ffmpeg

TARGET_LUFS = -23.0
"""Target loudness (LUFS), as in EBU R128."""
PEAK_DBFS = -1.0
"""Limiter threshold (dBFS); speech at -23 LUFS seldom reaches it."""
SILENT_LUFS = -60.0

BITS_PER_PIXEL = 0.2
MIN_BIT_RATE = 100_000
MAX_ENCODINGS = 4
RATE_TOLERANCE = 0.004
"""Relative tolerance of the encoder's bit rate."""
RATE_STEP_BETWEEN_VIDEOS = 0.01
"""Relative step between the rates of two videos of a scene, so that chance does not decide which is
padded more; see `app.study.export`.
"""
_FILM_GRAIN_FILTER = "noise=c0s=4:c0f=t:all_seed=7"

FIXED_MTIME_S = 946_684_800
"""Modification time of every file for participants: 2000-01-01 (s since 1970)."""

_BITEXACT = ("-map_metadata", "-1", "-map_chapters", "-1", "-fflags", "+bitexact",
             "-flags", "+bitexact")  # fmt: skip
_X264 = "level=40:force-cfr=1:colorprim=bt709:transfer=bt709:colormatrix=bt709"
_TICKS = 1_200_000 // FPS
"""Duration of a frame in the time base of ffmpeg's raw H.264 demuxer, which rounds by itself."""
_MIN_BOX = 8


def encode_speech(waveform: Float32[np.ndarray, " N"], out: Path, clip: str) -> None:
    """Encode speech at 16 kHz as one AAC track of -23 LUFS; raises RunError if it is silent."""
    with tempfile.TemporaryDirectory() as folder:
        wav = Path(folder) / "excerpt.wav"
        write_wav(wav, waveform)
        loudness = measure_loudness(wav)
        if loudness < SILENT_LUFS:
            raise RunError(
                f"The excerpt of clip {clip!r} is silent; choose a longer or a different excerpt."
            )
        gain_db = TARGET_LUFS - loudness
        limit = 10 ** (PEAK_DBFS / 20)
        level = f"volume={gain_db:.3f}dB,alimiter=limit={limit:.4f}:level=false,aresample=48000"
        with written_atomically(out) as part:
            run_ffmpeg(
                "-i", str(wav), "-af", level, "-ac", "1", "-c:a", "aac", "-b:a", "128k",
                *_BITEXACT, str(part),
            )  # fmt: skip


def measure_loudness(path: Path) -> float:
    """Measure the integrated loudness of a file by EBU R128, in LUFS; -70 is silence."""
    log = run_ffmpeg(
        "-i", str(path), "-map", "0:a:0", "-af", "ebur128=framelog=quiet", "-f", "null", "-",
        log_level="info",
    )  # fmt: skip
    loudness = re.findall(r"I:\s+(-?[\d.]+) LUFS", log)
    if not loudness:
        raise VideoError(f"The loudness of {path.name} could not be measured.")
    return float(loudness[-1])


def bit_rate(size_px: int) -> int:
    """Return the bits per second of a square picture of ``size_px`` pixels."""
    return max(MIN_BIT_RATE, round(BITS_PER_PIXEL * size_px * size_px * FPS))


def encode_video_stream(drawn: Path, out: Path, size: int, rate_share: float = 1.0) -> None:
    """Encode a picture as raw H.264 with light grain, at about ``rate_share`` of the rate."""
    wanted = rate_share * bit_rate(size)
    rate, best = wanted, None
    with tempfile.TemporaryDirectory(dir=out.parent) as folder:
        for number in range(MAX_ENCODINGS):
            part = Path(folder) / f"{number}.h264"
            frames = _encode(drawn, part, round(rate))
            measured_rate = 8 * FPS * part.stat().st_size / frames
            if best is None or abs(measured_rate - wanted) < abs(best[0] - wanted):
                best = measured_rate, part
            if abs(measured_rate - wanted) <= RATE_TOLERANCE * wanted:
                break
            rate *= wanted / measured_rate
        assert best is not None
        os.replace(best[1], out)


def _encode(drawn: Path, out: Path, rate: int) -> int:
    """Encode once without padding; return the number of frames."""
    run_ffmpeg(
        "-threads", "1", "-filter_threads", "1", "-i", str(drawn), "-map", "0:v:0", "-an",
        "-vf", _FILM_GRAIN_FILTER, "-c:v", "libx264", "-preset", "fast", "-threads", "1",
        "-pix_fmt", "yuv420p", "-b:v", str(rate), "-minrate", str(rate), "-maxrate", str(rate),
        "-bufsize", str(rate // 2), "-bf", "0", "-g", str(FPS), "-keyint_min", str(FPS),
        "-sc_threshold", "0", "-x264-params", _X264,
        *_BITEXACT,
        # x264 writes its settings (NAL type 6) and padding (12) into the stream.
        "-bsf:v", "filter_units=remove_types=6|12", "-f", "h264", str(out),
    )  # fmt: skip
    frames = split_into_frames(out.read_bytes())
    out.write_bytes(join_units(frames))
    return len(frames)


def mux_mp4(stream: Path, track: Path | None, out: Path) -> None:
    """Mux the picture, and sound if any, into one MP4 without re-encoding."""
    sound = () if track is None else ("-i", str(track), "-map", "0:v:0", "-map", "1:a:0")
    with written_atomically(out) as part:
        run_ffmpeg(
            "-framerate", str(FPS), "-f", "h264", "-i", str(stream), *sound, "-c", "copy",
            "-bsf:v", f"setts=ts=N*{_TICKS}:duration={_TICKS}",
            *_BITEXACT, "-write_btrt", "0", "-movflags", "+faststart", str(part),
        )  # fmt: skip
        blank_user_data(part)


def pad_to_equal_bytes(videos: Sequence[Path]) -> None:
    """Append an empty `free` box until all files have the same length."""
    sizes = {path: path.stat().st_size for path in videos}
    target = max(sizes.values())
    if any(0 < target - size < _MIN_BOX for size in sizes.values()):
        target += _MIN_BOX
    for path, size in sizes.items():
        if size < target:
            box = (target - size).to_bytes(4, "big") + b"free" + bytes(target - size - _MIN_BOX)
            write_atomically(path, path.read_bytes() + box)


def set_fixed_mtime(path: Path) -> None:
    """Set the modification time that all files of a bundle share."""
    os.utime(path, (FIXED_MTIME_S, FIXED_MTIME_S))


def audio_digest(path: Path) -> str | None:
    """Return a digest of a video's encoded sound; None without sound."""
    try:
        return run_ffmpeg("-i", str(path), "-map", "0:a", "-c", "copy", "-f", "hash", "-").strip()
    except VideoError as error:
        if "matches no streams" in str(error):
            return None
        raise


def video_stream(path: Path) -> bytes:
    """Return the picture of a video as a raw H.264 stream."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "picture.h264"
        copy = ("-map", "0:v:0", "-c", "copy", "-bsf:v", "h264_mp4toannexb", "-f", "h264")
        run_ffmpeg("-i", str(path), *copy, str(out))
        return out.read_bytes()


_CONTAINERS = {b"moov", b"trak", b"mdia", b"minf", b"stbl", b"edts", b"dinf"}
_TIMED = {b"mvhd", b"tkhd", b"mdhd"}


@dataclass(frozen=True)
class Track:
    """One track of an MP4 file."""

    handler: str
    """Handler: ``vide`` or ``soun``."""
    duration_s: float
    """Duration (s)."""
    sample_sizes: tuple[int, ...]
    """Size of each sample (bytes): the stream itself, without its container."""
    codec_and_timing: bytes
    """Codec settings (`stsd`), timing of the samples (`stts`, `elst`), and header (`tkhd`)."""


@dataclass(frozen=True)
class Mp4:
    """Structure of an MP4 file."""

    num_bytes: int
    box_types: tuple[str, ...]
    """Types of all boxes, in order."""
    has_timestamps: bool
    """True if a creation or modification time is set."""
    handler_names: tuple[bytes, ...]
    """Names of the handlers."""
    tracks: tuple[Track, ...]

    def track(self, handler: str) -> Track | None:
        return next((track for track in self.tracks if track.handler == handler), None)


def read_mp4(path: Path) -> Mp4:
    """Parse an MP4 file; raises RunError if the file is not a complete MP4."""
    data = path.read_bytes()
    try:
        boxes = [(kind, data[start:end]) for kind, start, end in _places(data, 0, len(data))]
        if not any(kind == b"moov" for kind, _ in boxes):
            raise ValueError("it has no `moov` box")
        tracks: list[dict[bytes, bytes]] = []
        for kind, body in boxes:
            if kind == b"trak":
                tracks.append({})
            if tracks:
                tracks[-1].setdefault(kind, body)
        return Mp4(
            num_bytes=len(data),
            box_types=tuple(kind.decode("latin-1") for kind, _ in boxes),
            has_timestamps=any(any(_numbers(body)[:2]) for kind, body in boxes if kind in _TIMED),
            handler_names=tuple(body[24:].rstrip(b"\0") for kind, body in boxes if kind == b"hdlr"),
            tracks=tuple(map(_track, tracks)),
        )
    except (ValueError, LookupError) as error:
        raise RunError(f"{path.name} is not a complete MP4 file: {error}.") from error


def blank_user_data(path: Path) -> None:
    """Replace `udta` boxes, which muxers write even if empty, with `free` boxes of equal length."""
    data = bytearray(path.read_bytes())
    for kind, start, end in list(_places(bytes(data), 0, len(data))):
        if kind == b"udta":
            data[start - 4 : end] = b"free" + bytes(end - start)
    path.write_bytes(data)


def _places(data: bytes, start: int, end: int) -> Iterator[tuple[bytes, int, int]]:
    """Yield type, start and end of the contents of all boxes, containers before their children."""
    while start < end:
        size, kind = int.from_bytes(data[start : start + 4], "big"), data[start + 4 : start + 8]
        header = 8
        if size == 1:
            size, header = int.from_bytes(data[start + 8 : start + 16], "big"), 16
        if size < header or start + size > end:
            raise ValueError(f"the box at byte {start} has an invalid size")
        yield kind, start + header, start + size
        if kind in _CONTAINERS:
            yield from _places(data, start + header, start + size)
        start += size


def _track(boxes: dict[bytes, bytes]) -> Track:
    _, _, scale, units = _numbers(boxes[b"mdhd"])
    sizes = boxes[b"stsz"]
    fixed, count, *each = np.frombuffer(sizes[4 : 4 + (len(sizes) - 4) // 4 * 4], ">u4").tolist()
    if not fixed and len(each) < count:
        raise ValueError(f"the sizes of its {count} samples are missing")
    kinds = (b"stsd", b"stts", b"elst", b"tkhd")
    return Track(
        handler=boxes[b"hdlr"][8:12].decode("latin-1"),
        duration_s=units / scale,
        sample_sizes=(fixed,) * count if fixed else tuple(each[:count]),
        codec_and_timing=b"|".join(boxes.get(kind, b"") for kind in kinds),
    )


def _numbers(header: bytes) -> tuple[int, int, int, int]:
    """Parse creation and modification time (also of a `tkhd`), time scale and duration."""
    length = 8 if header[0] == 1 else 4
    ends = np.cumsum([4, length, length, 4, length])
    first, second, scale, units = (
        int.from_bytes(header[start:end], "big") for start, end in pairwise(ends.tolist())
    )
    return first, second, scale, units


_START_CODE = re.compile(rb"\x00{2,3}\x01")
_START = b"\x00\x00\x00\x01"
"""Start code of four bytes, as long as the length of each unit in an MP4."""
_SLICES = (1, 5)
_MESSAGE, _FILLER = 6, 12
_USER_DATA = 5
_NAME_BYTES = 16
_LEAST = len(_START) + 3 + _NAME_BYTES + 1
"""Bytes of the smallest message: unit type, payload type, length, name, end."""


def split_into_frames(stream: bytes) -> list[list[bytes]]:
    """Split a stream into the NAL units of each frame, which ends with its one slice."""
    frames: list[list[bytes]] = [[]]
    for unit in _START_CODE.split(stream)[1:]:
        frames[-1].append(unit)
        if unit[0] & 31 in _SLICES:
            frames.append([])
    return frames[:-1]


def join_units(frames: Sequence[Sequence[bytes]]) -> bytes:
    """Join NAL units to a stream."""
    return b"".join(_START + unit for units in frames for unit in units)


def num_unpadded_bytes(stream: bytes) -> int:
    """Count the bytes of a stream without padding."""
    units = _START_CODE.split(stream)[1:]
    own = [unit for unit in units if unit[0] & 31 not in (_MESSAGE, _FILLER)]
    return sum(len(_START) + len(unit) for unit in own)


def equalise_frame_bytes(streams: Sequence[Path]) -> None:
    """Pad frame by frame until the n-th frames of all streams have the same number of bytes."""
    all_frames = [split_into_frames(path.read_bytes()) for path in streams]
    # Every frame gets messages: one without them would be known as the largest.
    targets = [max(map(_size, frames)) + 2 * _LEAST for frames in zip(*all_frames, strict=True)]
    for path, frames in zip(streams, all_frames, strict=True):
        seed = hashlib.sha256(path.read_bytes()).digest()
        rng = np.random.default_rng(int.from_bytes(seed, "big"))
        filled = [
            [*units[:-1], *_messages(target - _size(units), rng), units[-1]]
            for units, target in zip(frames, targets, strict=True)
        ]
        write_atomically(path, join_units(filled))


def _size(units: Sequence[bytes]) -> int:
    return sum(len(_START) + len(unit) for unit in units)


def _messages(num_bytes: int, rng: np.random.Generator) -> list[bytes]:
    """Make two padding messages with a total length: a single one cannot have every length."""
    for second in (_NAME_BYTES, _NAME_BYTES + 1):
        wanted = num_bytes - _message_size(second)
        for first in range(wanted - 8 - wanted // 255, wanted - 7):
            if _message_size(first) == wanted:
                return [_message(first, rng), _message(second, rng)]
    raise AssertionError(num_bytes)


def _message_size(payload: int) -> int:
    return len(_START) + 2 + payload // 255 + 1 + payload + 1


def _message(payload: int, rng: np.random.Generator) -> bytes:
    """Make a padding message; bytes without zeros cannot look like a start code."""
    content = rng.integers(1, 256, payload, np.uint8).tobytes()
    length = b"\xff" * (payload // 255) + bytes([payload % 255])
    return bytes([_MESSAGE, _USER_DATA]) + length + content + b"\x80"
