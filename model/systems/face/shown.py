"""A body that is shown the drawn face: what systems that make only the body have in common."""

from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from jaxtyping import Float
from torch import Tensor

from model.generation.base import Draw, System, Window, Windowing
from model.generation.speech_stream import SpeechWindow
from model.networks.config import BranchConfig
from model.storage.cards import CheckpointError
from model.systems.face.face import Face


@dataclass(frozen=True)
class BodyWindow(Window):
    """A window, and what the next one starts from."""

    clean: Float[Tensor, "B n C"]
    """Normalised motion of its frames, before they are joined."""

    def fields_of(self, frames: slice) -> dict[str, Any]:
        """See `Window.fields_of`."""
        return super().fields_of(frames) | {"clean": self.clean[:, frames]}


@dataclass(frozen=True, kw_only=True)
class FacedSystem(System):
    """Its face is that of the expression network, drawn before the body."""

    window_type: ClassVar[type[Window]] = BodyWindow
    config: BranchConfig
    """Shape of the network that makes the body."""
    face: Face

    def face_plan(self, heard: Float[Tensor, "heard dim"]) -> Float[Tensor, "heard tracks"] | None:
        """What of the things heard tells the face of a plan; None without one."""
        return None

    @abstractmethod
    def body(
        self,
        speech: Float[Tensor, "heard dim"],
        expression: Float[Tensor, "T E"],
        seed: Float[Tensor, "B S C"] | None,
        draw: Draw,
    ) -> BodyWindow:
        """One window of body.

        Args:
            speech: of the window and ``config.speech_context`` frames on either side, as the
                system's `hear` has it: the encoder's features first.
            expression: the face that it is shown.
            seed: normalised motion of the first frames; None where a clip begins.
        """

    def window(self, speech: SpeechWindow, before: Window | None, draw: Draw) -> BodyWindow:
        """See `System.window`. The face is drawn first, the same for all samples, and goes on from
        the window before; the body sees it."""
        assert before is None or isinstance(before, BodyWindow)
        frames = self.windowing.frames
        heard = speech.around(self.face.config.speech_context, frames)
        face = self.face.window(
            heard[:, : self.encoder.dim],
            draw.speaker,
            None if before is None else before.expression[0],
            draw.seed,
            draw.index,
            self.face_plan(heard),
        )
        seed = None if before is None else before.clean[:, -self.config.seed_frames :]
        return self.body(speech.around(self.config.speech_context, frames), face, seed, draw)

    def join(self, older: Window, newer: Window) -> Window:
        """Bodies are faded into each other; faces have met already."""
        return replace(super().join(older, newer), expression=newer.expression)


def shared_windowing(name: str, body: BranchConfig, face: Face) -> Windowing:
    """How body and face are cut, which must be alike.

    Args:
        name: of the body's weights.

    Raises:
        CheckpointError: if they are not.
    """
    windows = body.window_frames, body.seed_frames
    if windows != (face.config.window_frames, face.config.seed_frames):
        raise CheckpointError(f"The windows of {name} and of the expression network differ.")
    return Windowing(*windows, max(body.speech_context, face.config.speech_context))
