import math

import pytest
import torch

from model.sampling.flow import interpolate
from model.systems.asynfusion.sampling import flow_times, noise_of, trailing_steps


def kept_shares() -> list[float]:
    """The cumulative products of DDPM, step by step."""
    product, found = 1.0, []
    for k in range(1000):
        product *= 1 - (1e-4 + k * (0.02 - 1e-4) / 999)
        found.append(product)
    return found


def test_flow_times_are_those_of_ddpms_linear_betas():
    times = flow_times()
    assert float(times[0]) == pytest.approx(0.990098, abs=1e-5)
    assert float(times[999]) == pytest.approx(0.006313, abs=1e-5)
    assert (times.diff() < 0).all()
    for k, kept in enumerate(kept_shares()):
        signal, noise = math.sqrt(kept), math.sqrt(1 - kept)
        assert float(times[k]) == pytest.approx(signal / (signal + noise), abs=1e-5)


@pytest.mark.parametrize(("step", "earlier"), [(999, 959), (500, 3), (20, 0)])
def test_a_ddim_step_is_that_of_the_variance_preserving_process(step, earlier):
    """Both in float64, so that only the algebra is compared."""
    kept, times = kept_shares(), flow_times().double()
    torch.manual_seed(step)
    x_0, noise, told = torch.randn(3, 2, 5, 4, dtype=torch.float64)
    scale, scale_earlier = (math.sqrt(kept[k]) + math.sqrt(1 - kept[k]) for k in (step, earlier))
    x = math.sqrt(kept[step]) * x_0 + math.sqrt(1 - kept[step]) * noise  # eq. 5
    eps = (x - math.sqrt(kept[step]) * told) / math.sqrt(1 - kept[step])
    wanted = math.sqrt(kept[earlier]) * told + math.sqrt(1 - kept[earlier]) * eps

    t, t_earlier = times[step].expand(2), times[earlier].expand(2)
    x_t = interpolate(noise, x_0, t)
    torch.testing.assert_close(x_t * scale, x, rtol=1e-5, atol=1e-6)
    found = interpolate(noise_of(x_t, told, t), told, t_earlier)
    torch.testing.assert_close(found * scale_earlier, wanted, rtol=1e-4, atol=1e-4)


def test_steps_begin_at_pure_noise_and_keep_their_distance():
    assert trailing_steps(25).tolist() == list(range(999, 0, -40))
    assert trailing_steps(8).tolist() == [999, 874, 749, 624, 499, 374, 249, 124]
    assert trailing_steps(1).tolist() == [999] and len(trailing_steps(1000)) == 1000
    for count in (0, 1001):
        with pytest.raises(ValueError, match=f"1000 diffusion steps; {count} cannot"):
            trailing_steps(count)
