"""Motion for speech of any length, in windows that each start from the end of the one before.

`generate_motion` has the whole speech; `stream_motion` makes the same motion while it arrives.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from model.generation.base import Draw, System, Window
from model.generation.one_thread import one_thread
from model.generation.speech_stream import SpeechStream, SpeechWindow
from model.generation.stitching import num_windows
from model.motion.kinematics import local_from_global
from model.motion.motion import ExpressionBasis, Motion
from model.motion.packing import root_positions
from model.motion.rotations import axis_angle_from_matrix
from model.plan.kinds import Spoken
from model.plan.plan import GesturePlan
from model.speech.audio import Speech

_HORIZONTAL = torch.tensor([1.0, 0.0, 1.0])


class Cancelled(Exception):
    """Generation was stopped from outside; nothing is returned."""


@dataclass(frozen=True)
class GenerateOptions:
    """What a user may choose; equal options give systems of one shape the same noise."""

    speaker: str
    seed: int = 0
    samples: int = 1
    steps: int | None = None
    """None is what the system's sampler usually takes."""
    face_steps: int | None = None
    """Of systems that draw the face by steps of its own; None is the sampler's usual share."""
    sampler: str | None = None
    """One of the system's own; None is its first."""
    guidance: float | None = None
    """Strength of the speech (`model.sampling.guidance`): 1 is the network as trained, 0 is deaf;
    None is the system's usual one. Any other than 1 asks the network for a batch of two."""
    first_sample: int = 0
    """Number of the first sample, so that one of many can be made alone."""
    plans: tuple[GesturePlan, ...] = ()
    """What a system that plans is to perform: one for all samples, or one for each; none lets it
    draw them."""
    words: tuple[Spoken, ...] = ()
    """What is said, for a system that plans: words call gestures that fit them."""

    def __post_init__(self) -> None:
        if self.samples < 1:
            raise ValueError(f"samples is {self.samples}; at least 1 is needed.")
        for name in ("steps", "face_steps"):
            count = getattr(self, name)
            if count is not None and count < 1:
                raise ValueError(f"{name} is {count}; at least 1 is needed.")
        if self.guidance is not None and not 0 <= self.guidance <= 10:
            raise ValueError(f"guidance is {self.guidance}; it must lie between 0 and 10.")
        if self.seed < 0:
            raise ValueError(f"seed is {self.seed}; it must not be negative.")
        if len(self.plans) not in (0, 1, self.samples):
            raise ValueError(f"There are {len(self.plans)} plans for {self.samples} samples.")


def generate_motion(
    system: System,
    speech: Speech,
    options: GenerateOptions,
    on_progress: Callable[[float], None] | None = None,
    should_cancel: Callable[[], bool] | None = None,
) -> list[Motion]:
    """One motion for each sample, exactly ``speech.num_frames`` frames at 30 fps.

    Speech shorter than a window is padded with silence inside, and the motion cut again. Torch
    works in one thread meanwhile (`one_thread`).

    Args:
        on_progress: called with the share done, 0 to 1.
        should_cancel: asked before each window.

    Raises:
        UnknownNameError: if the weights do not know ``options.speaker``, or the system the sampler.
        ValueError: if guidance, or steps of the face, are asked of a system that takes none.
        Cancelled: if ``should_cancel`` said so.
    """
    with one_thread():
        if not system.plans:
            return _generated(system, speech, options, on_progress, should_cancel)
        motions: list[Motion] = []
        plans = options.plans or tuple(_drawn_plans(system, speech, options))
        for sample in range(options.samples):
            plan = plans[min(sample, len(plans) - 1)]
            first = options.first_sample + sample
            one = replace(options, samples=1, first_sample=first, plans=(plan,))

            def on_share(share: float, done: int = sample) -> None:
                if on_progress is not None:
                    on_progress((done + share) / options.samples)

            motions += _generated(system, speech, one, on_share, should_cancel)
        return motions


def draw_plans(system: System, speech: Speech, options: GenerateOptions) -> tuple[GesturePlan, ...]:
    """The plans that a system performs, one for each sample, if it is given none.

    Raises:
        UnknownNameError: if the weights do not know ``options.speaker``.
        ValueError: if the system performs no plans.
    """
    with one_thread():
        return tuple(_drawn_plans(system, speech, options))


def _drawn_plans(system: System, speech: Speech, options: GenerateOptions) -> Iterator[GesturePlan]:
    draw = draw_of(system, options)
    for sample in range(options.samples):
        one = replace(draw, first_sample=draw.first_sample + sample)
        yield system.plan(speech.waveform, speech.num_frames, one)


