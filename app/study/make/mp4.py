"""What an mp4 file tells besides its picture: boxes, times, and each picture's size. Read without
ffmpeg.

What fills a frame up is a message that decoders pass over (SEI, user data), of bytes that cannot
be compressed, as the picture's own cannot.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from app.errors import RunError
from model.storage.files import written_atomically

_CONTAINERS = {b"moov", b"trak", b"mdia", b"minf", b"stbl", b"edts", b"dinf"}
_TIMED = {b"mvhd", b"tkhd", b"mdhd"}


@dataclass(frozen=True)
class Track:
    """One stream of a file."""

    handler: str
    """``vide`` or ``soun``."""
    duration: float
    """Seconds."""
    sizes: tuple[int, ...]
    """Bytes of each sample: the stream itself, without the file around it."""
    description: bytes
    """The codec's settings (`stsd`), and how its samples are timed (`stts`, `elst`)."""


@dataclass(frozen=True)
class Mp4:
    """One file."""

    num_bytes: int
    boxes: tuple[str, ...]
    """Kinds of all boxes, in order."""
    has_times: bool
    """Whether a creation or modification time is set."""
    names: tuple[bytes, ...]
    """What the handlers call themselves."""
    tracks: tuple[Track, ...]

    def track(self, handler: str) -> Track | None:
        return next((track for track in self.tracks if track.handler == handler), None)


def read_mp4(path: Path) -> Mp4:
    """Take a file apart.

    Raises:
        RunError: if it is no whole mp4.
    """
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
            boxes=tuple(kind.decode("latin-1") for kind, _ in boxes),
            has_times=any(any(_numbers(body)[:2]) for kind, body in boxes if kind in _TIMED),
            names=tuple(body[24:].rstrip(b"\0") for kind, body in boxes if kind == b"hdlr"),
            tracks=tuple(map(_track, tracks)),
        )
    except (ValueError, LookupError) as error:
        raise RunError(f"{path.name} is no whole mp4 file: {error}.") from error


def blank_user_data(path: Path) -> None:
    """Turn `udta` boxes, which muxers write even when there is nothing to say, into empty room."""
    data = bytearray(path.read_bytes())
    for kind, start, end in list(_places(bytes(data), 0, len(data))):
        if kind == b"udta":
            data[start - 4 : end] = b"free" + bytes(end - start)
    path.write_bytes(data)


def _places(data: bytes, start: int, end: int) -> Iterator[tuple[bytes, int, int]]:
    """All boxes, containers before what they hold: kind, and where their contents begin and end."""
    while start < end:
        size, kind = int.from_bytes(data[start : start + 4], "big"), data[start + 4 : start + 8]
        header = 8
        if size == 1:
            size, header = int.from_bytes(data[start + 8 : start + 16], "big"), 16
        if size < header or start + size > end:
            raise ValueError(f"the box at byte {start} does not fit")
        yield kind, start + header, start + size
        if kind in _CONTAINERS:
            yield from _places(data, start + header, start + size)
        start += size


def _track(found: dict[bytes, bytes]) -> Track:
    _, _, scale, units = _numbers(found[b"mdhd"])
    sizes = found[b"stsz"]
    fixed, count, *each = np.frombuffer(sizes[4 : 4 + (len(sizes) - 4) // 4 * 4], ">u4").tolist()
    if not fixed and len(each) < count:
        raise ValueError(f"it names {count} samples and not their sizes")
    kinds = (b"stsd", b"stts", b"elst", b"tkhd")
    return Track(
        handler=found[b"hdlr"][8:12].decode("latin-1"),
        duration=units / scale,
        sizes=(fixed,) * count if fixed else tuple(each[:count]),
        description=b"|".join(found.get(kind, b"") for kind in kinds),
    )


def _numbers(header: bytes) -> tuple[int, int, int, int]:
    """Of an `mvhd` or `mdhd` creation and modification time, time scale and duration; a `tkhd`
    begins with the same times."""
    length = 8 if header[0] == 1 else 4
    ends = np.cumsum([4, length, length, 4, length])
    first, second, scale, units = (
        int.from_bytes(header[start:end], "big") for start, end in pairwise(ends.tolist())
    )
    return first, second, scale, units


_START_CODE = re.compile(rb"\x00{2,3}\x01")
_START = b"\x00\x00\x00\x01"
"""In an mp4 each unit has four bytes of length, so four are counted here too."""
_SLICES = (1, 5)
_MESSAGE, _FILLER = 6, 12
_USER_DATA = 5
_NAME_BYTES = 16
_LEAST = len(_START) + 3 + _NAME_BYTES + 1
"""Bytes of the smallest message: kind, kind of payload, length, name, end."""


def frames_of(stream: bytes) -> list[list[bytes]]:
    """Units by frame: what comes before a picture's slice belongs to it. One slice a picture."""
    frames: list[list[bytes]] = [[]]
    for unit in _START_CODE.split(stream)[1:]:
        frames[-1].append(unit)
        if unit[0] & 31 in _SLICES:
            frames.append([])
    return frames[:-1]


def joined(frames: Sequence[Sequence[bytes]]) -> bytes:
    """A stream of these units."""
    return b"".join(_START + unit for units in frames for unit in units)


def num_picture_bytes(stream: bytes) -> int:
    """Without what only fills it up."""
    units = _START_CODE.split(stream)[1:]
    own = [unit for unit in units if unit[0] & 31 not in (_MESSAGE, _FILLER)]
    return sum(len(_START) + len(unit) for unit in own)


def fill_alike(streams: Sequence[Path]) -> None:
    """Fill up frame by frame until the n-th frames of all streams have the same number of bytes."""
    all_frames = [frames_of(path.read_bytes()) for path in streams]
    # As many for all: a frame that has none would be seen to be the largest.
    targets = [max(map(_size, frames)) + 2 * _LEAST for frames in zip(*all_frames, strict=True)]
    for path, frames in zip(streams, all_frames, strict=True):
        seed = hashlib.sha256(path.read_bytes()).digest()
        rng = np.random.default_rng(int.from_bytes(seed, "big"))
        filled = [
            [*units[:-1], *_messages(target - _size(units), rng), units[-1]]
            for units, target in zip(frames, targets, strict=True)
        ]
        with written_atomically(path) as part:
            part.write_bytes(joined(filled))


def _size(units: Sequence[bytes]) -> int:
    return sum(len(_START) + len(unit) for unit in units)


def _messages(num_bytes: int, rng: np.random.Generator) -> list[bytes]:
    """Two that take so many bytes with their start codes: some lengths no single one can have."""
    for second in (_NAME_BYTES, _NAME_BYTES + 1):
        wanted = num_bytes - _message_size(second)
        for first in range(wanted - 8 - wanted // 255, wanted - 7):
            if _message_size(first) == wanted:
                return [_message(first, rng), _message(second, rng)]
    raise AssertionError(num_bytes)


def _message_size(payload: int) -> int:
    return len(_START) + 2 + payload // 255 + 1 + payload + 1


def _message(payload: int, rng: np.random.Generator) -> bytes:
    """Bytes without zeros look like no start code."""
    content = rng.integers(1, 256, payload, np.uint8).tobytes()
    length = b"\xff" * (payload // 255) + bytes([payload % 255])
    return bytes([_MESSAGE, _USER_DATA]) + length + content + b"\x80"
