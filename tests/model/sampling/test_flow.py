"""Samplers of the flow against closed forms, and speech heard more or less strongly."""

import math

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from conventions.joints import FACE, JOINT_INDEX
from model.motion.packing import Normaliser, joint_channels
from model.motion.rotations import matrix_from_rot6d, rot6d_from_matrix
from model.sampling.flow import ClassifierFreeGuidance, flow_loss_weight, interpolate, sample
from model.sampling.samplers import FLOW_SAMPLERS


def test_path_starts_in_noise_and_ends_in_data():
    x_0, x_1 = torch.randn(3, 5, 2), torch.randn(3, 5, 2)
    torch.testing.assert_close(interpolate(x_0, x_1, torch.zeros(3)), x_0)
    torch.testing.assert_close(interpolate(x_0, x_1, torch.ones(3)), x_1)
    x_t = interpolate(x_0, x_1, torch.tensor([0.25, 0.5, 0.75]))
    torch.testing.assert_close(x_t[0], 0.75 * x_0[0] + 0.25 * x_1[0])


@pytest.mark.parametrize("sampler", FLOW_SAMPLERS)
@pytest.mark.parametrize("steps", [1, 2, 7])
def test_every_sampler_ends_on_a_known_target(sampler, steps):
    target = torch.randn(2, 4)
    calls = []

    def predict(x, t):
        calls.append(t)
        assert 0 <= t < 1
        return target

    end = sample(predict, torch.randn(2, 4), steps=steps, sampler=sampler)
    torch.testing.assert_close(end, target)
    evaluations = {"euler": steps, "heun": 2 * steps - 1, "reinterpolate": 2 * steps}
    assert len(calls) == evaluations[sampler]


def _gaussian_error(sampler: str, steps: int) -> float:
    """End error for data N(2, 0.5^2), whose best x_1 prediction and exact flow are known.

    x_t ~ N(2t, s_t^2) with s_t^2 = (1-t)^2 + (0.5 t)^2, so E[x_1 | x_t] = 2 + 0.25 t / s_t^2
    (x_t - 2t), and the flow carries x_0 to 2 + 0.5 x_0.
    """
    x_0 = torch.linspace(-2, 2, 9, dtype=torch.float64)[None]

    def predict(x, t):
        return 2 + 0.25 * t / ((1 - t) ** 2 + 0.25 * t**2) * (x - 2 * t)

    return float((sample(predict, x_0, steps=steps, sampler=sampler) - (2 + 0.5 * x_0)).abs().max())


def test_euler_is_of_first_and_heun_of_higher_order():
    euler = [_gaussian_error("euler", n) for n in (20, 40, 80)]
    heun = [_gaussian_error("heun", n) for n in (20, 40, 80)]
    assert 1.7 < euler[0] / euler[1] < 2.4 and 1.7 < euler[1] / euler[2] < 2.4
    assert heun[0] / heun[1] > 3 and heun[1] / heun[2] > 3
    assert heun[2] < euler[2] / 10


def test_reinterpolation_keeps_the_noise_and_asks_at_step_middles():
    x_0 = torch.randn(1, 3)
    seen = []

    def predict(x, t):
        seen.append((t, x.clone()))
        return torch.full((1, 3), 5.0)

    sample(predict, x_0, steps=2, sampler="reinterpolate")
    assert [t for t, _ in seen] == [0.0, 0.25, 0.5, 0.75]
    for t, x in seen:
        torch.testing.assert_close(x, (1 - t) * x_0 + t * 5.0)


def test_time_weight_has_mean_one_and_rises():
    t = (torch.arange(1000, dtype=torch.float64) + 0.5) / 1000
    weight = flow_loss_weight(t, 0.1)
    assert math.isclose(float(weight.mean()), 1, abs_tol=1e-4)
    assert (weight.diff() > 0).all()
    torch.testing.assert_close(flow_loss_weight(t, None), torch.ones_like(t))


def normaliser(channels: int, mixed: bool) -> Normaliser:
    generator = torch.Generator().manual_seed(1)
    mean, std = torch.randn(channels, generator=generator), torch.rand(channels) + 0.5
    if not mixed:
        return Normaliser(mean, std)
    mix = torch.linalg.qr(torch.randn(channels, channels, generator=generator))[0]
    return Normaliser(mean, std, mix * 2, mix.T / 2)


