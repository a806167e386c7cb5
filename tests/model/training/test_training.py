"""Losses, targets, shares of a batch, and the fast training step beside the plain one."""

import json
import subprocess
import sys

import numpy as np
import pytest
import torch

from model.data.prepared import prepare
from model.motion.kinematics import open_body_skeleton
from model.motion.packing import ROTATION_DIM, decode, poses_to_vectors
from model.networks.branch import Attention
from model.speech.features import MelEncoder
from model.storage.checkpoint import load_weights
from model.training import losses, parallel
from model.training.config import TrainConfig
from model.training.targets import prepare_targets
from model.training.task import learning_rate_factor
from tests.helpers import ROOT
from tests.model.training.made import log_of, train_in_processes


@pytest.fixture(scope="module")
def data(tmp_path_factory, data_folder):
    return prepare(data_folder, tmp_path_factory.mktemp("prepared"), MelEncoder())


def test_simple_loss_is_the_mean_square_of_each_sample():
    x_1 = torch.zeros(2, 3, 4)
    target = torch.zeros(2, 3, 4)
    target[1] = 2.0
    torch.testing.assert_close(losses.simple_loss(x_1, target), torch.tensor([0.0, 4.0]))


def test_position_loss_turns_from_squared_to_absolute_at_two_centimetres():
    target = torch.zeros(3, 5, 7, 3)
    error = torch.tensor([0.01, 0.02, 0.12])
    positions = target + error[:, None, None, None]
    # e^2 / (2 * 0.02) below, e - 0.01 above
    expected = torch.tensor([0.0025, 0.01, 0.11])
    torch.testing.assert_close(losses.points_loss(positions, target), expected)


def test_differences_ignore_what_is_constant_or_grows_evenly():
    time = torch.arange(6.0)[None, :, None, None].expand(2, 6, 4, 3)
    zero = torch.zeros_like(time)
    still, drifting, speeding = zero + 1, 0.1 * time, 0.05 * time**2
    none = torch.zeros(2)
    torch.testing.assert_close(losses.points_loss(still, zero, 1), none)
    # 0.1 m per frame: 0.1 - 0.01
    torch.testing.assert_close(losses.points_loss(drifting, zero, 1), none + 0.09)
    torch.testing.assert_close(losses.points_loss(drifting, zero, 2), none, atol=1e-6, rtol=0)
    # the second difference of 0.05 k^2 is 0.1
    torch.testing.assert_close(losses.points_loss(speeding, zero, 2), none + 0.09)


def test_difference_loss_sees_flicker_and_no_offset():
    target = torch.zeros(1, 8, 2)
    flicker = target + 0.1 * torch.tensor([1.0, -1.0] * 4)[None, :, None]
    torch.testing.assert_close(losses.first_difference_loss(target + 0.1, target), torch.zeros(1))
    torch.testing.assert_close(
        losses.first_difference_loss(flicker, target), torch.full((1,), 0.04)
    )


def test_contact_loss_sees_steps_of_feet_that_stand_and_of_no_others():
    stands, walks = torch.zeros(1, 5, 55, 3), torch.zeros(1, 5, 55, 3)
    walks[..., 0] = 0.05 * torch.arange(5.0)[:, None]  # 1.5 m/s
    sliding = stands.clone()
    sliding[..., losses.FEET[0], 0] = 0.01 * torch.arange(5.0)  # one of four points, 1 cm a frame
    torch.testing.assert_close(losses.contact_loss(sliding, stands), torch.tensor([0.25]))
    torch.testing.assert_close(losses.contact_loss(sliding, walks), torch.zeros(1))
    lifted = stands.clone()
    lifted[..., 1] = 0.01 * torch.arange(5.0)[:, None]
    torch.testing.assert_close(losses.contact_loss(lifted, stands), torch.zeros(1))


def test_kl_is_zero_for_the_standard_normal_and_half_for_a_mean_of_one():
    zero, one = torch.zeros(2, 5, 3), torch.ones(2, 5, 3)
    torch.testing.assert_close(losses.kl_loss([(zero, zero)]), torch.zeros(2))
    torch.testing.assert_close(losses.kl_loss([(one, zero), (zero, zero)]), torch.full((2,), 0.5))


def test_a_loss_that_is_no_number_names_step_and_clips():
    with pytest.raises(FloatingPointError, match=r"total is nan at step 7; .*: a, b\."):
        losses.finite_or_raise({"simple": 1.0, "total": float("nan")}, 7, ["a", "b", "a"])
    losses.finite_or_raise({"total": 1.0}, 7, ["a"])


def test_places_are_from_where_each_clip_is_at_home(data):
    targets = prepare_targets(data, "global", "place", open_body_skeleton())
    for clip in data.clips:
        place = targets.vectors[clip.start : clip.stop, ROTATION_DIM:]
        np.testing.assert_allclose(place[:, [0, 2]].mean(0), 0, atol=1e-5)
        np.testing.assert_allclose(place[:, 1], data.transl[clip.start : clip.stop, 1], atol=1e-6)


def test_targets_of_another_skeleton_are_made_anew(data):
    index = data.cache_folder / "targets-global-velocity.json"
    prepare_targets(data, "global", "velocity", open_body_skeleton())
    known = json.loads(index.read_text())
    known["rest_joints"][0][0] += 1.0
    index.write_text(json.dumps(known))
    (data.cache_folder / "rooted-global-velocity.raw").write_bytes(b"")
    targets = prepare_targets(data, "global", "velocity", open_body_skeleton())
    assert len(targets.untranslated_positions) == len(data.poses)


