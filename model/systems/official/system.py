"""The authors' checkpoints as a system: sampler, windows, seams, filter and start of a clip."""

import functools
import os
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, cast

import torch
from jaxtyping import Float
from torch import Tensor, nn

from conventions.joints import JOINT_NAMES
from model.generation.base import SpeechWindow, System, Window, Windowing, WindowSpec
from model.motion.kinematics import global_from_local
from model.motion.motion import Motion, load_motion
from model.motion.rotations import matrix_from_axis_angle, matrix_from_rot6d, rot6d_from_matrix
from model.motion.spaces import ROOT_DIM
from model.sampling.flow import sample
from model.storage.files import FileStamps, file_sha256, file_stamps
from model.storage.npz import MotionError
from model.systems.official import networks
from model.systems.official.checkpoints import (
    MOTION_DIM,
    SEED_FRAMES,
    SEED_VARIABLE,
    WINDOW_FRAMES,
    OfficialNetwork,
    official_file,
)
from model.systems.official.config import FAMILY, UNFILTERED
from model.systems.official.networks import OfficialExpressionNetwork, OfficialMotionNetwork
from model.systems.official.speech import frames_to_window, official_encoder

FILTER = torch.tensor([-2.0, 3.0, 6.0, 7.0, 6.0, 3.0, -2.0]) / 21
"""Savitzky-Golay filter of 7 frames, order 2."""
FILTER_INPUT_START = 5
"""First frame (index) of the input of the authors' filter, which has no padding."""
STANDING_POSE = {
    "left_shoulder": (0.0, -0.1, -1.0),
    "right_shoulder": (0.0, 0.1, 1.0),
    "left_elbow": (0.3, -0.45, 0.0),
    "right_elbow": (0.3, 0.45, 0.0),
}
"""Axis-angles (radians) of hanging arms; all other joints are in the rest pose."""
STANDING_TRANSLATION_M = (0.0, 1.29, 0.0)
"""Position of the standing body (m), as tall as BEAT2's speakers."""


@dataclass(frozen=True)
class OfficialWindow(Window):
    """A window with its motion vectors: those of blended frames are means, and no rotations yet."""

    vectors: Float[Tensor, "B n 333"]


@dataclass(frozen=True, kw_only=True)
class OfficialSystem(System):
    """System of the motion network, the expression model, and the start pose of a clip."""

    window_type: ClassVar[type[Window]] = OfficialWindow
    network: OfficialMotionNetwork
    expression_network: OfficialExpressionNetwork
    initial_seed_pose: Float[Tensor, "8 333"]
    smooths_windows: bool
    """True if each window is smoothed before the next one starts, as in the authors' script."""

    @torch.inference_mode()
    def window(
        self, speech: SpeechWindow, before: Window | None, spec: WindowSpec
    ) -> OfficialWindow:
        assert before is None or isinstance(before, OfficialWindow)
        size = spec.num_samples
        speech_window = frames_to_window(speech.trim_context(0, WINDOW_FRAMES))[None]
        speaker = torch.tensor([spec.speaker_index])
        face = self.expression_network(speech_window, speaker)
        seed = self.initial_seed_pose.expand(size, -1, -1)
        if before is not None:
            seed = before.vectors[:, -SEED_FRAMES:]
        conditions = {
            "speech": speech_window.expand(size, -1, -1),
            "expression": face.expand(size, -1, -1),
            "seed": seed,
            "speaker": speaker.expand(size),
        }
        last: dict[str, Tensor] = {}

        def predict(x_t: Float[Tensor, "B T C"], t: float) -> Tensor:
            x_1 = self.network(x_t, torch.full((size,), t, dtype=x_t.dtype), **conditions)
            x_1[:, :SEED_FRAMES] = (seed + x_1[:, :SEED_FRAMES]) / 2
            last["x_1"] = x_1
            return x_1

        x_0 = spec.noise((WINDOW_FRAMES, MOTION_DIM))
        sample(predict, x_0, steps=spec.steps, sampler="reinterpolate")
        vectors = smoothed(last["x_1"]) if self.smooths_windows else last["x_1"]
        return _window(orthonormalise_rotations(vectors), conditions["expression"])

    def join(self, older: Window, newer: Window) -> OfficialWindow:
        """Average the shared frames of both windows, the face too."""
        assert isinstance(older, OfficialWindow) and isinstance(newer, OfficialWindow)
        shared = older.vectors.shape[1]

        def joined(end: Float[Tensor, "B S C"], start: Float[Tensor, "B T C"]) -> Tensor:
            return torch.cat([(end + start[:, :shared]) / 2, start[:, shared:]], dim=1)

        return _window(
            joined(older.vectors, newer.vectors), joined(older.expression, newer.expression)
        )


