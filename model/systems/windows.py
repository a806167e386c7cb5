"""Motion for speech of any length, in windows that each start from the end of the one before.

`generate_motion` has the whole speech; `stream_motion` makes the same motion while it arrives.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from model.motion.decoding import rotations
from model.motion.kinematics import local_from_global
from model.motion.motion import Motion
from model.motion.packing import ROOT_DIM, pack, root_positions
from model.motion.rotations import axis_angle_from_matrix, rot6d_from_matrix
from model.networks.expression import SpeechStream
from model.sampling.flow import Sampler, sample, seeded_noise
from model.speech.audio import Speech
from model.systems.base import EXPRESSION_BASIS, System
from model.systems.stitching import cross_fade, fade, num_windows

INPAINT_UNTIL = 0.7
"""Flow time up to which the seed frames are held. With 10 Euler steps, the jerk of a wrist at joins
was 1.2 times the inside's (worst frame of the join 1.6); held to the end 1.3 (2.7)."""


_HORIZONTAL = torch.tensor([1.0, 0.0, 1.0])


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
    guidance: float = 1.0
    """Strength of the speech: x_1 without speech plus this times what speech changes in it
    (classifier-free guidance). 1 is the network as trained, 0 is deaf; any other value than 1 asks
    the network twice at each evaluation."""

    def __post_init__(self) -> None:
        if self.samples < 1:
            raise ValueError(f"samples is {self.samples}; at least 1 is needed.")
        if self.steps < 1:
            raise ValueError(f"steps is {self.steps}; at least 1 is needed.")
        if not 0 <= self.guidance <= 10:
            raise ValueError(f"guidance is {self.guidance}; it must lie between 0 and 10.")
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
    count = num_windows(speech.num_frames, config.window_frames, config.seed_frames)
    padded_frames = config.window_frames + (count - 1) * config.window_advance
    features = torch.from_numpy(system.encoder.encode(speech.waveform, padded_frames))
    pieces: list[_Piece] = []
    windows = _pieces(system, [features], options, should_cancel)
    for index, piece in enumerate(windows):
        pieces.append(piece)
        if on_progress is not None:
            on_progress(min(1.0, (index + 1) / count))
    poses = torch.cat([piece.poses for piece in pieces], dim=1)[:, : speech.num_frames]
    root = torch.cat([piece.root for piece in pieces], dim=1)[:, : speech.num_frames]
    positions = root_positions(root, config.root)
    positions = positions - positions[:, :1] * _HORIZONTAL
    units = torch.cat([piece.expressions for piece in pieces])[: speech.num_frames]
    return [_to_motion(one, place, units) for one, place in zip(poses, positions, strict=True)]


def stream_motion(
    system: System, features: Iterable[Float[Tensor, "_ dim"]], options: GenerateOptions
) -> Iterator[list[Motion]]:
    """The motion that goes on with each window, one for each sample, while speech arrives.

    A window is made when its speech and the context that the networks hear after it are there;
    all pieces together equal `generate_motion`'s result for the same features and options. Memory
    does not grow with the length.

    Args:
        features: the next frames of ``system.encoder``'s features, in blocks of any length. If
            they end inside a window, the last frame is held to its end, and the motion cut again.
            Levels in ``mel64`` are relative to a whole clip's: live speech needs an estimate.

    Raises:
        UnknownNameError: if the weights do not know ``options.speaker``.
        ValueError: if there is no speech.
    """
    kind = system.config.root
    travelled: Float[Tensor, "B 1 3"] | None = None
    for piece in _pieces(system, features, options):
        root = piece.root
        if kind == "place":
            travelled = root[:, :1] * _HORIZONTAL if travelled is None else travelled
            positions = root - travelled
        elif travelled is None:
            positions = root_positions(root)
        else:  # the frame before leads on to this piece
            leading = torch.cat([torch.zeros_like(root[:, :1]), root], dim=1)
            positions = root_positions(leading)[:, 1:] + travelled
        if kind == "velocity":
            travelled = positions[:, -1:] * _HORIZONTAL
        yield [
            _to_motion(one, place, piece.expressions)
            for one, place in zip(piece.poses, positions, strict=True)
        ]


@dataclass(frozen=True)
class _Piece:
    """Frames that no later window changes."""

    poses: Float[Tensor, "B n 165"]
    root: Float[Tensor, "B n 3"]
    """Root channels, as the system's config has them."""
    expressions: Float[Tensor, "n E"]


