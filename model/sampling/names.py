"""Names of samplers, known without torch."""

from typing import Literal, get_args

FlowSampler = Literal["euler", "heun", "reinterpolate"]
FLOW_SAMPLERS: tuple[FlowSampler, ...] = get_args(FlowSampler)
"""As `model.sampling.flow.sample` defines them."""
SAMPLER_TITLES = {
    "euler": "Euler (first order)",
    "heun": "Heun (second order)",
    "reinterpolate": "Official re-interpolation",
    "ddim": "DDIM",
}
"""What a person calls those that several families have."""
