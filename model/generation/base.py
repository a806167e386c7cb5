"""What every system is, whatever family it belongs to: a maker of windows that join to motion; how
speech is cut into windows, and how two meet.

A system knows speech, speaker and seed. What else it follows is a condition of its family's own
kind, which nobody here looks into: drawn from speech for each sample, or given.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Literal, Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from model.motion.motion import ExpressionBasis, Motion
from model.motion.packing import Normaliser
from model.motion.rotations import interpolate_rotations
from model.motion.spaces import RootMotion, RotationSpace
from model.plan.tier_files import Interval
from model.sampling.flow import SpeechGuide, seeded_noise
from model.sampling.samplers import Sampler, Sampling, UnknownNameError
from model.speech.encoder import SpeechEncoder
from model.storage.cards import Card


def num_windows(num_frames: int, window: int, overlap: int) -> int:
    """Windows needed to cover ``num_frames``; each starts ``window - overlap`` after the last."""
    return 1 + max(0, -(-(num_frames - window) // (window - overlap)))


def fade_weights(overlap: int) -> Float[Tensor, " overlap"]:
    """Share of the newer window on each shared frame: a minimum-jerk ramp strictly inside (0, 1).

    ``10 s^3 - 15 s^4 + 6 s^5`` starts and ends with zero slope and curvature, so a join adds
    neither a step in velocity nor one in acceleration.
    """
    s = torch.arange(1, overlap + 1) / (overlap + 1)
    return s**3 * (10 - 15 * s + 6 * s**2)


def fade(
    older: Float[Tensor, "*batch S C"], newer: Float[Tensor, "*batch S C"]
) -> Float[Tensor, "*batch S C"]:
    """The frames two windows share of channels that may be mixed linearly."""
    return torch.lerp(older, newer, fade_weights(older.shape[-2]).to(older)[:, None])


@dataclass(frozen=True)
class SpeechWindow:
    """The speech under some frames and around them; past either end it is held."""

    speech: Float[Tensor, "heard speech_dim"]

    @staticmethod
    def of(
        features: Float[Tensor, "T speech_dim"], first: int, frames: int, context: int
    ) -> "SpeechWindow":
        """Some frames of whole speech, from ``first`` on, with their context."""
        wanted = torch.arange(first - context, first + frames + context)
        return SpeechWindow(features[wanted.clamp(0, len(features) - 1)])

    def around(self, context: int, window: int) -> Float[Tensor, "heard speech_dim"]:
        """The middle ``window`` frames with ``context`` frames before and after."""
        spare = (len(self.speech) - window) // 2 - context
        return self.speech[spare : len(self.speech) - spare]


@dataclass(frozen=True)
class Windowing:
    """How a system cuts time, in frames."""

    frames: int
    overlap: int
    """Frames that a window shares with the one before."""
    context: int = field(default=0, compare=False)
    """Frames of speech that must be known before and after a window."""

    def __post_init__(self) -> None:
        if self.advance < 2 or not 0 <= self.overlap <= self.advance:
            raise ValueError(
                f"Windows must start at least 2 frames apart and share no more than that; got"
                f" {self.advance} and {self.overlap}."
            )

    @property
    def advance(self) -> int:
        """From the start of one window to the start of the next."""
        return self.frames - self.overlap


@dataclass(frozen=True)
class Draw:
    """What decides a window beside its speech and the window before it."""

    speaker: int
    seed: int
    samples: int
    index: int
    """Of the window."""
    sampler: str
    steps: int
    guidance: float
    first_sample: int = 0
    condition: Any = None
    """What it follows beside them; see `System.condition`."""
    first_frame: int | None = None
    """Of the window, in the condition; None is where windows of whole speech have it."""
    words: tuple[Interval, ...] = ()
    """What is said, where that is known."""

    @property
    def key(self) -> tuple[int, int]:
        """Of chance that is drawn for the first sample, whatever its windows."""
        return self.seed, self.first_sample

    def guide(self, normaliser: Normaliser, space: RotationSpace) -> SpeechGuide:
        """How strongly a network of such motion is to hear."""
        return SpeechGuide(self.guidance, normaliser, space)

    def noise(self, shape: tuple[int, ...], *step: int) -> Float[Tensor, "samples ..."]:
        """Standard normal: the same for every system that asks for this shape and step, and for
        however many samples share a batch."""
        samples = range(self.first_sample, self.first_sample + self.samples)
        keys = [[self.seed, sample, self.index, *step] for sample in samples]
        return torch.stack([seeded_noise(key, shape) for key in keys])


@dataclass(frozen=True)
class Window:
    """Motion of one window, before it is joined to the others. A family may add to it what its
    next window needs to know, tensors (B, n, ...): that starts from the last ``overlap`` frames."""

    rotmat: Float[Tensor, "B n 55 3 3"]
    """In the system's `frame`."""
    root: Float[Tensor, "B n 3"]
    """As the system's `root_motion` has them."""
    expression: Float[Tensor, "B n E"]
    """Face units, 0 to 1."""

    def part(self, frames: slice) -> "Window":
        """Some of its frames."""
        return replace(self, **self.fields_of(frames))

    def fields_of(self, frames: slice) -> dict[str, Tensor]:
        """Some frames of each of its tensors."""
        return {name: tensor[:, frames] for name, tensor in vars(self).items()}


