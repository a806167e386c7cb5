"""The authors' checkpoints move as by their own script, and like any other system."""

import copy
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from conventions.joints import JOINT_NAMES
from model.generation.windows import GenerateOptions, generate_motion
from model.motion.kinematics import (
    joint_positions_from_global,
    local_from_global,
    open_body_skeleton,
)
from model.motion.motion import Motion, save_motion
from model.motion.rotations import matrix_from_axis_angle, matrix_from_rot6d
from model.sampling.samplers import UnknownNameError
from model.storage.cards import CheckpointError
from model.systems.official import FAMILY, FILTERED, UNFILTERED
from model.systems.official.networks import OfficialExpressionNetwork, OfficialMotionNetwork
from model.systems.official.seed import first_seed, seed_of, standing
from model.systems.official.system import OfficialSystem, smoothed
from model.systems.registry import list_speakers, list_systems, load_system
from tests.helpers import official_folder, smooth_motion_example
from tests.model.made import made_speech, make_weights
from tests.model.systems.official.filled import fill, made
from tests.model.systems.official.given_windows import GivenWindows, Networks
from tests.model.systems.official.made_official import make_features, make_official

KINDS = ("filtered", "unfiltered")
CLIPS = (0, 1)
CLOSE = 1e-4


@pytest.fixture(scope="module")
def reference() -> dict[str, np.ndarray]:
    with np.load(official_folder() / "reference-inference.npz") as archive:
        return {name: archive[name] for name in archive.files}


@pytest.fixture(scope="module")
def networks() -> Networks:
    return fill(OfficialMotionNetwork()), fill(OfficialExpressionNetwork())


def _given(reference: dict[str, np.ndarray], clip: int) -> GivenWindows:
    return GivenWindows(
        speaker=int(reference["pid"][clip]),
        start_poses=reference["seed_poses_axis_angle_local"][clip],
        start_trans=reference["seed_trans"][clip],
        features=torch.from_numpy(reference["features"][clip, :2]),
        noise=torch.from_numpy(reference["noise"][:2, clip]),
    )


@pytest.mark.parametrize("clip", CLIPS)
@pytest.mark.parametrize("kind", KINDS)
def test_two_windows_equal_the_authors(reference, networks, kind, clip):
    """In single precision: where a row of 6D is short, Gram-Schmidt makes more of the last digit,
    so a few numbers in a hundred thousand differ by more."""
    given = _given(reference, clip)
    (first, _), whole = given.run(networks, kind == "filtered")
    seeds = reference[f"{kind}_seed_window"][:, clip]
    np.testing.assert_allclose(given.start, seeds[0], atol=1e-6)
    np.testing.assert_allclose(first.vectors[0, -8:], seeds[1], atol=CLOSE)
    error = np.abs(whole.vectors[0, :, :330].numpy() - reference[f"{kind}_stitched_rot6d"][clip])
    assert error.max() < 5e-4 and (error > CLOSE).mean() < 3e-4
    np.testing.assert_allclose(whole.root[0], reference[f"{kind}_trans_{clip}"], atol=2e-5)
    face = reference[f"filtered_expressions_{clip}"]  # the filter leaves it alone
    np.testing.assert_allclose(whole.expression[0], face, atol=2e-5)


def test_two_windows_equal_the_authors_to_the_last_number(reference, networks):
    """In double precision, without our own rounding: the reference's is left."""
    networks = tuple(copy.deepcopy(network).double() for network in networks)
    _, whole = _given(reference, 0).run(networks, True, torch.float64)
    wanted = reference["filtered_stitched_rot6d"][0]
    np.testing.assert_allclose(whole.vectors[0, :, :330], wanted, atol=CLOSE)


@pytest.mark.parametrize("clip", CLIPS)
def test_written_poses_are_the_authors(reference, networks, clip):
    _, whole = _given(reference, clip).run(networks, True)
    local = local_from_global(whole.rotmat[0].double())
    written = torch.from_numpy(reference[f"filtered_poses_{clip}"]).double().unflatten(-1, (55, 3))
    error = (local - matrix_from_axis_angle(written)).abs().amax((-1, -2)).numpy()
    sure = ~reference["filtered_axis_angle_unreliable"][clip]  # near pi theirs is no rotation
    assert sure.mean() > 0.98 and error[sure].max() < 2e-3


def test_each_evaluation_equals_the_authors(reference, networks):
    """What the network is given and what it says, ten times in each of two windows."""
    asked: list[tuple[float, Tensor, Tensor]] = []

    def keep(_module, given, answer) -> None:
        asked.append((float(given[1][0]), given[0][0].clone(), answer[0].clone()))

    handle = networks[0].register_forward_hook(keep)
    _given(reference, 0).run(networks, True)
    handle.remove()
    at = reference["trace_frames"]
    np.testing.assert_allclose([t for t, _, _ in asked], reference["trace_t"], atol=1e-7)
    np.testing.assert_allclose(
        np.stack([x[at] for _, x, _ in asked]), reference["trace_x"], atol=CLOSE
    )
    np.testing.assert_allclose(
        np.stack([x_1[at] for _, _, x_1 in asked]), reference["trace_x1"], atol=CLOSE
    )


