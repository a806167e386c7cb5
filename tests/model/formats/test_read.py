"""Every form in which others write the same motion gives that motion, and says what was changed."""

import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from app.commands import cli
from app.run.body_motion import body_motion
from conventions.joints import JOINT_INDEX, chain_to_root
from model.formats.numbers import ROTATIONS, ReadOptions
from model.formats.read import CONVERT, read_any_motion
from model.measures.smoothness import derivative_magnitudes
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion
from model.motion.tracks import track_points
from model.storage.npz import MotionError
from renderer.body.body import load_body
from renderer.files.bvh import write_bvh
from tests.helpers import foreign_folder, smooth_motion_example
from tests.model.formats.test_read_npz import written

FRAMES = 60
MOTION = smooth_motion_example(FRAMES, expression_basis="flame100")
ROTATION = Rotation.from_rotvec(MOTION.poses.reshape(-1, 3).astype(np.float64))


def assert_same(motion: Motion, atol: float = 2e-3) -> None:
    """Joints in the same places, to millimetres."""
    places = [track_points(each, open_body_skeleton()).joints for each in (motion, MOTION)]
    np.testing.assert_allclose(places[0], places[1], atol=atol)


def test_a_batch_axis_and_joint_rows_are_laid_flat(tmp_path: Path):
    batch = {key: getattr(MOTION, key)[None] for key in ("poses", "trans", "expressions")}
    read = read_any_motion(written(tmp_path, **batch))
    assert_same(read.motion)
    assert any("batch axis" in note for note in read.notes)
    read = read_any_motion(written(tmp_path, poses=MOTION.poses.reshape(-1, 55, 3)))
    assert_same(read.motion)
    assert any("one row for each joint" in note for note in read.notes)


def test_parameters_one_by_one_and_transl(tmp_path: Path):
    columns = {"global_orient": (0, 3), "body_pose": (3, 66), "jaw_pose": (66, 69)}
    columns |= {"leye_pose": (69, 72), "reye_pose": (72, 75)}
    columns |= {"left_hand_pose": (75, 120), "right_hand_pose": (120, 165)}
    parts = {key: MOTION.poses[:, a:b] for key, (a, b) in columns.items()}
    read = read_any_motion(written(tmp_path, poses=None, trans=None, transl=MOTION.trans, **parts))
    assert_same(read.motion)
    (note,) = read.notes
    assert "laid side by side" in note
    few = {key: parts[key] for key in ("global_orient", "body_pose")}
    read = read_any_motion(written(tmp_path, poses=None, **few))
    assert "left_hand_pose, right_hand_pose stay at rest" in read.notes[0]
    with pytest.raises(MotionError, match="no principal components"):
        read_any_motion(written(tmp_path, poses=None, **few, left_hand_pose=np.zeros((FRAMES, 12))))


@pytest.mark.parametrize("form", ROTATIONS)
def test_rotations_of_every_form(tmp_path: Path, form: str):
    matrices = ROTATION.as_matrix().reshape(FRAMES, 55, 3, 3)
    xyzw = ROTATION.as_quat().reshape(FRAMES, 55, 4)
    arrays = {
        "axis-angle": MOTION.poses,
        "6d": matrices[..., :2, :].reshape(FRAMES, 330),
        "quaternion-wxyz": np.roll(xyzw, 1, axis=-1),
        "quaternion-xyzw": xyzw.reshape(FRAMES, 220),
        "matrix": matrices,
    }
    path = written(tmp_path, poses=arrays[form])
    read = read_any_motion(path, ReadOptions(rotations=form))  # type: ignore[arg-type]
    assert_same(read.motion)
    if form != "quaternion-xyzw":  # the other order is the usual one, and said
        read = read_any_motion(path)
        assert_same(read.motion)
        assert form == "axis-angle" or "for each joint, taken as" in read.notes[0]
    other = "6d" if form == "matrix" else "matrix"
    with pytest.raises(MotionError, match=f"numbers of {other}"):
        read_any_motion(path, ReadOptions(rotations=other))