@runtime_checkable
class ConditionStream(Protocol):
    """Draws a condition while speech comes."""

    manner: Any
    """How from now on, of the family's own kind."""

    def go_on(
        self,
        speech: Callable[[int, int], Float[Tensor, "T dim"]],
        first: int,
        final: int,
        stop: int,
    ) -> Any:
        """The ``condition`` around the frames from ``first`` to ``stop``, and the frame that is its
        first (``origin``); what begins before ``final`` is decided for good. Features of frames
        that have not come are supposed ones."""
        ...

    def heard(
        self, features: Float[Tensor, "n dim"], ahead: Any, first: int
    ) -> Float[Tensor, "n heard_dim"]:
        """What windows hear of frames from ``first`` on: features and condition."""
        ...


@runtime_checkable
class Follower(Protocol):
    """Brings a motion that comes piece by piece to what its condition says of it."""

    margin: int
    """Frames of the condition that it looks at on either side of a piece."""

    def follow(self, motion: Motion) -> Motion:
        """The frames that follow those of the call before."""
        ...

    def go_on_with(self, ahead: Any, first_frame: int) -> None:
        """From now on another condition, in which the next frame is ``first_frame``."""
        ...

    def kept(self) -> dict[str, Tensor]:
        """What it has decided, for whoever follows another condition through the same speech."""
        ...


@dataclass(frozen=True, kw_only=True)
class System(ABC):
    """A trained generator with a name, its card, and what it can be asked for."""

    window_type: ClassVar[type[Window]] = Window
    """Of what its `window` makes."""
    condition_type: ClassVar[type | None] = None
    """Of what it follows beside speech, speaker and seed; None follows nothing else."""
    name: str
    card: Card
    sha256s: Mapping[str, str]
    """Of every file of weights that it moves with: its own first."""
    speakers: Mapping[str, int]
    """Speaker name -> index in the network's table."""
    encoder: SpeechEncoder
    windowing: Windowing
    samplers: tuple[Sampler, ...]
    """The first is the usual one."""
    frame: Literal["parent", "world"]
    """In which the rotations of its windows are told, and joined."""
    root_motion: RootMotion
    expression_basis: ExpressionBasis = "arkit52"

    @property
    def guidance(self) -> float | None:
        """The usual strength of the speech; None where it cannot be chosen."""
        return self.samplers[0].guidance

    def speaker_index(self, speaker: str) -> int:
        """Index of a speaker by name.

        Raises:
            UnknownNameError: if these weights were not trained on that speaker.
        """
        if speaker not in self.speakers:
            raise UnknownNameError(
                f"There is no speaker {speaker!r}; choose one of {', '.join(self.speakers)}."
            )
        return self.speakers[speaker]

    def condition(self, waveform: Float[np.ndarray, " N"], num_frames: int, draw: Draw) -> Any:
        """What it follows beside whole speech, drawn for the first sample.

        Raises:
            ValueError: of a system that follows nothing else, as the two below.
        """
        raise ValueError(f"{self.name} follows speech alone.")

    def condition_stream(self, draw: Draw) -> ConditionStream:
        """The same for speech that is still being spoken."""
        raise ValueError(f"{self.name} follows speech alone.")

    def follower(self, condition: Any, kept: Mapping[str, Tensor] | None = None) -> Follower | None:
        """What brings one sample's motion to a condition (None is one that comes as speech does),
        with what a follower before has `kept`; None leaves the motion to the network."""
        return None

    def hear(
        self, waveform: Float[np.ndarray, " N"], num_frames: int, draw: Draw
    ) -> Float[Tensor, "T heard_dim"]:
        """What its windows hear of whole speech, silence after its end: the encoder's features."""
        return torch.from_numpy(self.encoder.encode(waveform, num_frames))

    def settled(self, asked: Sampling) -> Sampling:
        """How it draws if it is asked so, with nothing left open.

        Raises:
            UnknownNameError: if it has no such sampler.
            ValueError: if it is to hear other than as it was trained, and cannot.
        """
        known = {sampler.name: sampler for sampler in self.samplers}
        name = self.samplers[0].name if asked.sampler is None else asked.sampler
        if name not in known:
            has = ", ".join(known)
            raise UnknownNameError(f"{self.name} has no sampler {name!r}; it has {has}.")
        usual = 1.0 if self.guidance is None else self.guidance
        strength = usual if asked.guidance is None else asked.guidance
        if self.guidance is None and strength != 1:
            raise ValueError(f"{self.name} takes no guidance; leave it out, or at 1.")
        steps = asked.steps or known[name].steps
        return Sampling(sampler=name, steps=steps, guidance=strength)

    def able(self, asked: Sampling) -> Sampling:
        """What of it can be asked of this system; the rest is left as it usually has it."""
        has_it = any(sampler.name == asked.sampler for sampler in self.samplers)
        return replace(
            asked,
            sampler=asked.sampler if has_it else None,
            guidance=None if self.guidance is None else asked.guidance,
        )

    @abstractmethod
    def window(self, speech: SpeechWindow, before: Window | None, draw: Draw) -> Window:
        """One window of motion for each sample.

        Args:
            before: what this returned for the window before, whole or cut shorter; its last
                ``overlap`` frames are the first of this. None where a clip begins.
        """

    def join(self, older: Window, newer: Window) -> Window:
        """``newer`` with its first frames joined to the same of the motion so far (``older``):
        rotations along the geodesic, all else linearly."""
        shared = older.root.shape[1]
        first, rest = newer.part(slice(shared)), newer.part(slice(shared, None))
        weight = fade_weights(shared).to(older.root)[:, None]
        joined = {
            "rotmat": interpolate_rotations(older.rotmat, first.rotmat, weight),
            "root": fade(older.root, first.root),
            "expression": fade(older.expression, first.expression),
        }
        return replace(
            newer,
            **{n: torch.cat([start, getattr(rest, n)], dim=1) for n, start in joined.items()},
        )
