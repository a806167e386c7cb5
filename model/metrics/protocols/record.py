"""Records of protocols: rules of measurement with their inputs, sources and ids."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

ProtocolInput = Literal[
    "reference", "waveform", "published_mean_speeds", "semantics", "face_vertices", "emage_weights",
    "genea_weights",
]  # fmt: skip


@dataclass(frozen=True)
class Protocol:
    """Rule of measurement; two numbers can be compared only if they have the same id."""

    id: str
    rule: str
    """Definition of the number for its readers, one to three sentences."""
    measured_quantity: str
    """Joints, coordinates and units."""
    frames_and_averaging: str
    """Frames of each clip that are measured, and how clips are averaged."""
    source: str
    """Origin of the formula."""
    code_comparison: str = "no"
    """Whether it was checked against the authors' code, and the result; or "our own"."""
    value_units: Mapping[str, str] | None = None
    """Units of the values of the result, by name of the value."""
    required_inputs: tuple[ProtocolInput, ...] = ()
    required_parts: tuple[str, ...] = ()
    """Parts (`model.formats.reading.Part`) without which a motion is left out."""
    rate_fps: float = 30.0
    encoder: str = "none"
    """File of the encoder and its sha256."""
    seed: str = "none"
    is_own_metric: bool = False
    """True for a metric of this program, which ordinary runs measure without its formula."""

    @property
    def metric_names(self) -> tuple[str, ...]:
        """Names by which the metric is requested.

        They are its values, and if there is one only, also the id and its first part.
        """
        values = tuple(self.value_units or ())
        return (*values, self.id, self.id.partition("/")[0]) if len(values) == 1 else values