@pytest.mark.parametrize("fps", [15.0, 20.0, 24.0, 25.0, 50.0, 120.0])
def test_rates_become_30(tmp_path: Path, fps: float):
    long = smooth_motion_example(240, expression_basis="flame100")
    read = read_any_motion(
        written(
            tmp_path,
            **{key: getattr(long, key) for key in ("poses", "trans", "expressions")},
            mocap_frame_rate=np.array(fps),
        )
    )
    assert read.motion.num_frames == int(239 * 30 / fps) + 1
    assert any(f"has {fps:g} frames per second" in note for note in read.notes)
    before, after = (
        derivative_magnitudes(track_points(each, open_body_skeleton()).joints, 1).mean()
        for each in (long, read.motion)
    )
    assert after / before == pytest.approx(fps / 30, rel=0.12)  # the same path in other time


def test_a_rate_is_asked_for_or_told(tmp_path: Path):
    path = written(tmp_path, mocap_frame_rate=None)
    with pytest.raises(MotionError, match=r"--fps"):
        read_any_motion(path)
    read = read_any_motion(path, ReadOptions(fps=30.0))
    assert_same(read.motion)
    assert "as you say" in read.notes[0]


@pytest.mark.parametrize(("degrees", "up"), [(90.0, "z"), (180.0, "minus y")])
def test_another_axis_up_is_turned(tmp_path: Path, degrees: float, up: str):
    turn = Rotation.from_euler("x", degrees, degrees=True)
    poses = MOTION.poses.copy().reshape(FRAMES, 55, 3)
    poses[:, 0] = (turn * Rotation.from_rotvec(poses[:, 0])).as_rotvec()
    rest = open_body_skeleton().rest_joints[0].numpy()
    path = written(
        tmp_path,
        poses=poses.reshape(FRAMES, 165),
        trans=(turn.apply(MOTION.trans + rest) - rest).astype(np.float32),
    )
    read = read_any_motion(path)
    assert_same(read.motion)
    assert f"stands along {up}" in read.notes[0]


def test_talkshow_rows(tmp_path: Path):
    poses = MOTION.poses
    columns = [poses[:, 66:75], poses[:, :66], poses[:, 75:], MOTION.expressions]
    path = tmp_path / "talk.npy"
    np.save(path, np.concatenate(columns, axis=1))
    read = read_any_motion(path)
    np.testing.assert_allclose(read.motion.poses, poses, atol=1e-6)
    np.testing.assert_array_equal(read.motion.expressions, MOTION.expressions)
    assert any("TalkSHOW" in note for note in read.notes)
    assert any("no frame rate" in note for note in read.notes)


def test_diffsheg_rows_of_the_upper_body(tmp_path: Path):
    """Spine 3, 6 and 9; 12 to 21; both hands; jaw; 100 of expression."""
    joints = [3, 6, 9, *range(12, 22), *range(25, 55), 22]
    poses = MOTION.poses.reshape(-1, 55, 3)
    columns = [poses[:, joints].reshape(len(poses), -1), MOTION.expressions]
    path = tmp_path / "out.npy"
    np.save(path, np.concatenate(columns, axis=1)[None])
    read = read_any_motion(path)
    found = read.motion.poses.reshape(-1, 55, 3)
    np.testing.assert_allclose(found[:, joints], poses[:, joints], atol=1e-6)
    rest = [joint for joint in range(55) if joint not in joints]
    assert (found[:, rest] == 0).all() and len(rest) == 11
    np.testing.assert_array_equal(read.motion.expressions, MOTION.expressions)
    assert any("pelvis, legs and eyes stay at rest" in note for note in read.notes)


@pytest.mark.parametrize(
    ("shape", "said"),
    [((60, 104), "no public list of which angle"), ((1, 60, 141), r"give the \.bvh")],
)
def test_arrays_that_no_motion_can_be_made_of_say_why(
    shape: tuple[int, ...], said: str, tmp_path: Path
):
    np.save(tmp_path / "pose.npy", np.zeros(shape, np.float32))
    with pytest.raises(MotionError, match=said):
        read_any_motion(tmp_path / "pose.npy")


