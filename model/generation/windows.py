"""Motion for speech of any length, in windows that each start from the end of the one before.

`generate_motion` returns it whole, and `motion_pieces` window by window.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from model.generation.base import (
    MotionConstraint,
    SpeechWindow,
    System,
    Window,
    WindowSpec,
    num_windows,
)
from model.motion.kinematics import local_from_global
from model.motion.motion import ExpressionBasis, Motion, concatenate
from model.motion.packing import root_positions
from model.motion.rotations import axis_angle_from_matrix
from model.plan.annotation_files import Interval
from model.sampling.samplers import Sampling
from model.speech.audio import Speech
from processes.job import Cancelled

_HORIZONTAL = torch.tensor([1.0, 0.0, 1.0])


@contextmanager
def single_threaded() -> Iterator[None]:
    """Limit torch to one thread inside the block, and restore the previous number after it.

    Windows are small: a second thread saves a fifth on an idle machine, and on a busy one both wait
    for each other and take three times as long. Results stay the same.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


@dataclass(frozen=True)
class GenerateOptions(Sampling):
    """Options of a generation; equal options give systems of one shape the same noise."""

    speaker: str
    seed: int = 0
    num_samples: int = 1
    first_sample: int = 0
    """Number of the first sample, so that one of many can be generated alone."""
    conditions: tuple[Any, ...] = ()
    """Conditions besides speech: one for all samples, one for each, or empty to draw them."""
    words: tuple[Interval, ...] = ()
    """Words with their times, if known: conditions may be drawn to fit them."""

    def __post_init__(self) -> None:
        if self.num_samples < 1:
            raise ValueError(f"num_samples is {self.num_samples}; at least 1 is needed.")
        super().__post_init__()
        if self.seed < 0:
            raise ValueError(f"seed is {self.seed}; it must not be negative.")
        if len(self.conditions) not in (0, 1, self.num_samples):
            raise ValueError(
                f"There are {len(self.conditions)} conditions for {self.num_samples} samples; "
                "give one for all, or one for each."
            )


def generate_motion(
    system: System,
    speech: Speech,
    options: GenerateOptions,
    should_cancel: Callable[[], bool] | None = None,
) -> list[Motion]:
    """Generate one motion for each sample, exactly ``speech.num_motion_frames`` frames at 30 fps.

    Speech shorter than a window is padded with silence, and the motion cut again. Torch uses one
    thread meanwhile (`single_threaded`).

    Args:
        should_cancel: called before each window.

    Raises:
        UnknownNameError: if the weights lack ``options.speaker``, or the system the sampler.
        ValueError: if the system does not support the guidance scale.
        Cancelled: if ``should_cancel`` returns true.
    """
    motions: dict[int, list[Motion]] = {}
    with single_threaded():
        for piece in motion_pieces(system, speech, options, should_cancel):
            for sample, motion in enumerate(piece.motions, start=piece.first_index):
                motions.setdefault(sample, []).append(motion)
    return [concatenate(motions[sample]) for sample in range(options.num_samples)]


def measure_ms_per_frame(system: System, speech: Speech, steps: int, num_samples: int = 1) -> float:
    """Measure the milliseconds per frame of each sample.

    Generate once before, so that the speech features are cached and do not count.
    """
    options = GenerateOptions(next(iter(system.speakers)), steps=steps, num_samples=num_samples)
    started = time.perf_counter()
    generate_motion(system, speech, options)
    return 1e3 * (time.perf_counter() - started) / (speech.num_motion_frames * num_samples)


@dataclass(frozen=True)
class MotionPiece:
    """Frames that continue those of the piece before."""

    motions: list[Motion]
    """One motion for each sample from `first_index` on."""
    first_index: int
    """Index of the first sample, from 0 among the requested ones."""
    progress: float
    """Share of the system's work that is done with this piece, 0 to 1."""


def motion_pieces(
    system: System,
    speech: Speech,
    options: GenerateOptions,
    should_cancel: Callable[[], bool] | None = None,
) -> Iterator[MotionPiece]:
    """Yield the result of `generate_motion` window by window.

    All pieces of a sample, concatenated, are its motion to the bit. The caller sets the number of
    threads of torch, so that several systems can generate their pieces in turn. Raises as
    `generate_motion`.
    """
    if system.condition_type is None:
        yield from _generate_pieces(system, speech, options, should_cancel)
        return
    conditions = options.conditions or tuple(_drawn(system, speech, options))
    for sample in range(options.num_samples):
        one = conditions[min(sample, len(conditions) - 1)]
        first = options.first_sample + sample
        own = replace(options, num_samples=1, first_sample=first, conditions=(one,))
        for piece in _generate_pieces(system, speech, own, should_cancel):
            progress = (sample + piece.progress) / options.num_samples
            yield replace(piece, first_index=sample, progress=progress)


def draw_conditions(system: System, speech: Speech, options: GenerateOptions) -> tuple[Any, ...]:
    """Draw the conditions that a system uses by default, one for each sample."""
    with single_threaded():
        return tuple(_drawn(system, speech, options))


