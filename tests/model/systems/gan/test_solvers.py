"""Against data of which the exact denoiser is known: Gaussian, with a mean."""

import math

import pytest
import torch

from model.systems.gan.config import SOLVERS
from model.systems.gan.sampling import (
    LAST_TIME,
    flow_time,
    signal_and_noise,
    solve,
    stepped,
    time_of,
    way,
)

MEAN, DEVIATION = 0.7, 0.3


def exact(x: torch.Tensor, now: float, before: float) -> torch.Tensor:
    """E[x_0 | x_t] of that data."""
    signal, noise = (float(v) for v in signal_and_noise(torch.tensor(now, dtype=torch.float64)))
    gain = signal * DEVIATION**2 / (signal**2 * DEVIATION**2 + noise**2)
    return MEAN + gain * (x - signal * MEAN)


def ends(solver, steps: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Where noise is carried, and where the ODE of Gaussian data carries it."""
    torch.manual_seed(0)
    x = torch.randn(4, 5, 6, dtype=torch.float64)
    signal, noise = (float(v) for v in signal_and_noise(torch.tensor(1.0, dtype=torch.float64)))
    unit = (x - signal * MEAN) / math.hypot(signal * DEVIATION, noise)
    return solve(exact, x, solver=solver, steps=steps), MEAN + DEVIATION * unit


@pytest.mark.parametrize("solver", SOLVERS)
def test_many_steps_reach_what_the_ode_says(solver):
    found, wanted = ends(solver, 800)
    assert (found - wanted).abs().max() < 0.02


@pytest.mark.parametrize(("solver", "gain"), [("ddim", 1.8), ("euler", 1.8), ("heun", 3.4)])
def test_error_falls_with_the_order_of_the_solver(solver, gain):
    errors = [(a - b).abs().mean() for a, b in (ends(solver, steps) for steps in (50, 100))]
    assert errors[0] / errors[1] > gain


def test_the_second_order_of_dpm_solver_is_nearer_than_the_first():
    first, second = (ends(s, 20) for s in ("dpm-solver++", "dpm-solver++-2m"))
    assert (second[0] - second[1]).abs().mean() < 0.5 * (first[0] - first[1]).abs().mean()


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("steps", [1, 2, 5])
def test_it_asks_once_a_step_or_twice_and_ends_at_a_prediction(solver, steps):
    asked = []

    def predict(x, now, before):
        asked.append((now, before))
        return torch.full_like(x, float(len(asked)))

    x = solve(predict, torch.randn(1, 2, 3), solver=solver, steps=steps)
    assert len(asked) == (2 * steps - 1 if solver == "heun" else steps)
    assert all(now > before for now, before in asked)
    assert asked[0][0] == 1.0 and asked[-1][1] == 0.0
    torch.testing.assert_close(x, torch.full_like(x, float(len(asked))))


def test_each_goes_its_own_way():
    at = {solver: way(solver, 4) for solver in SOLVERS}
    assert at["ddim"] == pytest.approx([1, 0.75, 0.5, 0.25, 0])
    flow = flow_time(torch.tensor(at["euler"], dtype=torch.float64))[0]
    torch.testing.assert_close(flow.diff(), torch.full((4,), float(1 - flow[0]) / 4).double())
    signal, noise = signal_and_noise(torch.tensor(at["dpm-solver++"][:-1], dtype=torch.float64))
    steps = (signal / noise).log().diff()
    torch.testing.assert_close(steps, steps.mean().expand(3))
    assert at["dpm-solver++"][-2] == pytest.approx(LAST_TIME)


def test_a_step_of_ddim_in_numbers():
    """x = .6 x_0 + .8 eps at one time, and the same eps in the same shares at another."""
    now, before = (time_of(math.log(ratio)) for ratio in (0.6 / 0.8, 0.8 / 0.6))
    x_0, noise = torch.tensor([[[2.0]]]), torch.tensor([[[-1.0]]])
    found = stepped(0.6 * x_0 + 0.8 * noise, x_0, now, before)
    torch.testing.assert_close(found, 0.8 * x_0 + 0.6 * noise)


def test_no_step_is_refused():
    with pytest.raises(ValueError, match="steps is 0"):
        solve(exact, torch.zeros(1, 1, 1), solver="ddim", steps=0)