def _generated(
    system: System,
    speech: Speech,
    options: GenerateOptions,
    on_progress: Callable[[float], None] | None,
    should_cancel: Callable[[], bool] | None,
) -> list[Motion]:
    cut = system.windowing
    count = num_windows(speech.num_frames, cut.frames, cut.overlap)
    num_frames = cut.frames + (count - 1) * cut.advance
    features = system.hear(speech.waveform, num_frames, draw_of(system, options))
    pieces: list[tuple[Tensor, Tensor, Tensor]] = []
    for index, piece in enumerate(_pieces(system, [features], options, should_cancel)):
        pieces.append((_poses(system, piece), piece.root, piece.expression))
        if on_progress is not None:
            on_progress(min(1.0, (index + 1) / count))
    poses, root, expressions = (
        torch.cat(parts, dim=1)[:, : speech.num_frames] for parts in zip(*pieces, strict=True)
    )
    positions = root_positions(root, system.root_motion)
    positions = positions - positions[:, :1] * _HORIZONTAL
    return _motions(system, poses, positions, expressions)


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
        UnknownNameError: if the weights do not know ``options.speaker``, or the system the sampler.
        ValueError: if there is no speech, guidance or steps of the face are asked of a system that
            takes none, or the system plans.
    """
    if system.plans:
        raise ValueError(f"{system.name} plans all of the speech first; it cannot begin before.")
    told = PiecewiseMotion(system)
    for piece in _pieces(system, features, options):
        yield told.go_on(piece)


def _pieces(
    system: System,
    features: Iterable[Float[Tensor, "_ dim"]],
    options: GenerateOptions,
    should_cancel: Callable[[], bool] | None = None,
) -> Iterator[Window]:
    """Frames that no later window changes."""
    cut = system.windowing
    chain = WindowChain(system, options)
    speech = SpeechStream(features, cut.context)
    index, is_last = 0, False
    while not is_last:
        if should_cancel is not None and should_cancel():
            raise Cancelled
        heard = speech.window(index * cut.advance, cut.frames)
        is_last = heard.is_last
        joined = chain.window(heard)
        yield joined.part(slice(heard.num_frames if is_last else cut.advance))
        index += 1


class WindowChain:
    """Windows that each start from the end of the one before."""

    def __init__(self, system: System, options: GenerateOptions) -> None:
        """
        Raises:
            UnknownNameError, ValueError: as `stream_motion`.
        """
        self._system = system
        self._draw = draw_of(system, options)
        self._made: Window | None = None
        self._end: Window | None = None

    def window(self, heard: SpeechWindow, advance: int | None = None) -> Window:
        """The next window, joined to the one before.

        Args:
            heard: its speech.
            advance: after how many of its frames the next window starts, from ``overlap`` on; only
                those are final. None is the system's own advance.
        """
        cut = self._system.windowing
        advance = cut.advance if advance is None else advance
        assert cut.overlap <= advance <= cut.advance
        made = self._system.window(heard, self._made, self._draw)
        joined = made if self._end is None else self._system.join(self._end, made)
        self._made = made.part(slice(advance + cut.overlap))
        self._end = joined.part(slice(advance, advance + cut.overlap))
        self._draw = replace(self._draw, index=self._draw.index + 1)
        return joined


class PiecewiseMotion:
    """Turns what windows make into motion, piece after piece, in one place of the world."""

    def __init__(self, system: System) -> None:
        self._system = system
        self._travelled: Float[Tensor, "B 1 3"] | None = None

    def go_on(self, piece: Window) -> list[Motion]:
        """The motion of the frames after those of the piece before, one for each sample."""
        root, travelled = piece.root, self._travelled
        if self._system.root_motion == "place":
            travelled = root[:, :1] * _HORIZONTAL if travelled is None else travelled
            positions = root - travelled
        elif travelled is None:
            positions = root_positions(root)
        else:  # the frame before leads on to this piece
            leading = torch.cat([torch.zeros_like(root[:, :1]), root], dim=1)
            positions = root_positions(leading)[:, 1:] + travelled
        if self._system.root_motion == "velocity":
            travelled = positions[:, -1:] * _HORIZONTAL
        self._travelled = travelled
        return _motions(self._system, _poses(self._system, piece), positions, piece.expression)


def draw_of(system: System, options: GenerateOptions) -> Draw:
    """What decides the first window.

    Raises:
        UnknownNameError, ValueError: see `stream_motion`.
    """
    sampler = system.sampler(options.sampler)
    if options.plans and not system.plans:
        raise ValueError(f"{system.name} performs no plans; leave the plan out.")
    if options.face_steps is not None and sampler.face_steps is None:
        raise ValueError(f"{system.name} takes no steps for the face alone; leave them out.")
    steps, face_steps = sampler.counts(options.steps, options.face_steps)
    return Draw(
        speaker=system.speaker_index(options.speaker),
        seed=options.seed,
        samples=options.samples,
        index=0,
        sampler=sampler.name,
        steps=steps,
        face_steps=face_steps,
        guidance=system.strength(options.guidance),
        first_sample=options.first_sample,
        plan=options.plans[0] if options.plans else None,
        words=options.words,
    )


def _poses(system: System, piece: Window) -> Float[Tensor, "B n 165"]:
    is_global = system.frame == "world"
    local = local_from_global(piece.rotmat) if is_global else piece.rotmat
    return axis_angle_from_matrix(local).flatten(-2)


def _motions(
    system: System,
    poses: Float[Tensor, "B n 165"],
    positions: Float[Tensor, "B n 3"],
    expressions: Float[Tensor, "B n E"],
) -> list[Motion]:
    return [
        _motion(*one, system.expression_basis)
        for one in zip(poses, positions, expressions, strict=True)
    ]


def _motion(
    poses: Float[Tensor, "T 165"],
    trans: Float[Tensor, "T 3"],
    expressions: Float[Tensor, "T E"],
    basis: ExpressionBasis,
) -> Motion:
    units = np.zeros((len(poses), 100), np.float32)
    units[:, : expressions.shape[1]] = expressions.numpy()
    return Motion(
        poses=poses.numpy(),
        trans=trans.numpy(),
        expressions=units,
        expression_basis=basis,
        betas=np.zeros(300, np.float32),
    )
