"""Motion files of anyone's, as they stand in videos: in register, and not for ever."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from app.run.diagnose import DiagnoseRequest, diagnose_files
from app.run.examples import CLEAN, FAULTY, TWO_MINUTES, planted_files, tremble, with_faults
from app.run.requests.request import Artefact
from app.run.videos import own_videos
from app.run.videos.own_videos import SOLE_M, VideoOptions, in_register, picture_motions
from conventions.joints import JOINT_INDEX
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion, load_motion, save_motion
from model.motion.tracks import track_points
from renderer.video.encoder import read_facts


def moved(motion: Motion, degrees: float) -> Motion:
    """Somewhere else, and turned about the vertical."""
    turn = Rotation.from_euler("y", degrees, degrees=True)
    rest = open_body_skeleton().rest_joints[0].double().numpy()
    poses = motion.poses.reshape(len(motion.poses), -1, 3).copy()
    poses[:, 0] = (turn * Rotation.from_rotvec(poses[:, 0])).as_rotvec()
    trans = turn.apply(motion.trans + rest) - rest + (3.0, 0.4, -2.0)
    return replace(motion, poses=poses.reshape(len(poses), -1), trans=trans.astype(np.float32))


@pytest.mark.parametrize("degrees", [0.0, 90.0, -170.0])
def test_motions_of_other_places_are_laid_onto_each_other(degrees: float) -> None:
    motion = load_motion(CLEAN).part(slice(60))
    skeleton = open_body_skeleton()
    own = track_points(in_register(motion), skeleton).joints
    theirs = track_points(in_register(moved(motion, degrees)), skeleton).joints
    np.testing.assert_allclose(theirs, own, atol=1e-4)
    across = own[:, JOINT_INDEX["left_hip"]] - own[:, JOINT_INDEX["right_hip"]]
    assert abs(across[:, 2].mean()) < 1e-4 < across[:, 0].mean()
    np.testing.assert_allclose(np.median(own[:, 0], axis=0)[[0, 2]], 0.0, atol=1e-5)
    feet = own[:, [JOINT_INDEX["left_foot"], JOINT_INDEX["right_foot"]], 1].min(axis=1)
    assert np.median(feet) == pytest.approx(SOLE_M, abs=1e-5)


def test_only_what_can_be_drawn_in_time_is_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(own_videos, "MAX_FRAMES", 60)
    motion = load_motion(CLEAN)
    pictured = picture_motions({"long": motion, "short": motion.part(slice(20))})
    assert [each.num_frames for each in pictured.motions.values()] == [30, 20]
    assert pictured.notes == ("Stage and videos show the first 1 s of long.",)


@pytest.mark.gl
def test_each_file_keeps_its_length_and_is_told_of(tmp_path: Path) -> None:
    name = "trembling"
    clean = load_motion(CLEAN).part(slice(150))
    save_motion(clean, tmp_path / "clean.npz")
    calmer = replace(clean, expressions=(0.9 * clean.expressions).astype(np.float32))
    save_motion(tremble(calmer), tmp_path / f"{name}.npz")
    told: list[Artefact] = []
    request = DiagnoseRequest(
        motions=(tmp_path / f"{name}.npz",),
        out=tmp_path / "out",
        reference=tmp_path / "clean.npz",
        has_pictures=False,
        videos=VideoOptions(size=256, close_ups=("hands",), has_posters=True),
        is_played=True,
    )
    shares: list[float] = []
    found = diagnose_files(request, shares.append, told.append)
    assert shares == sorted(shares) and shares[-1] == pytest.approx(1.0)
    kinds = {(each.kind, each.name) for each in told}
    names = (name, "reference")
    every = ("motion", "poster", "video")
    assert kinds == {(kind, name) for kind in every for name in names}
    videos = [path for path in found.files if path.suffix == ".mp4"]
    assert {path.stem for path in videos} == set(names)
    assert all(read_facts(path).num_frames == 150 for path in videos)
    kinds_found = {finding.kind for finding in found.diagnostics.findings[name]}
    assert "joint_noise" in kinds_found and "copied_face" not in kinds_found


def test_every_planted_fault_is_found(tmp_path: Path) -> None:
    (path,), reference, speech, transcript = planted_files(tmp_path)
    request = DiagnoseRequest(
        (Path(path),),
        tmp_path / "out",
        reference=Path(reference),
        speech=Path(speech),
        transcript=Path(transcript),
        has_pictures=False,
    )
    result = diagnose_files(request)
    assert result.notes == ()
    findings = result.diagnostics.findings
    found = {finding.kind: finding for finding in findings[FAULTY]}
    assert set(found) == {
        *("frozen", "joint_noise", "foot_slide", "floating", "period"),
        *("high_frequency", "jerk"),
    }
    assert (
        abs(found["frozen"].worst_frame - 90.25 * 30) < 5
        and 3000 < found["floating"].worst_frame < 3240
    )
    assert found["joint_noise"].numbers["noise_deg"].keys() == {
        *("right_shoulder", "right_elbow", "right_wrist"),
    }
    assert findings["reference"] == []


def test_faults_are_planted_in_their_seconds_alone() -> None:
    clean = load_motion(TWO_MINUTES)
    faulty = with_faults(clean)
    is_changed = (faulty.poses != clean.poses).any(1) | (faulty.trans != clean.trans).any(1)
    assert not is_changed[: 4 * 30].any() and not is_changed[114 * 30 :].any()
    assert is_changed[4 * 30 : 114 * 30].mean() > 0.95, "sliding feet stand for a moment"
    step = np.linalg.norm(np.diff(faulty.trans, axis=0), axis=1).max()
    assert step < 0.05, "only joints jump"
