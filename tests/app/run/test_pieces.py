"""Motion that is told of window by window, and its bytes."""

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from app.errors import CancelledRun
from app.run.pieces import HEADER, frames_message
from app.run.pipeline import generate_all
from app.run.requests.request import Artefact, Event, GenerateRequest, Piece
from app.run.videos.own_videos import in_register, register_of
from model.motion.motion import Motion, load_motion
from model.speech.audio import write_wav
from tests.helpers import smooth_motion_example
from tests.model.made import made_waveform

FRAMES = 113  # two windows and a single frame more
NAMES = ("globaldiff/local", "globaldiff/global")


def parts(message: bytes) -> tuple[bytes, bytes, bytes]:
    """Places, turns and faces of one message."""
    _, count, faces, *_ = HEADER.unpack_from(message)
    edges = np.cumsum([HEADER.size, 12 * count, 440 * count, faces * count])
    assert edges[-1] == len(message)
    places, turns, weights = (message[a:b] for a, b in pairwise(edges))
    return places, turns, weights


@pytest.fixture
def long_ask(ask: Callable[..., GenerateRequest], tmp_path: Path) -> Callable[..., GenerateRequest]:
    speech = tmp_path / "long.wav"
    write_wav(speech, made_waveform(round(16_000 * FRAMES / 30)))
    return lambda **changes: ask(speech=speech, has_figures=False, **changes)


def pieces_of(events: list[Event], name: str) -> list[Piece]:
    return [event for event in events if isinstance(event, Piece) and event.name == name]


def test_pieces_hold_the_bytes_of_the_whole_and_say_where_it_stands(
    long_ask: Callable[..., GenerateRequest],
) -> None:
    events: list[Event] = []
    result = generate_all(long_ask(samples=2), events.append)
    assert result.num_frames == FRAMES
    for name in (*NAMES, *(f"{name}.s2" for name in NAMES)):
        pieces = pieces_of(events, name)
        assert [piece.end for piece in pieces] == [52, 104, FRAMES]
        assert {piece.num_frames for piece in pieces} == {FRAMES}
        assert [HEADER.unpack_from(piece.frames)[0] for piece in pieces] == [0, 52, 104]
        motion = load_motion(result.out / f"{name.replace('/', '-')}.npz")
        whole = parts(frames_message(0, motion))
        told = zip(*(parts(piece.frames) for piece in pieces), strict=True)
        assert tuple(b"".join(each) for each in told) == whole, "to the bit"
        place = register_of(motion)
        assert (pieces[-1].turn_rad, pieces[-1].shift_m) == (place.turn_rad, place.shift_m)


def test_all_systems_begin_before_any_goes_on_and_files_come_when_they_are_whole(
    long_ask: Callable[..., GenerateRequest],
) -> None:
    events: list[Event] = []
    generate_all(long_ask(), events.append)
    told = [
        (event.name, event.end if isinstance(event, Piece) else "whole")
        for event in events
        if isinstance(event, Piece) or (isinstance(event, Artefact) and event.kind == "motion")
    ]
    local, other = NAMES
    assert told == [
        *((local, 52), (other, 52), (local, 104), (other, 104)),
        *((local, FRAMES), (local, "whole"), (other, FRAMES), (other, "whole")),
    ]


def test_a_run_that_is_cancelled_midway_leaves_nothing_that_looks_whole(
    long_ask: Callable[..., GenerateRequest],
) -> None:
    events: list[Event] = []
    asked = long_ask()

    def should_cancel() -> bool:
        return len(pieces_of(events, NAMES[1])) == 2

    with pytest.raises(CancelledRun):
        generate_all(asked, events.append, should_cancel)
    assert all(piece.end < piece.num_frames for piece in events if isinstance(piece, Piece))
    assert not any(isinstance(event, Artefact) and event.kind == "motion" for event in events)
    assert not asked.out.exists() or not list(asked.out.iterdir())


def test_filtered_motion_is_told_of_when_it_is_whole(
    long_ask: Callable[..., GenerateRequest],
) -> None:
    events: list[Event] = []
    generate_all(long_ask(post_filter="savgol"), events.append)
    assert not any(isinstance(event, Piece) for event in events)


@pytest.mark.parametrize("degrees", [0, 70, 200])
def test_a_register_says_what_is_done_to_a_motion(degrees: float) -> None:
    from scipy.spatial.transform import Rotation

    motion = smooth_motion_example(30)
    turn = Rotation.from_euler("y", degrees, degrees=True)
    poses = motion.poses.copy()
    poses[:, :3] = (turn * Rotation.from_rotvec(poses[:, :3])).as_rotvec()
    moved = Motion(poses, motion.trans + 0.5, motion.expressions, "arkit52", motion.betas)
    laid = in_register(moved)
    again = register_of(laid)
    assert again.turn_rad == pytest.approx(0, abs=1e-4)
    assert again.shift_m == pytest.approx((0, 0, 0), abs=1e-4)
    place = register_of(moved)
    assert np.hypot(*np.array(place.shift_m)[[0, 2]]) > 0.3
