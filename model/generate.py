"""Motion for speech of any length, in windows that each start from the end of the one before."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from model.expression import predict_expressions
from model.flow import Sampler, sample
from model.kinematics import local_from_global
from model.motion import Motion
from model.packing import ROTATION_DIM, root_positions
from model.rotations import axis_angle_from_matrix, matrix_from_rot6d, rot6d_from_matrix
from model.skeleton import NUM_JOINTS
from model.speech.audio import Speech
from model.stitching import cross_fade, num_windows
from model.systems import EXPRESSION_BASIS, System

INPAINT_UNTIL = 0.7
"""Flow time up to which the seed frames are held. With 10 Euler steps, the jerk of a wrist at joins
was 1.2 times the inside's (worst frame of the join 1.6); held to the end 1.3 (2.7)."""


CHUNK_FRAMES = 512


class Cancelled(Exception):
    """Generation was stopped from outside; nothing is returned."""


@dataclass(frozen=True)
class GenerateOptions:
    """What a user may choose; equal options give every system the same noise."""

    speaker: str
    seed: int = 0
    samples: int = 1
    steps: int = 10
    sampler: Sampler = "euler"

    def __post_init__(self) -> None:
        if self.samples < 1:
            raise ValueError(f"samples is {self.samples}; at least 1 is needed.")
        if self.steps < 1:
            raise ValueError(f"steps is {self.steps}; at least 1 is needed.")
        if self.seed < 0:
            raise ValueError(f"seed is {self.seed}; it must not be negative.")


def generate_motion(
    system: System,
    speech: Speech,
    options: GenerateOptions,
    on_progress: Callable[[float], None] | None = None,
    should_cancel: Callable[[], bool] | None = None,
) -> list[Motion]:
    """One motion for each sample, exactly ``speech.num_frames`` frames at 30 fps.

    Speech shorter than a window is padded with silence inside, and the motion cut again.

    Args:
        on_progress: called with the share done, 0 to 1.
        should_cancel: asked before each window.

    Raises:
        UnknownNameError: if the weights do not know ``options.speaker``.
        Cancelled: if ``should_cancel`` said so.
    """
    config = system.config
    speaker = system.speaker_index(options.speaker)
    count = num_windows(speech.num_frames, config.window_frames, config.seed_frames)
    padded_frames = config.window_frames + (count - 1) * config.window_advance
    features = torch.from_numpy(system.encoder.encode(speech.waveform, padded_frames))
    expressions = predict_expressions(system.expression_network, features, speaker)

    stitcher = _Stitcher(options.samples, padded_frames, config.seed_frames)
    seed: Float[Tensor, "B S 333"] | None = None
    for index in range(count):
        if should_cancel is not None and should_cancel():
            raise Cancelled
        start = index * config.window_advance
        frames = slice(start, start + config.window_frames)
        window = _generate_window(
            system, features[frames], expressions[frames], speaker, seed, index, options
        )
        rotmat, root = _decode(system, window)
        stitcher.add(start, rotmat, root)
        ending = torch.cat([rot6d_from_matrix(rotmat).flatten(-2), root], dim=-1)
        seed = system.normaliser.normalise(ending[:, -config.seed_frames :])
        if on_progress is not None:
            on_progress((index + 1) / count)
    return [
        _to_motion(system, rotmat, root, expressions, speech.num_frames)
        for rotmat, root in zip(*stitcher.result(), strict=True)
    ]


