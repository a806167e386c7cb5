"""Interface of all systems: generators of windows that are joined to motion.

The input of a system is speech, speaker and seed. Further input is a condition of a type that its
family defines and that is opaque here: drawn from the speech per sample, or passed by the caller.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Literal, Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Float, Shaped
from torch import Tensor

from model.motion.motion import ExpressionBasis, Motion
from model.motion.packing import Normaliser
from model.motion.rotations import interpolate_rotations
from model.motion.spaces import RootFormat, RotationSpace
from model.plan.annotation_files import Interval
from model.sampling.flow import ClassifierFreeGuidance, seeded_noise
from model.sampling.samplers import SamplerChoice, Sampling, UnknownNameError
from model.speech.encoder import SpeechEncoder
from model.storage.cards import WeightsCard


def num_windows(num_frames: int, window: int, overlap: int) -> int:
    """Return the number of windows for ``num_frames``, at steps of ``window - overlap``."""
    return 1 + max(0, -(-(num_frames - window) // (window - overlap)))


def fade_weights(overlap: int) -> Float[Tensor, " overlap"]:
    """Return the newer window's share of each shared frame: a minimum-jerk ramp inside (0, 1).

    ``10 s^3 - 15 s^4 + 6 s^5`` starts and ends with zero slope and curvature, so a seam adds
    neither a step in velocity nor one in acceleration.
    """
    s = torch.arange(1, overlap + 1) / (overlap + 1)
    return s**3 * (10 - 15 * s + 6 * s**2)


def crossfade(
    older: Float[Tensor, "*batch S C"], newer: Float[Tensor, "*batch S C"]
) -> Float[Tensor, "*batch S C"]:
    """Blend the shared frames of two windows in channels that may be mixed linearly."""
    return torch.lerp(older, newer, fade_weights(older.shape[-2]).to(older)[:, None])


@dataclass(frozen=True)
class SpeechWindow:
    """Speech features of a window and its context; past either end the nearest one is repeated."""

    features: Float[Tensor, "T_ctx speech_dim"]
    """Features of the window's T frames and of c frames before and after it: T_ctx = T + 2 c."""

    @staticmethod
    def of(
        features: Float[Tensor, "T speech_dim"], first: int, frames: int, context: int
    ) -> "SpeechWindow":
        """Cut the features of a window, from frame ``first`` on, with their context."""
        wanted = torch.arange(first - context, first + frames + context)
        return SpeechWindow(features[wanted.clamp(0, len(features) - 1)])

    def trim_context(self, context: int, window_frames: int) -> Float[Tensor, "T_ctx speech_dim"]:
        """Return the middle ``window_frames`` frames with ``context`` frames before and after."""
        spare = (len(self.features) - window_frames) // 2 - context
        return self.features[spare : len(self.features) - spare]


@dataclass(frozen=True)
class Windowing:
    """Lengths, in frames, by which a system cuts time into windows."""

    frames: int
    overlap: int
    """Number of frames that a window shares with the one before."""
    context: int = field(default=0, compare=False)
    """Frames of speech that must be known before and after a window."""

    def __post_init__(self) -> None:
        if self.advance < 2 or not 0 <= self.overlap <= self.advance:
            raise ValueError(
                "The hop between windows must be at least 2 frames and no shorter than the "
                f"overlap; got a hop of {self.advance} and an overlap of {self.overlap} frames."
            )

    @property
    def advance(self) -> int:
        """Number of frames from the start of one window to the start of the next."""
        return self.frames - self.overlap


@dataclass(frozen=True)
class WindowSpec:
    """Inputs of a window besides its speech and the window before it."""

    speaker_index: int
    seed: int
    num_samples: int
    """Number of motions sampled at once from the same speech."""
    index: int
    """Index of the window."""
    sampler: str
    steps: int
    guidance: float
    first_sample: int = 0
    condition: Any = None
    """Condition of the window; see `System.draw_condition`."""
    first_condition_frame: int | None = None
    """Index of the window's first frame in ``condition``; None for ``index`` times the advance."""
    words: tuple[Interval, ...] = ()
    """Words of the speech with their times, if known."""

    @property
    def clip_noise_key(self) -> tuple[int, int]:
        """Key of random numbers for the first sample that are independent of windows."""
        return self.seed, self.first_sample

    def make_guidance(self, normaliser: Normaliser, space: RotationSpace) -> ClassifierFreeGuidance:
        """Return the classifier-free guidance for a network of such motion."""
        return ClassifierFreeGuidance(self.guidance, normaliser, space)

    def noise(self, shape: tuple[int, ...], *step: int) -> Float[Tensor, "samples ..."]:
        """Draw standard normal noise that depends on seed, sample, window, step and shape alone."""
        samples = range(self.first_sample, self.first_sample + self.num_samples)
        keys = [[self.seed, sample, self.index, *step] for sample in samples]
        return torch.stack([seeded_noise(key, shape) for key in keys])


