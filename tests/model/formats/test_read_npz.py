"""Motion files of other tools: what is made up for, what is said of it, and what is refused."""

from pathlib import Path

import numpy as np
import pytest

from model.formats.read import read_any_motion
from model.motion.motion import load_motion, save_motion
from model.storage.npz import MotionError
from tests.helpers import smooth_motion_example


def arrays_of(num_frames: int = 60) -> dict[str, np.ndarray]:
    motion = smooth_motion_example(num_frames, expression_basis="flame100")
    return {
        "poses": motion.poses,
        "trans": motion.trans,
        "expressions": motion.expressions,
        "betas": motion.betas,
        "mocap_frame_rate": np.array(30),
    }


def written(folder: Path, **changes: np.ndarray | None) -> Path:
    arrays = arrays_of() | changes
    path = folder / "theirs.npz"
    np.savez(path, **{key: array for key, array in arrays.items() if array is not None})
    return path


def refusal(path: Path) -> str:
    with pytest.raises(MotionError) as caught:
        read_any_motion(path)
    sentence = str(caught.value)
    assert sentence.startswith("theirs.npz") and sentence.endswith(".") and "\n" not in sentence
    return sentence


def only_note(path: Path) -> str:
    (note,) = read_any_motion(path).notes
    assert note.startswith("theirs.npz") and note.endswith(".")
    return note


def test_our_own_files_need_no_note(tmp_path: Path):
    path = tmp_path / "ours.npz"
    save_motion(smooth_motion_example(), path)
    read = read_any_motion(path)
    assert read.notes == ()
    np.testing.assert_array_equal(read.motion.poses, load_motion(path).poses)
    assert read.motion.expression_basis == "arkit52"


def test_120_frames_per_second_become_30(tmp_path: Path):
    time_s = np.arange(121) / 120
    trans = np.stack([time_s, 1 + 0 * time_s, time_s**2], axis=1)
    poses = np.zeros((121, 165))
    poses[:, 57] = time_s  # the right elbow turns at 1 rad/s
    path = written(
        tmp_path,
        poses=poses,
        trans=trans,
        expressions=None,
        mocap_frame_rate=None,
        mocap_framerate=np.array(120.0),
    )
    read = read_any_motion(path)
    assert read.motion.num_frames == 31
    seconds = np.arange(31) / 30
    np.testing.assert_allclose(read.motion.poses[:, 57], seconds, atol=1e-6)
    np.testing.assert_allclose(read.motion.trans[:, 2], seconds**2, atol=1e-6)
    assert any("120 frames per second and was resampled to 30" in note for note in read.notes)
    assert any("has no `expressions`" in note for note in read.notes)


@pytest.mark.parametrize("fps", [0.0, 10.0, 241.0, -30.0])
def test_frame_rates_that_cannot_be_resampled_honestly(tmp_path: Path, fps: float):
    assert f"{fps:g} frames per second" in refusal(
        written(tmp_path, mocap_frame_rate=np.array(fps))
    )


def test_52_joints_of_smpl_h_keep_their_places(tmp_path: Path):
    whole = arrays_of()["poses"]
    smplh = np.delete(whole, np.s_[66:75], axis=1)
    read = read_any_motion(written(tmp_path, poses=smplh))
    assert smplh.shape[1] == 156
    np.testing.assert_array_equal(read.motion.poses[:, :66], whole[:, :66])
    np.testing.assert_array_equal(read.motion.poses[:, 66:75], 0)
    np.testing.assert_array_equal(read.motion.poses[:, 75:], whole[:, 75:])
    assert "52 joints of SMPL-H; jaw and eyes" in only_note(written(tmp_path, poses=smplh))


def test_centimetres_are_taken_as_such_and_said(tmp_path: Path):
    trans = arrays_of()["trans"]
    path = written(tmp_path, trans=100 * trans)
    np.testing.assert_allclose(read_any_motion(path).motion.trans, trans, rtol=1e-5)
    assert "centimetres and divided by 100" in only_note(path)
    far = trans + np.array([15.0, 0, 0])  # a large stage, in metres
    assert read_any_motion(written(tmp_path, trans=far)).notes == ()


def test_the_shortest_array_decides_the_length(tmp_path: Path):
    path = written(tmp_path, trans=arrays_of(55)["trans"], expressions=arrays_of(58)["expressions"])
    assert read_any_motion(path).motion.num_frames == 55
    assert "60 of `poses`, 55 of `trans`, 58 of `expressions`); the first 55" in only_note(path)


def test_betas_of_other_models_are_filled_up(tmp_path: Path):
    path = written(tmp_path, betas=np.full(16, 0.5))
    betas = read_any_motion(path).motion.betas
    np.testing.assert_array_equal(betas[:17], [0.5] * 16 + [0])
    assert not read_any_motion(written(tmp_path, betas=None)).motion.betas.any()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"poses": None}, "lacks poses; it holds betas"),
        ({"trans": None}, "lacks trans;"),
        ({"mocap_frame_rate": None}, "lacks mocap_frame_rate;"),
        ({"mocap_frame_rate": np.array([30, 30])}, "one number"),
        ({"poses": np.zeros((60, 72))}, "(frames, 165), (frames, 55, 3), or that of 52"),
        ({"poses": np.zeros((2, 60, 55, 3))}, "found (2, 60, 55, 3)"),
        ({"poses": np.zeros((0, 165))}, "no frames"),
        ({"poses": np.zeros(())}, "it has ()"),
        ({"poses": np.full((60, 165), 90.0)}, "radians, not degrees"),
        ({"trans": np.zeros((60, 2))}, "(frames, 3)"),
        ({"trans": np.full((60, 3), np.nan)}, "not finite"),
        ({"trans": np.full((60, 3), "x")}, "numbers"),
        ({"expressions": np.zeros((60, 10))}, "(frames, 100)"),
        ({"betas": np.zeros((2, 10))}, "up to 300 numbers"),
        ({"expression_basis": np.array("mine")}, "flame100 and arkit52"),
    ],
)
def test_what_cannot_be_made_up_for_is_refused(tmp_path: Path, changes: dict, words: str):
    assert words in refusal(written(tmp_path, **changes))


def test_a_value_in_the_middle_is_named_by_its_frame(tmp_path: Path):
    poses = arrays_of()["poses"].copy()
    poses[17, 3] = np.inf
    assert "`poses` in frame 17" in refusal(written(tmp_path, poses=poses))


def test_200_megabytes_are_refused_before_they_are_read(tmp_path: Path):
    path = tmp_path / "theirs.npz"
    with path.open("wb") as file:
        file.truncate(200 * 10**6)
    assert "191 MiB; at most 160 MiB" in refusal(path)


def test_one_frame_is_a_motion(tmp_path: Path):
    arrays = arrays_of(1)
    np.savez(tmp_path / "theirs.npz", **arrays | {"mocap_frame_rate": np.array(60)})
    assert read_any_motion(tmp_path / "theirs.npz").motion.num_frames == 1
