"""A body that is shown the drawn face: what systems that make only the body have in common."""

from dataclasses import dataclass, replace
from typing import Any

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

    face: Face

    def draw_face(
        self, speech: SpeechWindow, before: Window | None, draw: Draw
    ) -> Float[Tensor, "T E"]:
        """Face units of a window, the same for all samples; they go on from the window before."""
        return self.face.window(
            speech.around(self.face.config.speech_context, self.windowing.frames),
            draw.speaker,
            None if before is None else before.expression[0],
            draw.seed,
            draw.index,
        )

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
