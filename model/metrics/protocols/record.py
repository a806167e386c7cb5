"""Interface of protocols: a record of the rule, sums over one clip, and values of added sums.

Sums are additive, so that sets of clips and bootstrap draws need the sums of each clip only. A new
protocol is a record in `model.metrics.protocols.table`, with a function from a clip to its sums.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from model.motion.motion import Motion
from model.motion.tracks import Tracks

Need = Literal[
    "reference", "waveform", "mean_speeds", "semantics", "face_vertices", "emage_weights",
    "genea_weights",
]  # fmt: skip
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
    mean_speeds: Float[np.ndarray, " 13"] | None = None
    """Published mean speeds (m/s) of the upper-body joints."""
    semantics: Float[np.ndarray, " T"] | None = None
    """Semantic relevance of each frame, 0 to 1, as annotated in BEAT."""
    face_vertices: FaceVertices | None = None

    @property
    def rooted(self) -> Float[np.ndarray, "T 55 3"]:
        """Pelvis-aligned joint positions (m)."""
        return self.joints - self.joints[:, :1]

    def first(self, num_frames: int) -> "Clip":
        """Return the first frames; the waveform stays whole."""
        frames = slice(num_frames)
        return replace(
            self,
            joints=self.joints[frames],
            root_rotations=self.root_rotations[frames],
            reference=self.reference and self.reference.first(num_frames),
            semantics=None if self.semantics is None else self.semantics[frames],
        )


@dataclass(frozen=True, eq=False)
class ProtocolInputs:
    """Inputs that clips of one speech share; None for what is missing."""

    waveform: Float[np.ndarray, " N"] | None = None
    mean_speeds: Float[np.ndarray, " 13"] | None = None
    semantics: Float[np.ndarray, " M"] | None = None
    """Semantic relevance of at least as many frames as are measured."""
    face_vertices: Callable[[Motion], FaceVertices | None] | None = None

    def clip(self, motion: Motion, tracks: Tracks, reference: Clip | None = None) -> Clip:
        """Make the clip of a motion."""
        return Clip(
            tracks.joints,
            tracks.global_rot[:, 0],
            reference,
            self.waveform,
            self.mean_speeds,
            None if self.semantics is None else self.semantics[: motion.num_frames],
            None if self.face_vertices is None else self.face_vertices(motion),
        )


def mean_values(sums: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Divide all sums by ``count``; nothing if that is 0."""
    count = float(sums["count"])
    if not count:
        return {}
    return {key: float(value) / count for key, value in sums.items() if key != "count"}


@dataclass(frozen=True)
class Protocol:
    """Rule of measurement; two numbers can be compared only if they have the same id."""

    id: str
    rule: str
    """Two sentences for a reader of the number."""
    input: str
    """Joints, coordinates and units."""
    pieces: str
    """Length and hop of the pieces that are measured, and how clips are averaged."""
    source: str
    """Origin of the formula."""
    compared: str = "never"
    """Comparison with the authors' code or data."""
    values: Mapping[str, str] | None = None
    """Units by value of the result."""
    needs: tuple[Need, ...] = ()
    parts: tuple[str, ...] = ()
    """Parts (`model.formats.reading.Part`) without which a motion is left out."""
    rate_fps: float = 30.0
    encoder: str = "none"
    """File of the encoder and its sha256."""
    seeds: str = "none"
    is_own: bool = False
    """True for a metric of this program, which ordinary runs measure without the sums."""
    sums: Callable[[Clip], Sums] | None = None
    """Function from a clip to its sums, empty if it is too short; None if others measure it."""
    evaluate: Callable[[Mapping[str, np.ndarray]], dict[str, float]] = mean_values
    """Function from added sums to values."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the metric: its values, and if there is one only, the id and its first part."""
        values = tuple(self.values or ())
        return (*values, self.id, self.id.partition("/")[0]) if len(values) == 1 else values

    def sums_of(self, clip: Clip) -> Sums:
        """Compute the sums of a clip; empty if it lacks an input."""
        has_all = all(getattr(clip, need, None) is not None for need in self.needs)
        return self.sums(clip) if self.sums is not None and has_all else {}
