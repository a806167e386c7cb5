"""Equal noise on local and on global rotations, on two bodies."""

from dataclasses import replace
from pathlib import Path

import av
import pytest

from app.errors import RunError
from app.run.experiments.mechanism import NAMES, MechanismRequest, show_mechanism
from app.run.requests.request import Artefact
from model.motion.motion import load_motion, save_motion
from tests.helpers import smooth_motion_example


@pytest.fixture
def asked(tmp_path: Path) -> MechanismRequest:
    save_motion(smooth_motion_example(20), tmp_path / "motion.npz")
    return MechanismRequest(tmp_path / "motion.npz", tmp_path / "two.mp4", size=256)


@pytest.mark.gl
def test_two_bodies_stand_side_by_side_and_the_numbers_are_told(asked: MechanismRequest) -> None:
    shares: list[float] = []
    path, sentences = show_mechanism(replace(asked, noise_rad=0.05), shares.append)
    assert path == asked.out
    with av.open(str(path)) as video:
        frames = [frame.to_ndarray(format="rgb24") for frame in video.decode(video=0)]
    assert len(frames) == 20 and frames[0].shape[1] == 2 * 192
    assert shares == sorted(shares) and shares[-1] == pytest.approx(1.0, abs=0.1)
    told = " ".join(sentences)
    assert "Noise of 0.05 rad on every joint moves the right middle fingertip" in told
    assert "times as far (predicted from lever arms" in told
    assert "Equal noise is an assumption" in told
    local, world = (
        abs(after.astype(int) - before).mean()
        for after, before in (
            (frames[10][:, :192], frames[9][:, :192]),
            (frames[10][:, 192:], frames[9][:, 192:]),
        )
    )
    assert local > world, "the left one trembles more"


def test_both_motions_are_left_for_a_player_without_a_video(asked: MechanismRequest) -> None:
    told: list[Artefact] = []
    played = replace(asked, is_played=True, has_video=False, noise_rad=0.05)
    path, sentences = show_mechanism(played, on_file=told.append)
    assert path is None and not asked.out.exists() and "0.05 rad" in " ".join(sentences)
    assert [(each.kind, each.name) for each in told] == [("motion", name) for name in NAMES]
    clean = load_motion(asked.motion)
    on_local, on_global = (load_motion(each.path) for each in told)
    pelvis = slice(0, 3)
    for motion in (on_local, on_global):
        assert motion.num_frames == 20 and abs(motion.poses - clean.poses).max() > 0.02
    assert abs(on_local.poses - on_global.poses)[:, pelvis.stop :].max() > 0.02


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"noise_rad": 0.2}, "0.005 to 0.1 rad; got 0.2"),
        ({"noise_rad": 0.0}, "got 0"),
        ({"seed": -1}, "must not be negative"),
        ({"out": Path("two.png")}, "must end in .mp4"),
        ({"out": Path("/nowhere/two.mp4")}, "does not exist"),
        ({"joint": "pelvis"}, "No rotation moves the pelvis"),
    ],
)
def test_what_cannot_be_is_refused(asked: MechanismRequest, changes, words: str) -> None:
    with pytest.raises(RunError, match=words):
        show_mechanism(replace(asked, **changes))