def _window(vectors: Float[Tensor, "B n 333"], face: Float[Tensor, "B n E"]) -> OfficialWindow:
    rotmat = matrix_from_rot6d(vectors[..., :-ROOT_DIM].unflatten(-1, (-1, 6)))
    return OfficialWindow(
        rotmat=rotmat, root=vectors[..., -ROOT_DIM:], expression=face, vectors=vectors
    )


def orthonormalise_rotations(vectors: Float[Tensor, "B T 333"]) -> Float[Tensor, "B T 333"]:
    """Orthonormalise the 6D rows of motion vectors, which are of any length and angle."""
    rotmat = matrix_from_rot6d(vectors[..., :-ROOT_DIM].unflatten(-1, (-1, 6)))
    return torch.cat([rot6d_from_matrix(rotmat).flatten(-2), vectors[..., -ROOT_DIM:]], dim=-1)


def smoothed(vectors: Float[Tensor, "B T C"]) -> Float[Tensor, "B T C"]:
    """Apply the authors' filter: the first 8 frames and the last 3 are unchanged."""
    frames = len(FILTER)
    smooth = vectors[:, FILTER_INPUT_START:].unfold(1, frames, 1) @ FILTER.to(vectors)
    middle = slice(FILTER_INPUT_START + frames // 2, vectors.shape[1] - frames // 2)
    changed = vectors.clone()
    changed[:, middle] = smooth
    return changed


def initial_seed_pose() -> Float[Tensor, "8 333"]:
    """Return the start of the motion file that ``OFFICIAL_SEED`` names, else a still pose."""
    named = os.environ.get(SEED_VARIABLE)
    return seed_pose_of(load_motion(Path(named))) if named else standing_seed_pose()


def seed_pose_of(motion: Motion) -> Float[Tensor, "8 333"]:
    """Return a motion's first frames as vectors; raises MotionError if there are fewer."""
    if motion.num_frames < SEED_FRAMES:
        raise MotionError(
            f"The motion to start from has {motion.num_frames} frames; {SEED_FRAMES} are needed."
        )
    start = motion.part(slice(SEED_FRAMES))
    return _vectors(start.local_rotations(), torch.tensor(start.trans))


def standing_seed_pose() -> Float[Tensor, "8 333"]:
    """Return the motion vectors of a still standing pose."""
    poses = torch.zeros(len(JOINT_NAMES), 3)
    for joint, turned in STANDING_POSE.items():
        poses[JOINT_NAMES.index(joint)] = torch.tensor(turned)
    local = matrix_from_axis_angle(poses).expand(SEED_FRAMES, -1, -1, -1)
    return _vectors(local, torch.tensor(STANDING_TRANSLATION_M).expand(SEED_FRAMES, -1))


def _vectors(
    local: Float[Tensor, "n 55 3 3"], place: Float[Tensor, "n 3"]
) -> Float[Tensor, "n 333"]:
    rows = rot6d_from_matrix(global_from_local(local.double())).float()
    return torch.cat([rows.flatten(-2), place], dim=-1)


@functools.lru_cache(maxsize=2)
def _shared(part: OfficialNetwork, path: Path, stamps: FileStamps) -> nn.Module:
    """Load a network once for both systems."""
    return networks.load_network(part, path)


def load(name: str, folder: Path) -> OfficialSystem:
    """Load the named checkpoints."""
    motion, expression = official_file("motion"), official_file("expression")
    network = cast(OfficialMotionNetwork, _shared("motion", motion, file_stamps([motion])))
    expression_network = _shared("expression", expression, file_stamps([expression]))
    card = FAMILY.card(name, folder)
    return OfficialSystem(
        name=name,
        card=card,
        sha256s={name: file_sha256(motion), "official expression": file_sha256(expression)},
        speakers=card.speakers,
        encoder=official_encoder(),
        windowing=Windowing(WINDOW_FRAMES, SEED_FRAMES, 0),
        samplers=FAMILY.samplers_of(name),
        rotation_frame="global",
        root_format="place",
        expression_basis="flame100",
        network=network,
        expression_network=cast(OfficialExpressionNetwork, expression_network),
        initial_seed_pose=initial_seed_pose(),
        smooths_windows=name != UNFILTERED,
    )
