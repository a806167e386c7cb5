"""One video drawn by several processes: each draws every so-many-th piece of frames.

A driver's threads leave cores idle while Python skins and lights the next frame; processes do not.
The pictures come back in order and, since every piece is skinned as it would be by one process,
they are the same to the last bit. No process is ever ahead by more than a piece, so memory does
not grow with the length of a video.

The children are of ``renderer.video.worker_child``'s own process group and stop when their
pipes close: whoever ends the group, or dies, leaves none of them behind.
"""

import math
import os
import pickle
import queue
import subprocess
import sys
import tempfile
import threading
from collections.abc import Generator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO

import numpy as np
from jaxtyping import UInt8

from renderer.body.body import Body, BodyMotion
from renderer.draw.offscreen import GLError
from renderer.draw.probe import choose_backend
from renderer.scene.stage import Stage
from renderer.video.ended import memory_kills, obituary
from renderer.video.frames import PIECE_FRAMES, draw_frames, stage_for
from renderer.video.marks import Marks
from renderer.video.settings import RenderSettings

MIN_FRAMES_EACH = 300
"""With fewer frames a further process costs more to start than it saves: one alone already keeps
the driver's threads and ffmpeg busy beside its own."""
MAX_PROCESSES = 4
"""More draw faster than ffmpeg encodes, and each takes a quarter of a gigabyte."""


@dataclass(frozen=True)
class Share:
    """What one of several processes draws."""

    body: Body
    motion: BodyMotion
    frames: tuple[int, ...]
    settings: RenderSettings
    stage: Stage
    marks: Marks | None = None


def processes_worth(num_frames: int, num_cores: int) -> int:
    """How many processes are worth their start."""
    return max(1, min(num_cores, num_frames // MIN_FRAMES_EACH, MAX_PROCESSES))


def draw_in_processes(
    body: Body,
    motion: BodyMotion,
    settings: RenderSettings,
    stage: Stage | None,
    count: int,
    marks: Marks | None = None,
) -> Generator[UInt8[np.ndarray, "H W C"]]:
    """Yield the picture of each frame in order; close it to end the processes.

    Raises:
        GLError: if a process crashes.
    """
    stage = stage or stage_for(body, [motion], settings)
    settings = replace(settings, backend=settings.backend or choose_backend())
    width, height = settings.picture_size
    shape = (height, width, settings.num_channels)
    turns = [frame // PIECE_FRAMES % count for frame in range(motion.num_frames)]
    with ExitStack() as stack:
        children = []
        for number in range(count):
            frames = tuple(frame for frame, turn in enumerate(turns) if turn == number)
            share = Share(body, motion, frames, settings, stage, marks)
            children.append(stack.enter_context(_Painter(share)))
        for turn in turns:
            yield children[turn].picture(shape)


class _Painter:
    """A child that draws a share. Use it in ``with``."""

    def __init__(self, share: Share) -> None:
        self._share = share

    def __enter__(self) -> "_Painter":
        self._messages = tempfile.TemporaryFile()
        self._killed_before = memory_kills()
        self._process = subprocess.Popen(
            [sys.executable, "-X", "faulthandler", "-m", "renderer.video.parallel"],
            cwd=Path(__file__).parents[2],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._messages,
        )
        assert self._process.stdin is not None
        try:
            pickle.dump(self._share, self._process.stdin)
            self._process.stdin.flush()  # and left open: its end tells the child to stop
        except BrokenPipeError:  # told when a picture is asked for
            pass
        return self

    def picture(self, shape: tuple[int, int, int]) -> UInt8[np.ndarray, "H W C"]:
        """The next picture of the share."""
        assert self._process.stdout is not None
        num_bytes = math.prod(shape)
        pixels = self._process.stdout.read(num_bytes)
        if len(pixels) != num_bytes:
            raise self._obituary()
        return np.frombuffer(pixels, np.uint8).reshape(shape)

    def _obituary(self) -> RuntimeError:
        status = self._process.wait()
        self._messages.seek(0)
        said = self._messages.read().decode(errors="replace")
        is_driver = self._share.settings.backend != "software"
        what = "A process that draws"
        sentence = obituary(what, status, said, self._killed_before, is_driver)
        return GLError(sentence) if status < 0 else RuntimeError(sentence)

    def __exit__(self, *exception: object) -> None:
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout, self._messages):
            assert pipe is not None
            pipe.close()


def _paint(share: Share, out: IO[bytes]) -> None:
    """Draw ahead of the reader by one piece, which has to wait for its turn."""
    done: queue.Queue[bytes | None] = queue.Queue(maxsize=PIECE_FRAMES)

    def write() -> None:
        while (picture := done.get()) is not None:
            try:
                out.write(picture)
                out.flush()
            except BrokenPipeError:  # nobody wants the rest
                os._exit(1)

    writer = threading.Thread(target=write)
    writer.start()
    try:
        pictures = draw_frames(
            *(share.body, share.motion, share.frames, share.settings, share.stage, share.marks)
        )
        for picture in pictures:
            done.put(picture.tobytes())
    finally:
        done.put(None)
        writer.join()


def _stop_with_parent() -> None:
    os.read(sys.stdin.fileno(), 1)
    os._exit(1)


def main() -> int:
    """Draw the share that comes on standard input, raw pixels on standard output."""
    channel = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what libraries print does no harm
    share: Share = pickle.load(sys.stdin.buffer)
    threading.Thread(target=_stop_with_parent, daemon=True).start()
    _paint(share, channel)
    return 0


if __name__ == "__main__":
    sys.exit(main())