def _pieces(
    system: System,
    features: Iterable[Float[Tensor, "_ dim"]],
    options: GenerateOptions,
    should_cancel: Callable[[], bool] | None = None,
) -> Iterator[_Piece]:
    config = system.config
    speaker = system.speaker_index(options.speaker)
    overlap = config.seed_frames
    face = system.face
    if (config.window_frames, overlap) != (face.config.window_frames, face.config.seed_frames):
        raise ValueError(f"The windows of {system.name} and of the expression network differ.")
    speech = SpeechStream(features, max(config.speech_context, face.config.speech_context))
    seed: Float[Tensor, "B S C"] | None = None
    face_seed: Float[Tensor, "1 S E"] | None = None
    shared: tuple[Tensor, Tensor] | None = None
    shared_units: Float[Tensor, "S E"] | None = None
    index, is_last = 0, False
    while not is_last:
        if should_cancel is not None and should_cancel():
            raise Cancelled
        window = speech.window(index * config.window_advance, config.window_frames)
        is_last = window.is_last
        heard = window.around(face.config.speech_context, config.window_frames)[None]
        drawn, face_seed = face.draw(heard, speaker, face_seed, face.noise(options.seed, index))
        units = drawn[0]
        if shared_units is not None:
            units = torch.cat([fade(shared_units, units[:overlap]), units[overlap:]])
        shared_units = units[-overlap:]
        heard = window.around(config.speech_context, config.window_frames)
        x_1 = _generate_window(system, heard, units, speaker, seed, index, options)
        vectors = system.normaliser.restore(x_1)
        rotmat, root = rotations(vectors, config.rotation_space), vectors[..., -ROOT_DIM:]
        if config.rotation_space != "axis-angle":  # rows of any length become those of a rotation
            vectors = pack(rot6d_from_matrix(rotmat), root, "place")
        seed = system.normaliser.normalise(vectors[:, -overlap:])
        if shared is not None:
            faded = cross_fade(shared, (rotmat[:, :overlap], root[:, :overlap]))
            rotmat = torch.cat([faded[0], rotmat[:, overlap:]], dim=1)
            root = torch.cat([faded[1], root[:, overlap:]], dim=1)
        done = window.num_frames if is_last else config.window_advance
        shared = rotmat[:, -overlap:], root[:, -overlap:]
        yield _Piece(_poses(system, rotmat[:, :done]), root[:, :done], units[:done])
        index += 1


def _poses(system: System, rotmat: Float[Tensor, "B n J 3 3"]) -> Float[Tensor, "B n 165"]:
    local = local_from_global(rotmat) if system.config.rotation_space == "global" else rotmat
    return axis_angle_from_matrix(local).flatten(-2)


@torch.inference_mode()
def _generate_window(
    system: System,
    speech: Float[Tensor, "heard dim"],
    expression: Float[Tensor, "T E"],
    speaker: int,
    seed: Float[Tensor, "B S C"] | None,
    index: int,
    options: GenerateOptions,
) -> Float[Tensor, "B T C"]:
    """One normalised window. Early in the flow the seed frames of x_1 are held at the seed
    (in-painting); later the network may reconcile them with what follows, which halves the pop
    that holding them to the end leaves behind the seed. A system that stands on a prior knows its
    seed and needs no holding. The join is faded afterwards."""
    config, prior = system.config, system.network.prior
    size = options.samples
    # The same for every system of this shape, and for however many samples share a batch.
    shape = config.window_frames, config.motion_dim
    x_0 = torch.stack([seeded_noise([options.seed, k, index], shape) for k in range(size)])
    known = torch.zeros(size, config.seed_frames, x_0.shape[-1]) if seed is None else seed
    last: dict[str, Tensor] = {}
    guided = options.guidance != 1
    copies = 2 * size if guided else size
    conditions = {
        "speech": speech.expand(copies, -1, -1),
        "expression": expression.expand(copies, -1, -1),
        "seed": torch.cat([known, known]) if guided else known,
        "speaker": torch.full((copies,), speaker),
        "has_seed": torch.full((copies,), seed is not None),
        "has_speech": torch.arange(copies) < size,
    }

    def predict(x_t: Tensor, t: float) -> Tensor:
        twice = torch.cat([x_t, x_t]) if guided else x_t
        x_1 = system.network(twice, torch.full((copies,), t), **conditions)
        if guided:
            heard, deaf = x_1.chunk(2)
            x_1 = deaf + options.guidance * (heard - deaf)
        last["x_1"] = x_1
        if seed is None or prior is not None or t >= INPAINT_UNTIL:
            return x_1
        return torch.cat([seed, x_1[:, config.seed_frames :]], dim=1)

    if prior is not None and options.sampler != "reinterpolate":
        heun = options.sampler == "heun"
        return prior.sample(predict, x_0, seed, steps=options.steps, heun=heun)
    sample(predict, x_0, steps=options.steps, sampler=options.sampler)
    return last["x_1"]  # every sampler ends on its last prediction


def _to_motion(
    poses: Float[Tensor, "T 165"], trans: Float[Tensor, "T 3"], expressions: Float[Tensor, "T E"]
) -> Motion:
    units = np.zeros((len(poses), 100), np.float32)
    units[:, : expressions.shape[1]] = expressions.numpy()
    return Motion(
        poses=poses.numpy(),
        trans=trans.numpy(),
        expressions=units,
        expression_basis=EXPRESSION_BASIS,
        betas=np.zeros(300, np.float32),
    )