def test_context_is_held_at_both_ends_of_a_clip(data):
    clip = data.clips_of_split("train")[1]
    for start in (clip.start, clip.stop - 60):
        frames = np.arange(start, start + 60)[None]
        batch = data.batch(frames, [clip], context=25)
        rows = np.arange(start - 25, start + 85).clip(clip.start, clip.stop - 1)
        wanted = torch.from_numpy(data.speech[rows].astype(np.float32))
        torch.testing.assert_close(batch.speech[0], wanted)


def test_attention_written_out_is_torchs_own():
    attention = Attention(24, 3)
    x, memory = torch.randn(2, 60, 24), torch.randn(2, 8, 24)

    def heads(y):
        return y.unflatten(-1, (3, -1)).transpose(1, 2)

    key, value = (heads(part) for part in attention.key_value(memory).chunk(2, dim=-1))
    mixed = torch.nn.functional.scaled_dot_product_attention(heads(attention.query(x)), key, value)
    wanted = attention.out(mixed.transpose(1, 2).flatten(-2))
    torch.testing.assert_close(attention(x, memory), wanted, atol=1e-6, rtol=1e-5)


@pytest.mark.slow
@pytest.mark.timeout(400)  # a compiler takes its time
def test_a_compiled_step_is_the_step(tmp_path, data_folder):
    """In processes of their own: the tests' checks of shapes are nothing that compiles."""
    if not parallel.can_compile():
        pytest.skip("There is no C++ compiler here.")
    for name, flags in (("plain", ["--no-compile"]), ("compiled", [])):
        command = [sys.executable, "-m", "model.train", "smoke", "--set", "steps=3", *flags,
                   "--data", str(data_folder), "--out", str(tmp_path / name)]  # fmt: skip
        subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    plain, compiled = (log_of(tmp_path / name) for name in ("plain", "compiled"))
    for row, other in zip(plain, compiled, strict=True):
        for column in (name for name in row if row[name] and name != "split"):
            assert float(other[column]) == pytest.approx(float(row[column]), rel=2e-3, abs=1e-7)


@pytest.mark.parametrize("space", ["local", "global", "axis-angle"])
def test_mapped_targets_equal_converted_windows(data, space):
    skeleton = open_body_skeleton()
    targets = prepare_targets(data, space, "velocity", skeleton)
    batch = data.draw_windows(data.clips_of_split("train"), 60, 5, np.random.default_rng(0))
    wanted_vectors = poses_to_vectors(space, batch.poses, batch.transl)
    wanted = decode(wanted_vectors, space, skeleton)
    for rotations in (True, False):
        vectors, found = targets.for_batch(batch, with_rotations=rotations)
        # The first velocity of a window is that from the frame before, which it does not know.
        torch.testing.assert_close(vectors[:, 1:], wanted_vectors[:, 1:], atol=1e-4, rtol=1e-4)
        torch.testing.assert_close(found.positions, wanted.positions, atol=1e-4, rtol=1e-4)
        at_start = found.positions[:, 0, 0, [0, 2]] - skeleton.rest_joints[0, [0, 2]]
        assert at_start.abs().max() < 1e-6
        assert rotations or found.R_world_joint is None
        for name in ("R_world_joint", "global_vectors") if rotations else ():
            own, other = (getattr(one, name)[..., :ROTATION_DIM] for one in (found, wanted))
            torch.testing.assert_close(own, other, atol=1e-5, rtol=1e-4)


def test_learning_rate_warms_up_and_decays():
    config = TrainConfig("any", steps=1000, warmup_steps=100)
    factors = [learning_rate_factor(step, config) for step in range(1000)]
    assert factors[:2] == [0.01, 0.02] and factors[99:101] == [1.0, 1.0] and max(factors) == 1.0
    assert factors[550] == pytest.approx(0.51) and all(np.diff(factors[99:]) <= 0)
    assert factors[-1] == pytest.approx(0.02, abs=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("system", ["motion-vae", "gan/20"])
def test_two_processes_train_as_one_does(tmp_path, data_folder, system):
    """torchrun and a single process: same losses, gradients and weights, up to rounding.

    The variational network draws the most kinds of random numbers: windows, mirrors, masks, noise;
    the adversary averages the gradients of two networks by itself.
    """
    arguments = ["smoke", "--system", system, "--set", "steps=4", "--data", str(data_folder)]
    arguments += ["--no-compile"]
    train_in_processes(1, arguments, tmp_path / "one")
    train_in_processes(2, arguments, tmp_path / "two")
    one, two = log_of(tmp_path / "one"), log_of(tmp_path / "two")
    assert [row["split"] for row in one] == [row["split"] for row in two] == ["val", "train"]
    for row, other in zip(one, two, strict=True):
        for column in row:
            # How much a batch spreads is not the mean over its shares.
            if row[column] and column not in ("split", "liveliness"):
                wanted = pytest.approx(float(row[column]), rel=1e-3, abs=1e-5)
                assert float(other[column]) == wanted, column
    weights, others = (
        load_weights(tmp_path / name / "weights", system)[0] for name in ("one", "two")
    )
    for key, tensor in weights.items():
        torch.testing.assert_close(others[key], tensor, rtol=1e-2, atol=2e-4)


@pytest.mark.parametrize(
    ("found", "told"), [(None, "No C++ compiler was found"), ("/g++", "ld: cannot find -lomp")]
)
def test_without_a_compiler_that_works_the_step_stays_as_it_is(monkeypatch, caplog, found, told):
    def broken(*_, **__):
        raise RuntimeError("ld: cannot find -lomp\nmore lines")

    parallel.can_compile.cache_clear()
    monkeypatch.setattr(parallel.shutil, "which", lambda name: found)
    monkeypatch.setattr(parallel.torch, "compile", broken)
    with caplog.at_level("INFO"):
        assert not parallel.can_compile()
    assert told in caplog.text and "more lines" not in caplog.text
    parallel.can_compile.cache_clear()
