"""Interface of formulas: inputs of a clip, and additive sums of which values are made.

Sums are additive, so that sets of clips and bootstrap draws need the sums of each clip only.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Num

from model.motion.motion import Motion
from model.motion.tracks import Tracks

FaceVertices = Callable[[slice], Float[np.ndarray, "n V 3"]]
"""Function from frames to vertices (m) that only jaw and expressions move."""
Sums = dict[str, np.ndarray]
"""Additive statistics of a clip by name; ``count`` is the weight of the others in `mean_values`."""


@dataclass(frozen=True, eq=False)
class Clip:
    """Inputs of a protocol; None for what is missing."""

    joints: Float[np.ndarray, "T 55 3"]
    """Joint positions of the open body (m), y up, at 30 fps."""
    root_rotations: Float[np.ndarray, "T 3 3"]
    reference: "Clip | None" = None
    """Recorded motion of the same length."""
    waveform: Float[np.ndarray, " N"] | None = None
    """Speech at 16 kHz."""
    published_mean_speeds: Float[np.ndarray, " 13"] | None = None
    """Published mean speeds (m/s) of the upper-body joints."""
    semantics: Float[np.ndarray, " T"] | None = None
    """Semantic relevance of each frame, 0 to 1, as annotated in BEAT."""
    face_vertices: FaceVertices | None = None
    betas: np.ndarray | None = None
    """Body shape, which the face of a motion that is compared with this one has as well."""

    @property
    def pelvis_aligned(self) -> Float[np.ndarray, "T 55 3"]:
        """Pelvis-aligned joint positions (m)."""
        return self.joints - self.joints[:, :1]

    def first_frames(self, num_frames: int) -> "Clip":
        """Return the first frames; the waveform stays whole."""
        frames = slice(num_frames)
        return replace(
            self,
            joints=self.joints[frames],
            root_rotations=self.root_rotations[frames],
            reference=self.reference and self.reference.first_frames(num_frames),
            semantics=None if self.semantics is None else self.semantics[frames],
        )


@dataclass(frozen=True, eq=False)
class ProtocolInputs:
    """Inputs that clips of one speech share; None for what is missing."""

    waveform: Float[np.ndarray, " N"] | None = None
    published_mean_speeds: Float[np.ndarray, " 13"] | None = None
    semantics: Float[np.ndarray, " M"] | None = None
    """Semantic relevance of at least as many frames as are measured."""
    make_face_vertices: Callable[[Motion], FaceVertices | None] | None = None
    """Function from a motion to its face; None for one without ARKit blendshapes."""

    def make_clip(self, motion: Motion, tracks: Tracks, reference: Clip | None = None) -> Clip:
        """Make the clip of a motion; its face has the body shape of its reference."""
        face = motion
        if reference is not None and reference.betas is not None:
            face = replace(motion, betas=reference.betas)
        return Clip(
            tracks.joints,
            tracks.R_world_joint[:, 0].copy(),  # a view would keep all of a long clip's
            reference,
            self.waveform,
            self.published_mean_speeds,
            None if self.semantics is None else self.semantics[: motion.num_frames],
            None if self.make_face_vertices is None else self.make_face_vertices(face),
            motion.betas,
        )


def mean_values(sums: Mapping[str, Num[np.ndarray, " ..."]]) -> dict[str, float]:
    """Divide all sums by ``count``; nothing if that is 0."""
    count = float(sums["count"])
    if not count:
        return {}
    return {key: float(value) / count for key, value in sums.items() if key != "count"}