def test_the_filter_is_the_authors():
    with np.load(official_folder() / "reference-rotations.npz") as wanted:
        given = torch.from_numpy(wanted["filter_in"])
        led = torch.cat([torch.zeros(1, 5, given.shape[-1]), given], dim=1)
        np.testing.assert_allclose(smoothed(led)[:, 5:], wanted["filter_out"], atol=1e-6)


def test_the_filter_changes_only_the_middle():
    vectors = made("vectors", (2, 60, 7))
    changed = (smoothed(vectors) != vectors).any(-1).any(0)
    assert changed.nonzero().flatten().tolist() == list(range(8, 57))
    parabola = (torch.linspace(-1, 1, 60)[:, None] ** 2).expand(1, -1, 3)
    torch.testing.assert_close(smoothed(parabola), parabola, atol=1e-6, rtol=0)


# From here on: the family, with checkpoints of the real size and weights by the rule.


@pytest.fixture(scope="module")
def checkpoints(tmp_path_factory) -> Path:
    return make_official(tmp_path_factory.mktemp("official"))


@pytest.fixture
def named(checkpoints, tmp_path, monkeypatch) -> Path:
    """The checkpoints, as a person names them, with features of 10 s of speech."""
    monkeypatch.setenv("OFFICIAL_DIR", str(checkpoints))
    monkeypatch.setenv("OFFICIAL_FEATURES", str(make_features(tmp_path / "features.npz", 6)))
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


def test_it_speaks_for_the_others_as_no_speaker(named, tmp_path):
    weights = make_weights(tmp_path / "weights")
    assert list_systems(weights)[-2:] == (FILTERED, UNFILTERED)
    assert list_speakers(weights) == ("ann", "bob")
    table = FAMILY.card(FILTERED, weights)["speakers"]
    assert table["scott"] == 2 and table["katya"] == 30 and table["ann"] == table["bob"] == 0
    assert "ann" not in FAMILY.card(FILTERED, tmp_path / "empty")["speakers"]


def test_ten_seconds_of_motion(named, tmp_path):
    speech = made_speech(160_000)
    options = GenerateOptions(speaker="scott", samples=2, steps=2)
    made_by = {
        name: generate_motion(load_system(name, tmp_path), speech, options)
        for name in (FILTERED, UNFILTERED)
    }
    for first, second in made_by.values():
        assert first.num_frames == second.num_frames == 300
        assert first.expression_basis == "flame100" and first.expressions.std(0).min() > 1e-3
        assert np.abs(first.poses - second.poses).max() > 1e-2
        np.testing.assert_array_equal(first.expressions, second.expressions)

    def jerk(motions: list[Motion]) -> float:
        return float(np.abs(np.diff(motions[0].trans, 3, axis=0)).mean())

    assert jerk(made_by[FILTERED]) < 0.5 * jerk(made_by[UNFILTERED])
    (other,) = generate_motion(
        load_system(FILTERED, tmp_path), speech, GenerateOptions(speaker="katya", steps=1)
    )
    assert np.abs(other.expressions - made_by[FILTERED][0].expressions).max() > 1e-2


def test_both_systems_share_one_network(named, tmp_path):
    smooth, raw = (load_system(name, tmp_path) for name in (FILTERED, UNFILTERED))
    assert isinstance(smooth, OfficialSystem) and isinstance(raw, OfficialSystem)
    assert smooth.network is raw.network and smooth.filters and not raw.filters
    assert [len(sha256) for sha256 in smooth.sha256s.values()] == [64, 64]
    with pytest.raises(UnknownNameError, match="There is no speaker 'nobody'"):
        smooth.speaker_index("nobody")


def test_a_motion_to_start_from_can_be_named(tmp_path, monkeypatch):
    motion = smooth_motion_example(12)
    save_motion(motion, tmp_path / "start.npz")
    monkeypatch.setenv("OFFICIAL_SEED", str(tmp_path / "start.npz"))
    assert torch.equal(first_seed(), seed_of(motion))
    monkeypatch.delenv("OFFICIAL_SEED")
    assert torch.equal(first_seed(), standing())
    with pytest.raises(ValueError, match="has 4 frames; 8 are needed"):
        seed_of(motion.part(slice(4)))


def test_who_stands_at_the_beginning_lets_the_arms_hang():
    vectors = standing()
    rotmat = matrix_from_rot6d(vectors[..., :330].unflatten(-1, (55, 6)))
    joints = joint_positions_from_global(rotmat, open_body_skeleton(), vectors[..., 330:])[0]
    place = {name: joints[index] for index, name in enumerate(JOINT_NAMES)}
    for side in ("left", "right"):
        wrist, shoulder = place[f"{side}_wrist"], place[f"{side}_shoulder"]
        assert wrist[1] < shoulder[1] - 0.3 and abs(float(wrist[0])) < 0.5
    left, right = place["left_wrist"], place["right_wrist"]
    np.testing.assert_allclose(left[1:], right[1:], atol=0.03)
