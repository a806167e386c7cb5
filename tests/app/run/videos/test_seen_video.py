"""Videos of a stage, made and read back."""

from dataclasses import replace
from pathlib import Path

import av
import numpy as np
import pytest

from app.errors import CancelledRun, RunError
from app.run.requests.display import Display
from app.run.requests.request import Progress
from app.run.videos import seen_video
from app.run.videos.seen_video import (
    BODY,
    NAME,
    Mode,
    Seen,
    SeenBody,
    SeenPanel,
    SeenRequest,
    draw_seen,
)
from conventions.joints import JOINT_INDEX
from model.motion.motion import Motion, save_motion
from model.speech.audio import write_wav
from renderer.scene.camera import Orbit
from renderer.video.compose import band_height
from tests.app.fakes import made_motion
from tests.model.made import made_waveform

FRAMES = 4
GRID = Seen(
    shown=(0, 1),
    size=(80.0, 140.0),
    panels=(
        (
            SeenPanel(BODY, 0, 0, 80, 100),
            SeenPanel("right_hand", 0, 100, 40, 40),
            SeenPanel("left_hand", 40, 100, 40, 40),
        ),
    ),
    columns=2,
)
PAIR = replace(
    GRID,
    size=(160.0, 100.0),
    panels=(
        (SeenPanel(BODY, 40, 0, 80, 100), SeenPanel("right_hand", 0, 0, 40, 100)),
        (SeenPanel(BODY, 40, 0, 80, 100), SeenPanel("right_hand", 120, 0, 40, 100)),
    ),
    mode="wipe",
)


def with_arms_down(num_frames: int = FRAMES) -> Motion:
    motion = made_motion(num_frames, 0.01)
    for side, sign in (("left", -1), ("right", 1)):
        motion.poses[:, 3 * JOINT_INDEX[f"{side}_shoulder"] + 2] = sign * 1.2
    return motion


def asked(tmp_path: Path, seen: Seen, *motions: Motion, speech: Path | None = None) -> SeenRequest:
    bodies = []
    for i, motion in enumerate(motions or (with_arms_down(), with_arms_down())):
        save_motion(motion, tmp_path / f"{i}.npz")
        bodies.append(SeenBody("ab"[i], tmp_path / f"{i}.npz"))
    return SeenRequest(tuple(bodies), seen, tmp_path / "out", speech)


def drawn(request: SeenRequest) -> np.ndarray:
    """The pictures under the band with the names."""
    video = draw_seen(request, lambda event: None, lambda: False)
    assert video.path == request.out / NAME and list(request.out.iterdir()) == [video.path]
    with av.open(str(video.path)) as file:
        frames = np.stack([each.to_ndarray(format="rgb24") for each in file.decode(video=0)])
    assert len(frames) == video.num_frames
    room = seen_video._Room.of(request.seen)
    high = room.height
    wide = room.width if request.seen.mode == "grid" else room.width // 2
    assert high - 2 <= frames.shape[1] - band_height(min(wide, high)) <= high + 2
    return frames[:, -high:].astype(int)


def dark(picture: np.ndarray) -> np.ndarray:
    """Where the suit is."""
    return picture.sum(axis=-1) < 400


