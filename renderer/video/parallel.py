"""One video drawn by several processes: each draws every so-many-th piece of frames.

A driver's threads leave cores idle while Python skins and lights the next frame; processes do not.
The pictures come back in order and, since every piece is skinned as it would be by one process,
they are the same to the last bit. No process is ever ahead by more than a piece, so memory does
not grow with the length of a video.

The children are of ``renderer.video.worker_child``'s own process group and stop when their
channels close: whoever ends the group, or dies, leaves none of them behind.
"""

import os
import queue
import sys
import threading
from collections.abc import Generator
from contextlib import ExitStack
from dataclasses import replace
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
from jaxtyping import UInt8

from processes.child import Child, Gone, parent_channel
from renderer.body.body import Body, BodyMotion
from renderer.draw.probe import choose_backend
from renderer.scene.stage import Stage
from renderer.video.marks import Marks
from renderer.video.render import PIECE_FRAMES, draw_frames, stage_for
from renderer.video.settings import RenderSettings
from renderer.video.worker_process import failure

MIN_FRAMES_EACH = 300
"""With fewer frames a further process costs more to start than it saves: one alone already keeps
the driver's threads and ffmpeg busy beside its own."""
MAX_PROCESSES = 4
"""More draw faster than ffmpeg encodes, and each takes a quarter of a gigabyte."""


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
            # Of this process's own group: whoever ends that, ends them all.
            child = Child("renderer.video.parallel", has_group=False)
            stack.callback(child.end)
            child.send((body, motion, frames, settings, stage, marks))
            children.append(child)
        for turn in turns:
            pixels = _received(children[turn])
            yield np.frombuffer(pixels, np.uint8).reshape(shape)


def _received(child: Child) -> bytes:
    try:
        return child.receive_bytes()
    except Gone as error:
        raise failure("A process that draws", child.ended()) from error


def _paint(share: tuple[Any, ...], channel: Connection) -> None:
    """Draw what `draw_frames` is asked for, ahead of the reader by one piece, which has to wait for
    its turn."""
    done: queue.Queue[bytes | None] = queue.Queue(maxsize=PIECE_FRAMES)

    def write() -> None:
        while (picture := done.get()) is not None:
            try:
                channel.send_bytes(picture)
            except OSError:  # nobody wants the rest
                os._exit(1)

    writer = threading.Thread(target=write)
    writer.start()
    try:
        for picture in draw_frames(*share):
            done.put(picture.tobytes())
    finally:
        done.put(None)
        writer.join()


def _stop_with_parent(channel: Connection) -> None:
    try:
        channel.recv()  # nothing is ever sent: it closes
    finally:
        os._exit(1)


def main() -> int:
    """Draw the share that comes first, and send pixels back."""
    channel, _ = parent_channel()
    share: tuple[Any, ...] = channel.recv()
    threading.Thread(target=_stop_with_parent, args=(channel,), daemon=True).start()
    _paint(share, channel)
    return 0


if __name__ == "__main__":
    sys.exit(main())
