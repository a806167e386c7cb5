"""The family of the authors' checkpoints, of the real size, with weights by the rule."""

from pathlib import Path

import numpy as np
import pytest
import torch

from conventions.joints import JOINT_NAMES
from model.generation.windows import GenerateOptions, generate_motion
from model.motion.kinematics import joint_positions_from_global, open_body_skeleton
from model.motion.motion import Motion, save_motion
from model.motion.rotations import matrix_from_rot6d
from model.sampling.samplers import UnknownNameError
from model.storage.cards import CheckpointError
from model.systems.official.config import FAMILY, FILTERED, UNFILTERED
from model.systems.official.system import (
    OfficialSystem,
    initial_seed_pose,
    seed_pose_of,
    standing_seed_pose,
)
from model.systems.registry import list_systems, load_system, shared_speakers
from tests.helpers import smooth_motion_example
from tests.model.made import made_speech
from tests.model.systems.official.made_official import make_features, make_official


@pytest.fixture
def named(made_once, tmp_path, monkeypatch) -> Path:
    """The checkpoints, as a person names them, with features of 3 s of speech."""
    checkpoints = made_once("official", make_official)
    monkeypatch.setenv("OFFICIAL_DIR", str(checkpoints))
    monkeypatch.setenv("OFFICIAL_FEATURES", str(make_features(tmp_path / "features.npz", 2)))
    monkeypatch.delenv("OFFICIAL_SEED", raising=False)
    return checkpoints


def test_it_is_there_only_where_it_is_named(tmp_path, monkeypatch):
    monkeypatch.delenv("OFFICIAL_DIR", raising=False)
    assert list_systems(tmp_path) == ()
    with pytest.raises(UnknownNameError, match="There is no system 'official/authors'"):
        load_system(FILTERED, tmp_path)
    monkeypatch.setenv("OFFICIAL_DIR", str(tmp_path))
    assert list_systems(tmp_path) == (FILTERED, UNFILTERED)
    with pytest.raises(CheckpointError, match="holds no file of the motion network"):
        load_system(FILTERED, tmp_path)


def test_it_speaks_for_the_others_as_no_speaker(named, weights, tmp_path):
    assert list_systems(weights)[-2:] == (FILTERED, UNFILTERED)
    assert shared_speakers(weights) == ("ann", "bob")
    table = FAMILY.card(FILTERED, weights)["speakers"]
    assert table["scott"] == 2 and table["katya"] == 30 and table["ann"] == table["bob"] == 0
    assert "ann" not in FAMILY.card(FILTERED, tmp_path / "empty")["speakers"]


def test_both_move_by_one_network_for_as_long_as_the_speech(named, tmp_path):
    smooth, raw = (load_system(name, tmp_path) for name in (FILTERED, UNFILTERED))
    assert isinstance(smooth, OfficialSystem) and isinstance(raw, OfficialSystem)
    assert smooth.network is raw.network and smooth.smooths_windows and not raw.smooths_windows
    assert [len(sha256) for sha256 in smooth.sha256s.values()] == [64, 64]
    with pytest.raises(UnknownNameError, match="There is no speaker 'nobody'"):
        smooth.speaker_index("nobody")
    speech = made_speech(48_000)
    options = GenerateOptions(speaker="scott", num_samples=2, steps=1)
    made_by = {system.name: generate_motion(system, speech, options) for system in (smooth, raw)}
    for first, second in made_by.values():
        assert first.num_frames == second.num_frames == 90
        assert first.expression_basis == "flame100" and first.expressions.std(0).min() > 1e-3
        assert np.abs(first.poses - second.poses).max() > 1e-2
        np.testing.assert_array_equal(first.expressions, second.expressions)

    def jerk(motions: list[Motion]) -> float:
        return float(np.abs(np.diff(motions[0].trans, 3, axis=0)).mean())

    assert jerk(made_by[FILTERED]) < 0.5 * jerk(made_by[UNFILTERED])
    (other,) = generate_motion(smooth, speech, GenerateOptions(speaker="katya", steps=1))
    assert np.abs(other.expressions - made_by[FILTERED][0].expressions).max() > 1e-2


def test_a_motion_to_start_from_can_be_named(tmp_path, monkeypatch):
    motion = smooth_motion_example(12)
    save_motion(motion, tmp_path / "start.npz")
    monkeypatch.setenv("OFFICIAL_SEED", str(tmp_path / "start.npz"))
    assert torch.equal(initial_seed_pose(), seed_pose_of(motion))
    monkeypatch.delenv("OFFICIAL_SEED")
    assert torch.equal(initial_seed_pose(), standing_seed_pose())
    with pytest.raises(ValueError, match="has 4 frames; 8 are needed"):
        seed_pose_of(motion.part(slice(4)))


def test_who_stands_at_the_beginning_lets_the_arms_hang():
    vectors = standing_seed_pose()
    rotmat = matrix_from_rot6d(vectors[..., :330].unflatten(-1, (55, 6)))
    joints = joint_positions_from_global(rotmat, open_body_skeleton(), vectors[..., 330:])[0]
    place = {name: joints[index] for index, name in enumerate(JOINT_NAMES)}
    for side in ("left", "right"):
        wrist, shoulder = place[f"{side}_wrist"], place[f"{side}_shoulder"]
        assert wrist[1] < shoulder[1] - 0.3 and abs(float(wrist[0])) < 0.5
    left, right = place["left_wrist"], place["right_wrist"]
    np.testing.assert_allclose(left[1:], right[1:], atol=0.03)
