"""Archives and arrays: keys, shapes, parts, rates, units and hands, and what is refused."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from conventions.joints import HANDS
from model.formats.convention_detection import MEAN_HANDS_SUBSTITUTE
from model.formats.motion_draft import rotation_layout
from model.formats.numpy_reader import CONVERT_PICKLE_COMMAND
from model.formats.parameters import files_with_motion_names
from model.formats.read import read_any_motion, read_mean_hand_pose
from model.formats.reading import ImportedMotion, parse_import_overrides
from model.metrics.smoothness import derivative_magnitudes
from model.motion.motion import load_motion, save_motion
from model.storage.npz import MotionError
from tests.helpers import smooth_motion_example
from tests.model.formats.made import Person, in_form, joints_of

MOTION = Person(5).motion(60)
POSES = MOTION.poses.reshape(-1, 55, 3)


def arrays_of() -> dict[str, np.ndarray]:
    return {
        "poses": MOTION.poses,
        "trans": MOTION.trans,
        "expressions": MOTION.expressions,
        "betas": MOTION.betas,
        "mocap_frame_rate": np.array(30),
    }


def written(folder: Path, **changes: np.ndarray | None) -> Path:
    arrays = arrays_of() | changes
    path = folder / "theirs.npz"
    np.savez(path, **{key: array for key, array in arrays.items() if array is not None})
    return path


def refusal(path: Path, assume: str = "") -> str:
    with pytest.raises(MotionError) as caught:
        read_any_motion(path, parse_import_overrides(assume))
    sentence = str(caught.value)
    assert path.name in sentence and sentence.endswith(".") and "\n" not in sentence
    return sentence


def value_of(reading: ImportedMotion, kind: str) -> tuple[str, str]:
    found = reading.assumption_of(kind)  # type: ignore[arg-type]
    assert found is not None
    return found.value, found.confidence


def test_our_own_files_need_no_note(tmp_path: Path):
    path = tmp_path / "ours.npz"
    save_motion(smooth_motion_example(), path)
    reading = read_any_motion(path)
    assert reading.notes == ()
    np.testing.assert_array_equal(reading.motion.poses, load_motion(path).poses)
    assert reading.motion.expression_basis == "arkit52"


def test_120_frames_per_second_become_30(tmp_path: Path):
    time_s = np.arange(121) / 120
    trans = np.stack([time_s, 1 + 0 * time_s, time_s**2], axis=1)
    poses = np.zeros((121, 165))
    poses[:, 57] = time_s  # the right elbow turns at 1 rad/s
    changes = {"poses": poses, "trans": trans, "expressions": None, "mocap_frame_rate": None}
    path = written(tmp_path, **changes, mocap_framerate=np.array("120.0"))
    reading = read_any_motion(path, parse_import_overrides("units=m"))
    assert reading.motion.num_frames == 31
    seconds = np.arange(31) / 30
    np.testing.assert_allclose(reading.motion.poses[:, 57], seconds, atol=1e-6)
    np.testing.assert_allclose(reading.motion.trans[:, 2], seconds**2, atol=1e-6)
    assert value_of(reading, "rate") == ("120", "stated")
    assert "face" in reading.missing_parts and "hands" in reading.missing_parts


@pytest.mark.parametrize("fps", [15.0, 24.0, 50.0, 60.0])
def test_other_rates_go_the_same_path_in_other_time(tmp_path: Path, fps: float):
    long = Person(5).motion(240)
    arrays = {key: getattr(long, key) for key in ("poses", "trans", "expressions")}
    reading = read_any_motion(written(tmp_path, **arrays, mocap_frame_rate=np.array(fps)))
    assert reading.motion.num_frames == int(239 * 30 / fps) + 1
    assert ("detail" in reading.missing_parts) == (fps < 30)
    before, after = (
        derivative_magnitudes(joints_of(each), 1).mean() for each in (long, reading.motion)
    )
    assert after / before == pytest.approx(fps / 30, rel=0.12)


@pytest.mark.parametrize("fps", [0.0, 11.9, 240.1, -30.0])
def test_frame_rates_that_cannot_be_resampled_honestly(tmp_path: Path, fps: float):
    path = written(tmp_path, mocap_frame_rate=np.array(fps))
    assert f"{fps:g} frames per second" in refusal(path)
    assert read_any_motion(path, parse_import_overrides("rate=30")).motion.num_frames == 60


def test_a_stated_mean_hand_comes_from_the_body_else_ours_stands_in(tmp_path: Path):
    poses = POSES.copy()
    poses[:, list(HANDS)] -= MEAN_HANDS_SUBSTITUTE
    path = written(tmp_path, poses=poses.reshape(60, 165))
    reading = read_any_motion(path, parse_import_overrides("hands=mean"))
    np.testing.assert_allclose(reading.motion.poses, MOTION.poses, atol=1e-6)
    assert "finger_angles" in reading.missing_parts and "is used as the mean" in " ".join(
        reading.notes
    )
    body = tmp_path / "SMPLX_NEUTRAL.npz"
    means = {"hands_meanl": np.full(45, 0.1), "hands_meanr": np.full(45, 0.2)}
    np.savez(body, **means, joint2num=np.array({"a": 1}, dtype=object))
    reading = read_any_motion(path, parse_import_overrides("hands=mean"), body)
    added = reading.motion.poses.reshape(-1, 55, 3)[:, list(HANDS)] - poses[:, list(HANDS)]
    np.testing.assert_allclose(added[:, :15], 0.1, atol=1e-6)
    np.testing.assert_allclose(added[:, 15:], 0.2, atol=1e-6)
    assert "finger_angles" not in reading.missing_parts
    np.savez(body, hands_meanl=np.zeros(3), hands_meanr=np.zeros(3))
    assert read_mean_hand_pose(body) is None


@pytest.mark.parametrize(
    ("shape", "told"),
    [
        ((90, 165), (1, 90, 55, 3)),
        ((165, 90), (1, 90, 55, 3)),
        ((1, 55, 3), (1, 1, 55, 3)),
        ((55, 3), (1, 1, 55, 3)),
        ((4, 30, 66), (4, 30, 22, 3)),
        ((90, 24, 3, 3), (1, 90, 24, 9)),
        ((2, 90, 52, 6), (2, 90, 52, 6)),
        ((2, 90, 22, 3, 3), (2, 90, 22, 9)),
        ((90, 220), (1, 90, 55, 4)),
        ((90, 1, 165), (1, 90, 55, 3)),
        *((shape, None) for shape in ((90, 100), (90, 23, 3), (90, 55, 5), (90,), (2,) * 5)),
    ],
)
def test_shapes_of_rotations(shape: tuple[int, ...], told: tuple[int, ...] | None):
    found = rotation_layout(shape)
    assert (found and found.reshape(np.zeros(shape)).shape) == told


@pytest.mark.parametrize("frames", [1, 60])
def test_parts_may_have_a_batch_axis_and_any_form(tmp_path: Path, frames: int):
    rows = in_form(POSES[:frames], "matrix").reshape(frames, 55, 3, 3)
    parts = {"global_orient": rows[:, :1], "body_pose": rows[:, 1:22]}
    hands = {"left_hand_pose": POSES[:frames, 25:40].reshape(1, frames, 45)}
    given = {"poses": None, "expressions": None, "trans": MOTION.trans[:frames]}
    reading = read_any_motion(written(tmp_path, **given, **parts, **hands))
    found = reading.motion.poses.reshape(-1, 55, 3)
    np.testing.assert_allclose(found[:, :22], POSES[:frames, :22], atol=1e-5)
    np.testing.assert_allclose(found[:, 25:40], POSES[:frames, 25:40], atol=1e-5)
    assert "jaw, eyes stay at rest" in " ".join(reading.notes)


def test_form_that_does_not_fit_is_refused_with_those_that_do(tmp_path: Path):
    path = written(tmp_path, poses=in_form(POSES, "6d").reshape(60, -1))
    assert "6d or 6d-columns" in refusal(path, "rotations=matrix")
    turned = read_any_motion(path, parse_import_overrides("rotations=6d-columns")).motion.poses
    rows = Rotation.from_rotvec(turned.reshape(-1, 3))
    inverse = Rotation.from_rotvec(-MOTION.poses.reshape(-1, 3))
    assert (rows.inv() * inverse).magnitude().reshape(60, 55)[:, 1:22].max() < 1e-3


def test_the_shortest_array_decides_the_length(tmp_path: Path):
    reading = read_any_motion(
        written(tmp_path, trans=MOTION.trans[:55], expressions=MOTION.expressions[:58])
    )
    assert reading.motion.num_frames == 55
    assert "(60 of poses, 55 of trans, 58 of expressions); the first 55" in reading.notes[0]


@pytest.mark.parametrize("has_place", [True, False])
def test_parameters_of_one_row_hold_for_all_frames(tmp_path: Path, has_place: bool):
    """As smplx writes them where nothing of a clip moves; a plain vector is such a row."""
    row = MOTION.expressions[5:6, :10]
    parts = {
        "global_orient": POSES[:, 0],
        "body_pose": POSES[:, 1:22].reshape(60, 63),
        "jaw_pose": POSES[7, 22],
        "left_hand_pose": POSES[3:4, 25:40].reshape(1, 45),
        "transl": MOTION.trans if has_place else None,
        "expression": row,
    }
    path = written(tmp_path, poses=None, trans=None, expressions=None, betas=None, **parts)
    reading = read_any_motion(path, parse_import_overrides("hands=flat"))
    found = reading.motion.poses.reshape(-1, 55, 3)
    np.testing.assert_allclose(found[:, :22], POSES[:, :22], atol=1e-6)
    np.testing.assert_allclose(found[:, 22], np.tile(POSES[7, 22], (60, 1)), atol=1e-6)
    np.testing.assert_allclose(found[:, 25:40], np.tile(POSES[3, 25:40], (60, 1, 1)), atol=1e-6)
    np.testing.assert_array_equal(reading.motion.expressions[:, :10], np.tile(row, (60, 1)))
    said = "frames 60, `jaw_pose`, `left_hand_pose` and `expression` have one row, which is used"
    assert said in " ".join(reading.notes)


def test_parts_of_other_lengths_are_told(tmp_path: Path):
    parts = {"global_orient": POSES[:, 0], "body_pose": POSES[:58, 1:22].reshape(58, 63)}
    reading = read_any_motion(written(tmp_path, poses=None, **parts))
    assert reading.motion.num_frames == 58
    said = "60 of global_orient, trans and expressions, 58 of body_pose); the first 58"
    assert said in " ".join(reading.notes)


@pytest.mark.parametrize(
    ("key", "assume", "value"),
    [
        ("missing", "", "bridge"),
        ("missing", "frames=refuse", "as-is"),
        ("is_valid", "", "as-is"),
        ("is_valid", "frames=bridge", "bridge"),
    ],
)
def test_frames_that_a_mask_marks_are_interpolated_or_told(
    tmp_path: Path, key: str, assume: str, value: str
):
    marks, poses, trans = np.ones(60), MOTION.poses.copy(), MOTION.trans.copy()
    marks[[0, 20, 21, 22]] = 0
    poses[20:23, 57], trans[20:23] = 1.5, 3.0
    path = written(tmp_path, poses=poses, trans=trans, **{key: marks})
    reading = read_any_motion(path, parse_import_overrides(assume))
    notes = " ".join(reading.notes)
    assert f"frames {value}, `{key}` marks frames 0, 20-22 as invalid" in notes
    wanted = MOTION if value == "bridge" else None
    off = reading.motion.poses - (poses if wanted is None else wanted.poses)
    assert np.abs(off[1:]).max() < 0.02
    assert (reading.motion.poses[0] == poses[1]).all() == (value == "bridge")
    assert (np.abs(reading.motion.trans[21] - MOTION.trans[21]).max() < 0.01) == (value == "bridge")


PARAMETERS = {
    "smplx_mesh_global_orient": POSES[:, 0],
    "smplx_mesh_body_pose": POSES[:, 1:22].reshape(60, 63),
    "smplx_mesh_left_hand_pose": POSES[:, 25:40].reshape(60, 45),
    "smplx_mesh_transl": MOTION.trans,
    "smplx_mesh_betas": np.zeros((60, 300)),
    "missing": np.ones(60, np.float32),
}


@pytest.mark.parametrize("layout", ["AAA111/{part}/a.npy", "a/{part}.npy"])
def test_a_folder_with_a_file_for_each_parameter_is_one_motion(tmp_path: Path, layout: str):
    files = {part: tmp_path / layout.format(part=part) for part in PARAMETERS}
    for part, file in files.items():
        file.parent.mkdir(parents=True, exist_ok=True)
        np.save(file, PARAMETERS[part])
    np.save(tmp_path / "whole.npy", MOTION.poses)
    ((path, name), (whole, _)) = files_with_motion_names(tmp_path)
    assert whole.name == "whole.npy" and path == files["smplx_mesh_global_orient"]
    assert str(name) == ("AAA111/a.npy" if "AAA" in layout else "a.npy")
    for each in (path, files["smplx_mesh_transl"]):
        reading = read_any_motion(each, parse_import_overrides("hands=flat"))
        np.testing.assert_allclose(reading.motion.poses[:, :66], MOTION.poses[:, :66], atol=1e-6)
        np.testing.assert_allclose(reading.motion.trans, MOTION.trans, atol=1e-6)
    files["smplx_mesh_body_pose"].unlink()
    assert len(list(files_with_motion_names(tmp_path))) == len(PARAMETERS)
    assert "give the folder of all files of the motion" in refusal(files["smplx_mesh_transl"])


def test_quaternions_do_not_offer_their_own_form_among_the_others(tmp_path: Path):
    for form in ("quaternion-wxyz", "quaternion-xyzw", "6d"):
        found = read_any_motion(written(tmp_path, poses=in_form(POSES, form))).assumption_of(
            "rotations"
        )
        assert found is not None and found.value == form and found.alternatives
        assert form not in found.alternatives


def test_expressions_and_betas_of_other_lengths_are_filled_up(tmp_path: Path):
    path = written(tmp_path, betas=np.full(16, 0.5), expressions=MOTION.expressions[:, :50])
    motion = read_any_motion(path).motion
    np.testing.assert_array_equal(motion.betas[:17], [0.5] * 16 + [0])
    np.testing.assert_array_equal(motion.expressions[:, :50], MOTION.expressions[:, :50])
    assert not motion.expressions[:, 50:].any()
    other = written(tmp_path, betas=np.zeros((60, 301)), expressions=np.zeros((60, 128)))
    notes = " ".join(read_any_motion(other).notes)
    assert "not a body shape" in notes and "FLAME coefficients" in notes


@pytest.mark.parametrize(("scale", "unit"), [(1, "m"), (100, "cm"), (1000, "mm")])
def test_units_of_a_body_around_zero_where_its_height_says_nothing(
    tmp_path: Path, scale: float, unit: str
):
    trans = MOTION.trans - (0, MOTION.trans[0, 1], 0)
    reading = read_any_motion(written(tmp_path, trans=scale * trans))
    assert value_of(reading, "units")[0] == unit
    np.testing.assert_allclose(reading.motion.trans, trans, atol=1e-4)


def test_a_large_stage_is_in_metres(tmp_path: Path):
    reading = read_any_motion(written(tmp_path, trans=MOTION.trans + np.array([15.0, 0, 0])))
    assert reading.notes == ()


def test_a_heading_is_turned_only_where_it_is_kept_throughout(tmp_path: Path):
    poses = POSES.copy()
    poses[:, 0] = 0
    poses[:, 0, 1] = np.linspace(0, 2 * np.pi, 60)  # turns once about itself
    facing = read_any_motion(written(tmp_path, poses=poses)).assumption_of("facing")
    assert facing is not None and facing.value == "as-is" and facing.is_own_convention
    poses[:, 0, 1] = np.radians(80)
    path = written(tmp_path, poses=poses)
    assert value_of(read_any_motion(path), "facing") == ("x", "likely")
    kept = read_any_motion(path, parse_import_overrides("facing=as-is")).motion.poses[0, 1]
    assert kept == pytest.approx(np.radians(80), abs=1e-6)


def test_what_is_said_and_does_not_apply_is_told(tmp_path: Path):
    path = tmp_path / "a.npy"
    np.save(path, np.zeros((9, 66)))
    reading = read_any_motion(
        path, parse_import_overrides("units=cm,hands=mean,motion=2,frames=bridge,rate=30")
    )
    vain = [each.kind for each in reading.assumptions if "does not apply" in each.reason]
    assert vain == ["hands", "motion", "units"] and "frame rate 30, set by you" in " ".join(
        reading.notes
    )


def test_a_plain_motion_comes_before_others_of_its_file(tmp_path: Path):
    other = Person(6).motion(60).poses
    path = written(tmp_path, gt_poses=other)
    reading = read_any_motion(path)
    np.testing.assert_array_equal(reading.motion.poses, MOTION.poses)
    assert "also contains gt" in reading.notes[0]
    chosen = read_any_motion(path, parse_import_overrides("motion=gt"))
    np.testing.assert_array_equal(chosen.motion.poses, other)


def test_objects_that_nobody_reads_are_skipped_and_never_loaded(tmp_path: Path):
    class Bomb:
        def __reduce__(self):
            return (Path.touch, (tmp_path / "exploded",))

    reading = read_any_motion(written(tmp_path, gender=np.array(Bomb(), dtype=object)))
    assert "pickled objects, not read" in reading.notes[0]
    assert "never loaded" in refusal(written(tmp_path, poses=np.array([Bomb()], dtype=object)))
    np.save(tmp_path / "theirs.npy", np.array([Bomb()], dtype=object), allow_pickle=True)
    assert "never loaded" in refusal(tmp_path / "theirs.npy")
    assert not (tmp_path / "exploded").exists()


@pytest.mark.parametrize("kind", ["pkl", "npz", "npy"])
def test_what_is_pickled_is_read_after_the_line_that_converts_it(tmp_path: Path, kind: str):
    import pickle

    content = {"clip": {"poses": MOTION.poses, "trans": MOTION.trans, "fps": 30, "name": "a"}}
    path = tmp_path / f"motion.{kind}"
    match kind:
        case "pkl":
            path.write_bytes(pickle.dumps(content))
        case "npz":
            np.savez(path, **{k: np.array(v, dtype=object) for k, v in content.items()})
        case _:
            np.save(path, np.array(content, dtype=object), allow_pickle=True)
    assert "never loaded" in refusal(path)
    command = CONVERT_PICKLE_COMMAND.split('"')[1]
    subprocess.run([sys.executable, "-c", command, str(path)], cwd=tmp_path, check=True)
    reading = read_any_motion(tmp_path / "motion.npz")
    np.testing.assert_array_equal(reading.motion.poses, MOTION.poses)


def test_positions_are_no_rotations(tmp_path: Path):
    places = joints_of(MOTION)
    for array in (places, places.reshape(60, -1), places[:, :22] * 100):
        assert "joint positions, not rotations" in refusal(written(tmp_path, poses=array))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"poses": None}, "contains trans (60, 3)"),
        (
            {"poses": np.zeros((60, 70))},
            "has the shape (60, 70); rotations must have the shape (frames",
        ),
        ({"poses": np.zeros((0, 165))}, "no frames"),
        ({"poses": np.zeros(())}, "has the shape ()"),
        ({"poses": np.full((60, 165), 90.0)}, "radians, not degrees"),
        ({"poses": np.full((60, 220), 0.9)}, "not unit quaternions"),
        ({"poses": np.full((60, 495), 0.9)}, "not rotation matrices"),
        ({"trans": np.zeros((60, 2))}, "(frames, 3)"),
        ({"trans": np.zeros((0, 3))}, "`trans` is empty; it has the shape (0, 3)"),
        ({"trans": np.array(1.0)}, "(frames, 3)"),
        ({"expressions": np.zeros((0, 100))}, "`expressions` is empty"),
        ({"poses": None, "body_pose": np.zeros((0, 63)), "global_orient": POSES[:, 0]}, "is empty"),
        ({"poses": None, "body_pose": np.array(0.0), "global_orient": POSES[:, 0]}, "63 numbers"),
        ({"poses": None, "local_rot_mats": np.zeros((60, 77, 3, 3))}, "kimodo_convert FILE.npz"),
        (
            {"poses": None, "posed_joints": np.zeros((60, 34, 3))},
            "has the 34 joints of the robot Unitree G1",
        ),
        ({"poses": None, "qpos": np.zeros((60, 36))}, "29 joint angles"),
        ({"trans": np.full((60, 3), np.nan)}, "frames 0-59"),
        ({"trans": np.full((60, 3), "x")}, "numbers"),
        ({"trans": np.full((60, 3), 2e5)}, "2e+05"),
        ({"expression_basis": np.array("mine")}, "flame100 and arkit52"),
    ],
)
def test_what_cannot_be_made_up_for_is_refused(tmp_path: Path, changes: dict, words: str):
    assert words in refusal(written(tmp_path, **changes))


def test_all_bad_frames_are_named(tmp_path: Path):
    poses = MOTION.poses.copy()
    poses[[3, 17, 18, 19], 3] = np.inf
    assert "frames 3, 17-19;" in refusal(written(tmp_path, poses=poses))


@pytest.mark.parametrize(
    ("shape", "said"),
    [
        ((60, 104), "no public list says which angle"),
        ((1, 60, 141), r"Give the \.bvh"),
        ((60, 768), "speech features"),
        ((60, 80), "mel spectrogram"),
        ((60, 29), "a motion of the robot Unitree G1"),
        ((60, 30, 3, 3), "has the 30 joints of the skeleton SOMA"),
        ((60,), "one parameter of a motion .*, give the folder of all files"),
        ((60, 63), "one parameter of a motion"),
    ],
)
def test_arrays_that_no_motion_can_be_made_of_say_why(
    shape: tuple[int, ...], said: str, tmp_path: Path
):
    np.save(tmp_path / "pose.npy", np.zeros(shape, np.float32))
    with pytest.raises(MotionError, match=said):
        read_any_motion(tmp_path / "pose.npy")


def test_diffsheg_rows_of_the_upper_body(tmp_path: Path):
    """Spine 3, 6 and 9; 12 to 21; both hands; jaw; 100 of expression."""
    joints = [3, 6, 9, *range(12, 22), *range(25, 55), 22]
    columns = [POSES[:, joints].reshape(60, -1), MOTION.expressions]
    np.save(tmp_path / "out.npy", np.concatenate(columns, axis=1)[None])
    reading = read_any_motion(tmp_path / "out.npy", parse_import_overrides("hands=flat"))
    found = reading.motion.poses.reshape(-1, 55, 3)
    np.testing.assert_allclose(found[:, joints], POSES[:, joints], atol=1e-6)
    rest = [joint for joint in range(55) if joint not in joints]
    assert (found[:, rest] == 0).all() and len(rest) == 11
    np.testing.assert_array_equal(reading.motion.expressions, MOTION.expressions)
    assert {"legs", "place"} <= reading.missing_parts
