"""A body that is shown the drawn face: what systems that make only the body have in common."""

from dataclasses import dataclass, replace

from jaxtyping import Float
from torch import Tensor

from model.generation.base import Draw, System, Window, Windowing
from model.generation.speech_stream import SpeechWindow
from model.networks.config import BranchConfig
from model.storage.cards import CheckpointError
from model.systems.face.face import Face, FaceWindow


@dataclass(frozen=True)
class BodyWindow(Window):
    """A window, and what the next one starts from."""

    seed: Float[Tensor, "B S C"]
    """Normalised motion of its last frames, before they are joined."""
    face: FaceWindow


@dataclass(frozen=True, kw_only=True)
class FacedSystem(System):
    """Its face is that of the expression network, drawn before the body."""

    face: Face

    def draw_face(self, speech: SpeechWindow, before: BodyWindow | None, draw: Draw) -> FaceWindow:
        """The face of a window; it goes on from that of the window before."""
        return self.face.window(
            speech.around(self.face.config.speech_context, self.windowing.frames),
            draw.speaker,
            before and before.face,
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