@dataclass(frozen=True)
class Window:
    """Motion of one window before blending; a family may add tensors (B, n, ...) for the next."""

    rotmat: Float[Tensor, "B n 55 3 3"]
    """Joint rotations, local or global by the system's `rotation_frame`."""
    root: Float[Tensor, "B n 3"]
    """Root motion in the format of the system's `root_format`."""
    expression: Float[Tensor, "B n E"]
    """Coefficients of the system's `expression_basis`: ARKit weights, 0 to 1, or FLAME's."""

    def part(self, frames: slice) -> "Window":
        """Return some frames of the window."""
        return replace(self, **self.sliced_tensors(frames))

    def sliced_tensors(self, frames: slice) -> dict[str, Tensor]:
        """Return some frames of each tensor, by name."""
        return {name: tensor[:, frames] for name, tensor in vars(self).items()}


class StreamedCondition(Protocol):
    """Condition around some frames of live speech."""

    @property
    def condition(self) -> Any: ...

    @property
    def zero_frame(self) -> int:
        """Frame of the motion at which the condition's time is 0."""
        ...


@runtime_checkable
class ConditionStream(Protocol):
    """Generator of a condition for speech that is still arriving."""

    style: Any
    """Style of the condition from now on, of the family's type."""

    def advance(
        self,
        features_of: Callable[[int, int], Float[Tensor, "T dim"]],
        first: int,
        first_open: int,
        stop: int,
    ) -> StreamedCondition:
        """Return the condition of frames ``first`` to ``stop``, in the family's type.

        Args:
            features_of: returns speech features from a first frame to a last (exclusive); those of
                future frames are extrapolated.
            first_open: first frame whose events may still change; those before it are final.
        """
        ...

    def conditioning(
        self, features: Float[Tensor, "n dim"], streamed: Any, first: int
    ) -> Float[Tensor, "n input_dim"]:
        """Return the windows' input for frames from ``first`` on: features and condition."""
        ...


@runtime_checkable
class MotionConstraint(Protocol):
    """Adapter of motion that arrives in pieces to its condition, as a foot or hand constraint."""

    margin: int
    """Number of frames of the condition that are needed on either side of a piece."""

    def constrain_next(self, motion: Motion) -> Motion:
        """Apply the condition to the frames after those of the last call."""
        ...

    def set_condition(self, streamed: Any, next_frame_in_condition: int) -> None:
        """Continue with another condition, in which the next frame has this index."""
        ...

    def state(self) -> dict[str, Tensor]:
        """Return the decisions so far, for a constraint with another condition."""
        ...