def _drawn(system: System, speech: Speech, options: GenerateOptions) -> Iterator[Any]:
    spec = first_window_spec(system, options)
    for sample in range(options.num_samples):
        one = replace(spec, first_sample=spec.first_sample + sample)
        yield system.draw_condition(speech.waveform, speech.num_motion_frames, one)


def _generate_pieces(
    system: System,
    speech: Speech,
    options: GenerateOptions,
    should_cancel: Callable[[], bool] | None,
) -> Iterator[MotionPiece]:
    cut = system.windowing
    count = num_windows(speech.num_motion_frames, cut.frames, cut.overlap)
    num_frames = cut.frames + (count - 1) * cut.advance
    features = system.conditioning(speech.waveform, num_frames, first_window_spec(system, options))
    constraint = system.make_constraint(options.conditions[0]) if options.conditions else None
    assembler = MotionAssembler(system, constraint=constraint)
    chain = WindowChain(system, options)
    left = speech.num_motion_frames
    for index in range(count):
        if should_cancel is not None and should_cancel():
            raise Cancelled
        speech_window = SpeechWindow.of(features, index * cut.advance, cut.frames, cut.context)
        length = min(left, cut.frames if index == count - 1 else cut.advance)
        left -= length
        motions = assembler.next_motions(chain.generate_joined(speech_window).part(slice(length)))
        yield MotionPiece(motions, 0, (index + 1) / count)


class WindowChain:
    """Sequence of windows that each start from the end of the one before."""

    def __init__(self, system: System, options: GenerateOptions) -> None:
        self._system = system
        self._draw = first_window_spec(system, options)
        self._made: Window | None = None
        self._end: Window | None = None

    def generate_joined(
        self,
        speech: SpeechWindow,
        advance: int | None = None,
        condition: Any = None,
        first_condition_frame: int | None = None,
    ) -> Window:
        """Generate the next window; return it whole, its first frames blended with the last one's.

        Args:
            advance: number of its frames after which the next window starts, from ``overlap`` on;
                only those are final. None is the system's own advance.
            condition, first_condition_frame: of this window, if these are drawn as speech arrives.
        """
        if condition is not None:
            self._draw = replace(
                self._draw, condition=condition, first_condition_frame=first_condition_frame
            )
        return self.join(self.generate(speech), advance)

    def generate(self, speech: SpeechWindow) -> Window:
        """Generate the window after the last joined one; only `join` moves the chain on."""
        return self._system.window(speech, self._made, self._draw)

    def join(self, window: Window, advance: int | None = None) -> Window:
        """Blend a window, generated here or earlier, with the one before, and return it whole."""
        cut = self._system.windowing
        advance = cut.advance if advance is None else advance
        assert cut.overlap <= advance <= cut.advance
        joined = window if self._end is None else self._system.join(self._end, window)
        self._made = window.part(slice(advance + cut.overlap))
        self._end = joined.part(slice(advance, advance + cut.overlap))
        self._draw = replace(self._draw, index=self._draw.index + 1)
        return joined


class MotionAssembler:
    """Converter of windows to motion, piece after piece, in one world frame.

    Args:
        origin: root position that moves to x = z = 0, for systems with absolute positions; None
            for that of the first frame.
        constraint: applies its condition to one sample's motion.
    """

    def __init__(
        self,
        system: System,
        origin: Float[Tensor, "B 1 3"] | None = None,
        constraint: MotionConstraint | None = None,
    ) -> None:
        self._system = system
        self._constraint = constraint
        self._travelled = None if origin is None else origin * _HORIZONTAL

    def next_motions(self, piece: Window) -> list[Motion]:
        """Return the motion of the frames after those of the piece before, one for each sample."""
        root, travelled = piece.root, self._travelled
        if self._system.root_format == "place":
            travelled = root[:, :1] * _HORIZONTAL if travelled is None else travelled
            positions = root - travelled
        elif travelled is None:
            positions = root_positions(root)
        else:  # continue from the frame before
            leading = torch.cat([torch.zeros_like(root[:, :1]), root], dim=1)
            positions = root_positions(leading)[:, 1:] + travelled
        if self._system.root_format == "velocity":
            travelled = positions[:, -1:] * _HORIZONTAL
        self._travelled = travelled
        is_global = self._system.rotation_frame == "global"
        local = local_from_global(piece.rotmat) if is_global else piece.rotmat
        poses = axis_angle_from_matrix(local).flatten(-2)
        motions = [
            _motion(*one, self._system.expression_basis)
            for one in zip(poses, positions, piece.expression, strict=True)
        ]
        return motions if self._constraint is None else [self._constraint.constrain_next(*motions)]


def first_window_spec(system: System, options: GenerateOptions) -> WindowSpec:
    """Return the inputs of the first window; raises as `generate_motion`."""
    if options.conditions and system.condition_type is None:
        raise ValueError(f"{system.name} takes no condition besides speech; omit the condition.")
    return WindowSpec(
        speaker_index=system.speaker_index(options.speaker),
        seed=options.seed,
        num_samples=options.num_samples,
        index=0,
        **vars(system.resolve_sampling(options)),
        first_sample=options.first_sample,
        condition=options.conditions[0] if options.conditions else None,
        words=options.words,
    )


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