def test_names_of_beat_are_those_of_mixamo(tmp_path: Path):
    """The same skeleton and motion under either names."""
    path = written_bvh(tmp_path / "mixamo.bvh", (4, 3), -20)
    text = path.read_text().replace("LeftForeArm", "LArm1").replace("RightForeArm", "RArm1")
    beat = tmp_path / "beat.bvh"
    beat.write_text(text.replace("JOINT Left", "JOINT L").replace("JOINT Right", "JOINT R"))
    assert "JOINT LUpLeg" in beat.read_text() and "Left" not in beat.read_text()
    wanted, read = read_any_motion(path), read_any_motion(beat)
    np.testing.assert_array_equal(read.motion.poses, wanted.motion.poses)
    assert (read.motion.poses != 0).any()


def test_hands_and_feet_of_beat(tmp_path: Path):
    """Each joint turned about z by an angle of its own, through BEAT's extra bones; and a row less
    than is stated, as DiffSHEG leaves it."""
    arm = {
        "LShoulder": 3, "LArm": 5, "LArm1": 7, "LHand": 11, "LHandR": 13, "LHandR1": 17,
        "LHandR2": 19, "LHandR3": 23,
    }  # fmt: skip
    leg = {"LUpLeg": 2, "LLeg": 4, "LFoot": 6, "LFootF": 8, "LToeBase": 10}
    head = f"HIERARCHY ROOT Hips {{ {_joint(0, 0)} JOINT Spine {{ {_joint(0, 1)}"
    others = f"{_chain(['RArm'], -1, 1)} {_chain(['RUpLeg'], -1, -1)}"
    row = " ".join(f"{angle} 0 0" for angle in (0, 0, *arm.values(), *leg.values(), 0, 0))
    path = tmp_path / "beat.bvh"
    path.write_text(
        f"{head} {_chain(arm, 2, 0)} }} {_chain(leg, 0, -2)} {others} }}\n"
        f"MOTION\nFrames: 2\nFrame Time: 0.0666667\n{row}\n"
    )
    read = read_any_motion(path)
    assert any("says that it has 2 frames and holds 1" in note for note in read.notes)
    assert any("15 frames per second" in note for note in read.notes)
    joints = track_points(read.motion, open_body_skeleton()).joints[0]
    points = {
        ("left_shoulder", "left_elbow"): 3 + 5,
        ("left_elbow", "left_wrist"): 3 + 5 + 7,
        ("left_ring1", "left_ring2"): 3 + 5 + 7 + 11 + 13 + 17,
        ("left_ring2", "left_ring3"): 3 + 5 + 7 + 11 + 13 + 17 + 19,
        ("left_hip", "left_knee"): -90 + 2,
        ("left_ankle", "left_foot"): -90 + 2 + 4 + 6,
    }
    for (start, end), degrees in points.items():
        bone = joints[JOINT_INDEX[end]] - joints[JOINT_INDEX[start]]
        assert np.degrees(np.arctan2(bone[1], bone[0])) == pytest.approx(degrees, abs=0.01), start
    foot = Rotation.identity()
    for joint in reversed(chain_to_root(JOINT_INDEX["left_foot"])):
        foot *= Rotation.from_rotvec(read.motion.poses[0].reshape(55, 3)[joint])
    of_ball_deg = 2 + 4 + 6 + 8  # and not that of the toes in front of it
    np.testing.assert_allclose(foot.as_rotvec(degrees=True), [0, 0, of_ball_deg], atol=0.01)
    text = path.read_text()
    path.write_text(text.replace("Frames: 2", "Frames: 3"))
    with pytest.raises(MotionError, match="no readable BVH"):
        read_any_motion(path)


def _joint(x: float, y: float) -> str:
    return f"OFFSET {x} {y} 0 CHANNELS 3 Zrotation Yrotation Xrotation"


def _chain(names: Iterable[str], x: float, y: float) -> str:
    opened = [f"JOINT {name} {{ {_joint(x, y)}" for name in names]
    return " ".join([*opened, *"}" * len(opened)])


def test_our_own_bvh_comes_back(tmp_path: Path):
    path = tmp_path / "own.bvh"
    write_bvh(load_body(), body_motion(MOTION), path)
    read = read_any_motion(path)
    assert_same(read.motion, atol=5e-3)