@pytest.mark.gl
def test_bodies_stand_beside_each_other_with_their_hands_and_the_sound(tmp_path: Path) -> None:
    speech = tmp_path / "speech.wav"
    write_wav(speech, made_waveform(3200))
    frames = drawn(asked(tmp_path, GRID, speech=speech))
    _, height, width, _ = frames.shape
    assert width / height == pytest.approx(160 / 140, rel=0.03)
    half = dark(frames[0])[: round(height * 100 / 140)]
    left, right = half[:, : width // 2], half[:, width // 2 :]
    assert left.mean() > 0.03 and np.mean(left != right) < 0.01, "one motion, one picture"
    with av.open(str(tmp_path / "out" / NAME)) as file:
        assert file.streams.audio


@pytest.mark.gl
def test_camera_framing_and_displays_are_what_was_seen(tmp_path: Path) -> None:
    plain = drawn(asked(tmp_path, replace(GRID, shown=(0,), columns=1)))[0]
    near = replace(GRID, shown=(0,), columns=1, camera=Orbit(zoom=2.0))
    whole = replace(GRID, shown=(0,), columns=1, is_whole=True)
    jerk = replace(near, camera=Orbit(), display=Display(coloring="jerk"))
    side = replace(near, camera=Orbit(np.pi / 2))
    body = slice(0, round(plain.shape[0] * 100 / 140) - 4)
    seen = [dark(drawn(asked(tmp_path, each))[0][body]).sum() for each in (near, whole, jerk, side)]
    usual = dark(plain[body]).sum()
    assert seen[0] > 1.5 * usual, "nearer"
    assert seen[1] != usual and seen[2] < 0.2 * usual and seen[3] < 0.9 * usual


@pytest.mark.gl
@pytest.mark.parametrize("mode", ["ghost", "wipe", "flicker"])
def test_a_pair_stands_pelvis_on_pelvis(tmp_path: Path, mode: Mode) -> None:
    first, second = with_arms_down(20), with_arms_down(20)
    second.trans[10:, 0] += 0.8  # in register it stands 0.4 m to one side, then to the other
    seen = replace(PAIR, mode=mode)
    frames = drawn(asked(tmp_path, seen, first, second))
    wide = frames.shape[2]
    middle = frames[:, :, wide // 4 : 3 * wide // 4]
    alone = drawn(asked(tmp_path, replace(seen, shown=(0, 0)), first, second))
    alone = alone[:, :, wide // 4 : 3 * wide // 4]
    away = np.abs(middle - alone).mean()
    apart = drawn(asked(tmp_path, replace(seen, is_aligned=False), first, second))
    beside = slice(3 * wide // 4 + 4, None)
    moved = np.abs(frames[[2, 17]][:, :, beside] - apart[[2, 17]][:, :, beside]).mean()
    assert moved < 5, "hands stay in place, but for the shadow"
    apart = apart[:, :, wide // 4 : 3 * wide // 4]
    assert away < 0.5 * np.abs(apart - alone).mean()


def test_the_second_of_a_pair_stands_where_the_first_is_drawn() -> None:
    first, second = with_arms_down(6), with_arms_down(9)
    second.trans[:, 0] = np.arange(9)
    each = [seen_video._Drawn("", motion, motion, None) for motion in (first, second)]
    laid = seen_video._laid_on(*each).shown.trans
    assert np.allclose(laid[:, [0, 2]], first.trans[0, [0, 2]]), "also where the first has ended"
    assert np.array_equal(laid[:, 1], second.trans[:, 1]), "but not in height"


@pytest.mark.parametrize(
    ("size", "columns", "count"),
    [((320.0, 476.0), 5, 5), ((1200.0, 900.0), 1, 1), ((250.0, 500.0), 6, 12)],
)
def test_large_pictures_are_as_large_as_a_screen_has_room_for(
    size: tuple[float, float], columns: int, count: int
) -> None:
    panels = ((SeenPanel(BODY, 0, 0, *size),),)
    seen = Seen(tuple(range(count)), size, panels, columns)
    room = seen_video._Room.of(seen)
    rows = -(-count // columns)
    assert room.width % 2 == room.height % 2 == 0
    assert room.width / room.height == pytest.approx(size[0] / size[1], rel=0.02)
    band = band_height(min(room.width, room.height))
    wide, tall = columns * room.width, rows * (room.height + band)
    assert wide <= 1920 + 2 * columns and tall <= 1080 + 2 * rows
    assert wide > 1800 or tall > 980


def test_small_pictures_are_half_as_large_again() -> None:
    room = seen_video._Room.of(GRID)
    assert (room.width, room.height) == (120, 210)


def test_a_long_video_is_cut_and_says_so() -> None:
    motions = [made_motion(2), made_motion(2)]
    assert seen_video._longest(motions, GRID) == (2, ())
    long = [made_motion(1), replace(made_motion(1), **_frames(6000))]
    limit, (note,) = seen_video._longest(long, GRID)
    assert limit == 5400 and "first 180 s" in note


def _frames(count: int) -> dict[str, np.ndarray]:
    zeros = np.zeros((count, 165), np.float32)
    return {"poses": zeros, "trans": zeros[:, :3], "expressions": zeros[:, :100]}


def test_too_small_bodies_are_refused(tmp_path: Path) -> None:
    panels = ((SeenPanel(BODY, 0, 0, 10, 10), SeenPanel("face", 0, 10, 1000, 990)),)
    seen = replace(GRID, size=(1000.0, 1000.0), panels=panels)
    with pytest.raises(RunError, match="too small on the stage"):
        draw_seen(asked(tmp_path, seen), lambda event: None, lambda: False)


def test_it_stops_when_it_is_told_to(tmp_path: Path) -> None:
    told: list[object] = []
    with pytest.raises(CancelledRun):
        draw_seen(asked(tmp_path, GRID), told.append, lambda: bool(told))
    assert told == [Progress("video", 0.0)] and not (tmp_path / "out" / NAME).exists()
