"""Records of protocols: rules of measurement with their inputs, sources and ids."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

Need = Literal[
    "reference", "waveform", "mean_speeds", "semantics", "face_vertices", "emage_weights",
    "genea_weights",
]  # fmt: skip


@dataclass(frozen=True)
class Protocol:
    """Rule of measurement; two numbers can be compared only if they have the same id."""

    id: str
    rule: str
    """Definition of the number for its readers, one to three sentences."""
    input: str
    """Joints, coordinates and units."""
    pieces: str
    """Length and hop of the pieces that are measured, and how clips are averaged."""
    source: str
    """Origin of the formula."""
    compared: str = "no"
    """Whether it was checked against the authors' code, and the result; or "our own"."""
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
    """True for a metric of this program, which ordinary runs measure without its formula."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the metric: its values, and if there is one only, the id and its first part."""
        values = tuple(self.values or ())
        return (*values, self.id, self.id.partition("/")[0]) if len(values) == 1 else values