def written_bvh(path: Path, arm: tuple[float, float], left_arm_deg: float = 0.0) -> Path:
    """One frame of a body whose upper arms rest along (x, y), the left one turned about z."""
    names = {"Spine": (0, 1, 0), "LeftUpLeg": (1, -1, 0), "RightUpLeg": (-1, -1, 0)}
    joints = "".join(
        f"JOINT {name} {{ OFFSET {x} {y} {z} CHANNELS 3 Zrotation Xrotation Yrotation }}\n"
        for name, (x, y, z) in names.items()
    )
    arms = "".join(
        f"JOINT {side}Arm {{ OFFSET {x} 1 0 CHANNELS 3 Zrotation Xrotation Yrotation JOINT"
        f" {side}ForeArm {{ OFFSET {x * arm[0]} {arm[1]} 0 CHANNELS 3 Zrotation Xrotation Yrotation"
        " } }\n"
        for side, x in (("Left", 1), ("Right", -1))
    )
    head = "HIERARCHY ROOT Hips { OFFSET 0 0 0 CHANNELS 3 Zrotation Xrotation Yrotation\n"
    row = " ".join(["0"] * 12 + [str(left_arm_deg)] + ["0"] * 11)
    path.write_text(f"{head}{joints}{arms}}}\nMOTION\nFrames: 1\nFrame Time: 0.0333333\n{row}\n")
    return path


def test_an_a_pose_is_refused(tmp_path: Path):
    with pytest.raises(MotionError, match="left arm of its rest pose"):
        read_any_motion(written_bvh(tmp_path / "a.bvh", arm=(1, -2)))


@pytest.mark.parametrize(("arm", "turned", "points_deg"), [((1, 0), 0, 0), ((4, 3), -20, 16.87)])
def test_limbs_of_another_rest_pose_point_as_in_the_file(
    arm: tuple[float, float], turned: float, points_deg: float, tmp_path: Path
):
    """Our own arms rest 14 degrees below the horizontal."""
    read = read_any_motion(written_bvh(tmp_path / "t.bvh", arm, turned))
    joints = track_points(read.motion, open_body_skeleton()).joints[0]
    left, right = (
        joints[JOINT_INDEX[f"{side}_elbow"]] - joints[JOINT_INDEX[f"{side}_shoulder"]]
        for side in ("left", "right")
    )
    assert np.degrees(np.arctan2(left[1], left[0])) == pytest.approx(points_deg, abs=0.01)
    rests_deg = np.degrees(np.arctan2(arm[1], arm[0]))
    assert np.degrees(np.arctan2(right[1], -right[0])) == pytest.approx(rests_deg, abs=0.01)
    assert any("rests at other angles" in note for note in read.notes)


@pytest.mark.parametrize("content", ["", "HIERARCHY", "HIERARCHY ROOT a {\nMOTION\nFrames: x"])
def test_damaged_bvh_is_refused(tmp_path: Path, content: str):
    path = tmp_path / "bad.bvh"
    path.write_text(content)
    with pytest.raises(MotionError, match="no readable BVH"):
        read_any_motion(path)


def test_pickles_are_refused_with_a_way_out(tmp_path: Path):
    import pickle

    path = tmp_path / "motion.pkl"
    path.write_bytes(pickle.dumps({"poses": MOTION.poses, "trans": MOTION.trans}))
    with pytest.raises(MotionError, match="never loaded"):
        read_any_motion(path)
    command = CONVERT.split('"')[1]
    subprocess.run([sys.executable, "-c", command, str(path)], cwd=tmp_path, check=True)
    read = read_any_motion(tmp_path / "motion.npz", ReadOptions(fps=30.0))
    assert_same(read.motion)


def test_arrays_of_objects_are_never_loaded(tmp_path: Path):
    path = tmp_path / "objects.npy"
    np.save(path, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(MotionError, match="never loaded"):
        read_any_motion(path)


def test_the_command_line_names_the_same_forms():
    assert cli._ROTATIONS == ROTATIONS


@pytest.mark.parametrize(
    ("name", "frames", "said"),
    [
        ("talkshow_french.npy", 288, "stands along minus y"),
        ("zeroeggs_067_Speech_2.bvh", 2065, "laid onto ours"),
        ("chgs_3_vq.npz", 2016, ""),
        ("emage_female.npz", 704, ""),
    ],
)
def test_files_of_others_open(name: str, frames: int, said: str):
    read = read_any_motion(foreign_folder() / name)
    assert read.motion.num_frames == frames
    assert not said or any(said in note for note in read.notes)