@torch.inference_mode()
def _generate_window(
    system: System,
    speech: Float[Tensor, "T dim"],
    expression: Float[Tensor, "T E"],
    speaker: int,
    seed: Float[Tensor, "B S 333"] | None,
    index: int,
    options: GenerateOptions,
) -> Float[Tensor, "B T 333"]:
    """One normalised window. Early in the flow the seed frames of x_1 are held at the seed
    (in-painting); later the network may reconcile them with what follows, which halves the pop
    that holding them to the end leaves behind the seed. The join is faded afterwards."""
    config = system.config
    size = options.samples
    x_0 = torch.stack([_noise(options.seed, k, index, config.window_frames) for k in range(size)])
    known = torch.zeros(size, config.seed_frames, x_0.shape[-1]) if seed is None else seed
    has_seed: Bool[Tensor, " B"] = torch.full((size,), seed is not None)
    last: dict[str, Tensor] = {}

    def predict(x_t: Tensor, t: float) -> Tensor:
        x_1 = system.network(
            x_t,
            torch.full((size,), t),
            speech=speech.expand(size, -1, -1),
            expression=expression.expand(size, -1, -1),
            seed=known,
            speaker=torch.full((size,), speaker),
            has_seed=has_seed,
            has_speech=torch.ones(size, dtype=torch.bool),
        )
        last["x_1"] = x_1
        if seed is None or t >= INPAINT_UNTIL:
            return x_1
        return torch.cat([seed, x_1[:, config.seed_frames :]], dim=1)

    sample(predict, x_0, steps=options.steps, sampler=options.sampler)
    return last["x_1"]  # every sampler ends on its last prediction


def _noise(seed: int, sample_index: int, window: int, frames: int) -> Float[Tensor, "T 333"]:
    """The same for every system, and independent of how many samples share a batch."""
    state = np.random.SeedSequence([seed, sample_index, window]).generate_state(1, np.uint64)
    generator = torch.Generator().manual_seed(int(state[0] >> 1))
    return torch.randn(frames, ROTATION_DIM + 3, generator=generator)


def _decode(
    system: System, window: Float[Tensor, "B T 333"]
) -> tuple[Float[Tensor, "B T 55 3 3"], Float[Tensor, "B T 3"]]:
    """Rotations in the system's space, and root channels (velocity x, height, velocity z)."""
    vectors = system.normaliser.restore(window)
    rot6d = vectors[..., :ROTATION_DIM].unflatten(-1, (NUM_JOINTS, 6))
    return matrix_from_rot6d(rot6d), vectors[..., ROTATION_DIM:]


class _Stitcher:
    """Lays windows one after the other and fades the frames that two of them share."""

    def __init__(self, samples: int, num_frames: int, overlap: int) -> None:
        self.rotmat = torch.empty(samples, num_frames, NUM_JOINTS, 3, 3)
        self.root = torch.empty(samples, num_frames, 3)
        self.overlap = overlap

    def add(
        self, start: int, rotmat: Float[Tensor, "B T J 3 3"], root: Float[Tensor, "B T C"]
    ) -> None:
        if start > 0:
            shared = slice(start, start + self.overlap)
            self.rotmat[:, shared], self.root[:, shared] = cross_fade(
                (self.rotmat[:, shared], self.root[:, shared]),
                (rotmat[:, : self.overlap], root[:, : self.overlap]),
            )
            start += self.overlap
            rotmat, root = rotmat[:, self.overlap :], root[:, self.overlap :]
        self.rotmat[:, start : start + rotmat.shape[1]] = rotmat
        self.root[:, start : start + root.shape[1]] = root

    def result(self) -> tuple[Float[Tensor, "B T J 3 3"], Float[Tensor, "B T C"]]:
        return self.rotmat, self.root


def _to_motion(
    system: System,
    rotmat: Float[Tensor, "T J 3 3"],
    root: Float[Tensor, "T C"],
    expressions: Float[Tensor, "T E"],
    num_frames: int,
) -> Motion:
    rotmat, root = rotmat[:num_frames], root[:num_frames]
    is_global = system.config.rotation_space == "global"
    poses = torch.cat(
        [
            axis_angle_from_matrix(local_from_global(part) if is_global else part).flatten(-2)
            for part in rotmat.split(CHUNK_FRAMES)  # memory stays small for long clips
        ]
    )
    units = np.zeros((num_frames, 100), np.float32)
    units[:, : expressions.shape[1]] = expressions[:num_frames].numpy()
    return Motion(
        poses=poses.numpy(),
        trans=root_positions(root).numpy(),
        expressions=units,
        expression_basis=EXPRESSION_BASIS,
        betas=np.zeros(300, np.float32),
    )