@dataclass(frozen=True, kw_only=True)
class System(ABC):
    """Trained generator with its name, model card, speakers and samplers.

    Example:
        A system that stands still in the rest pose; `model.generation.windows` joins its windows.

        >>> from model.speech.features import MelEncoder
        >>> class StillSystem(System):
        ...     def window(self, speech, before, spec):
        ...         shape = (spec.num_samples, self.windowing.frames)
        ...         return Window(
        ...             rotmat=torch.eye(3).expand(*shape, 55, 3, 3),
        ...             root=torch.zeros(*shape, 3),
        ...             expression=torch.zeros(*shape, 52),
        ...         )
        >>> system = StillSystem(
        ...     name="still",
        ...     card=WeightsCard({}, "still"),
        ...     sha256s={},
        ...     speakers={"ada": 0},
        ...     encoder=MelEncoder(),
        ...     windowing=Windowing(frames=64, overlap=8),
        ...     samplers=(SamplerChoice("euler", 8, default_guidance=1.5),),
        ...     rotation_frame="local",
        ...     root_format="velocity",
        ... )
        >>> system.resolve_sampling(Sampling(steps=4))
        Sampling(sampler='euler', steps=4, guidance=1.5)
        >>> speech = SpeechWindow(torch.zeros(64, system.encoder.dim))
        >>> spec = WindowSpec(
        ...     speaker_index=0,
        ...     seed=0,
        ...     num_samples=2,
        ...     index=0,
        ...     sampler="euler",
        ...     steps=4,
        ...     guidance=1.5,
        ... )
        >>> system.window(speech, None, spec).rotmat.shape
        torch.Size([2, 64, 55, 3, 3])
    """

    window_type: ClassVar[type[Window]] = Window
    """Type of the windows that `window` returns."""
    condition_type: ClassVar[type | None] = None
    """Type of the condition besides speech, speaker and seed; None for a system without one."""
    name: str
    card: WeightsCard
    sha256s: Mapping[str, str]
    """SHA-256 of each weights file that it uses, by the name of the network, its own first."""
    speakers: Mapping[str, int]
    """Index in the network's table by speaker name."""
    encoder: SpeechEncoder
    windowing: Windowing
    samplers: tuple[SamplerChoice, ...]
    """Available samplers; the first is the default."""
    rotation_frame: Literal["local", "global"]
    """Frame of the rotations of windows and of blending: the parent joint's, or the world's."""
    root_format: RootFormat
    expression_basis: ExpressionBasis = "arkit52"

    @property
    def guidance(self) -> float | None:
        """Default guidance scale; None if it cannot be chosen."""
        return self.samplers[0].default_guidance

    def speaker_index(self, speaker: str) -> int:
        """Return a speaker's index; raises UnknownNameError if these weights do not know it."""
        if speaker not in self.speakers:
            raise UnknownNameError(
                f"There is no speaker {speaker!r}; choose one of {', '.join(self.speakers)}."
            )
        return self.speakers[speaker]

    def draw_condition(
        self, waveform: Float[np.ndarray, " N"], num_frames: int, spec: WindowSpec
    ) -> Any:
        """Draw the condition of the first sample for whole speech; raises ValueError if none."""
        raise ValueError(f"{self.name} takes no condition besides speech.")

    def condition_stream(self, spec: WindowSpec) -> ConditionStream:
        """Return a generator of the condition for speech that is still being spoken."""
        raise ValueError(f"{self.name} takes no condition besides speech.")

    def make_constraint(
        self, condition: Any, state: Mapping[str, Shaped[Tensor, " ..."]] | None = None
    ) -> MotionConstraint | None:
        """Return the constraint for one sample's motion; None if nothing constrains it.

        The condition is None if it arrives with the speech; ``state`` has the decisions of an
        earlier constraint (`MotionConstraint.state`).
        """
        return None

    def conditioning(
        self, waveform: Float[np.ndarray, " N"], num_frames: int, spec: WindowSpec
    ) -> Float[Tensor, "T input_dim"]:
        """Encode whole speech for the windows, with silence after its end."""
        return torch.from_numpy(self.encoder.encode(waveform, num_frames))

    def resolve_sampling(self, options: Sampling) -> Sampling:
        """Return the sampling options with this system's defaults filled in.

        Raises UnknownNameError if it has no such sampler, ValueError if the guidance scale is not 1
        for a system without guidance.
        """
        samplers = {sampler.name: sampler for sampler in self.samplers}
        name = self.samplers[0].name if options.sampler is None else options.sampler
        if name not in samplers:
            has = ", ".join(samplers)
            raise UnknownNameError(f"{self.name} has no sampler {name!r}; it has {has}.")
        usual = 1.0 if self.guidance is None else self.guidance
        strength = usual if options.guidance is None else options.guidance
        if self.guidance is None and strength != 1:
            raise ValueError(f"{self.name} does not support guidance; omit it, or set it to 1.")
        steps = options.steps or samplers[name].default_steps
        return Sampling(sampler=name, steps=steps, guidance=strength)

    def supported_sampling(self, options: Sampling) -> Sampling:
        """Return the options that this system supports; the others become its defaults."""
        has_it = any(sampler.name == options.sampler for sampler in self.samplers)
        return replace(
            options,
            sampler=options.sampler if has_it else None,
            guidance=None if self.guidance is None else options.guidance,
        )

    @abstractmethod
    def window(self, speech: SpeechWindow, before: Window | None, spec: WindowSpec) -> Window:
        """Generate one window of motion for each sample.

        ``before`` is the result for the window before, whole or cut shorter; its last ``overlap``
        frames are the first of this one. None at the start of a clip.
        """

    def join(self, older: Window, newer: Window) -> Window:
        """Blend the first frames of ``newer`` into ``older``, the end of the motion so far.

        Rotations are blended along the geodesic, all else linearly.
        """
        shared = older.root.shape[1]
        first, rest = newer.part(slice(shared)), newer.part(slice(shared, None))
        weight = fade_weights(shared).to(older.root)[:, None]
        joined = {
            "rotmat": interpolate_rotations(older.rotmat, first.rotmat, weight),
            "root": crossfade(older.root, first.root),
            "expression": crossfade(older.expression, first.expression),
        }
        return replace(
            newer, **{n: torch.cat([start, getattr(rest, n)], dim=1) for n, start in joined.items()}
        )
