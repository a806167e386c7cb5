"""Bare H.264 streams, frame by frame: how large each picture is, and made equally large.

What fills a frame up is a message that decoders pass over (SEI, user data), of bytes that cannot
be compressed, as the picture's own cannot.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from model.storage.files import written_atomically

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