@pytest.mark.parametrize(
    ("space", "channels", "face"),
    [
        ("local", 333, joint_channels(FACE)),
        ("axis-angle", 168, [3 * joint + k for joint in FACE for k in range(3)]),
    ],
)
@pytest.mark.parametrize("scale", [0.0, 0.5, 2.5])
def test_the_body_moves_along_what_speech_changes_and_the_jaw_stays(space, channels, face, scale):
    numbers = normaliser(channels, mixed=space == "axis-angle")
    conditional, unconditional = torch.randn(2, 3, 7, channels)
    guide = ClassifierFreeGuidance(scale, numbers, space)
    found = numbers.restore(guide.combine(torch.cat([conditional, unconditional])))
    with_speech, without = numbers.restore(conditional), numbers.restore(unconditional)
    wanted = without + scale * (with_speech - without)
    wanted[..., face] = with_speech[..., face]
    torch.testing.assert_close(found, wanted, atol=1e-4, rtol=1e-4)


def test_neck_and_head_can_have_a_guidance_scale_of_their_own():
    numbers = normaliser(168, mixed=True)
    conditional, unconditional = torch.randn(2, 3, 7, 168)
    both = torch.cat([conditional, unconditional])
    head = [3 * JOINT_INDEX[joint] + k for joint in ("neck", "head") for k in range(3)]
    body, stronger, mixed = (
        numbers.restore(
            ClassifierFreeGuidance(scale, numbers, "axis-angle", head_scale).combine(both)
        )
        for scale, head_scale in ((1.4, None), (2.4, None), (1.4, 2.4))
    )
    body[..., head] = stronger[..., head]
    torch.testing.assert_close(mixed, body, atol=1e-4, rtol=1e-4)
    assert ClassifierFreeGuidance(1.0, numbers, "axis-angle", 2.0).needs_unconditional


def test_in_the_world_the_jaw_goes_with_the_head_and_stays_in_it():
    """Heads that speech turns about one axis: at any scale the jaw is where it was in them."""
    numbers = normaliser(333, mixed=False)
    head, jaw = JOINT_INDEX["head"], JOINT_INDEX["jaw"]

    def vectors(heads: np.ndarray) -> torch.Tensor:
        rotations = np.tile(np.eye(3), (2, 55, 1, 1))
        rotations[:, head] = heads
        in_head = Rotation.from_rotvec([[0.2, 0.0, 0.1], [0.4, 0.1, 0.0]]).as_matrix()
        rotations[:, jaw] = heads @ in_head
        rows = rot6d_from_matrix(torch.tensor(rotations, dtype=torch.float32))
        return torch.cat([rows.flatten(-2), torch.zeros(2, 3)], dim=-1)

    turned = Rotation.from_rotvec([[0.0, 0.02, 0.0], [0.0, -0.02, 0.01]]).as_matrix()
    told = [numbers.normalise(vectors(heads))[None] for heads in (turned, np.eye(3)[None])]
    guide = ClassifierFreeGuidance(2.5, numbers, "global")
    found = numbers.restore(guide.combine(torch.cat(told)))[0]
    rotations = matrix_from_rot6d(found[:, :330].unflatten(-1, (55, 6))).numpy()
    in_head = np.swapaxes(rotations[:, head], -1, -2) @ rotations[:, jaw]
    wanted = Rotation.from_rotvec([[0.2, 0.0, 0.1], [0.4, 0.1, 0.0]]).as_matrix()
    np.testing.assert_allclose(in_head, wanted, atol=2e-3)
    angles = Rotation.from_matrix(rotations[:, head]).magnitude()
    np.testing.assert_allclose(angles, [2.5 * 0.02, 2.5 * np.hypot(0.02, 0.01)], rtol=0.01)


def test_conditional_copies_come_first_and_at_scale_1_there_is_one():
    numbers, batch = normaliser(168, mixed=True), torch.randn(2, 4, 168)
    once, twice = (ClassifierFreeGuidance(scale, numbers, "axis-angle") for scale in (1.0, 2.0))
    assert once.network_batch_size(2) == 2 and once.conditional_mask(2).tolist() == [True, True]
    assert once.duplicate(batch) is batch and once.combine(batch) is batch
    assert twice.conditional_mask(2).tolist() == [True, True, False, False]
    assert torch.equal(twice.duplicate(batch), torch.cat([batch, batch]))
    with pytest.raises(ValueError, match="steps is 0"):
        sample(lambda x, t: x, torch.zeros(1, 1), steps=0)
