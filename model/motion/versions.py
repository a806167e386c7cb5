"""What measured motions are called, as files and pages tell them apart."""

from typing import Literal, get_args

REFERENCE_NAME = "reference"
"""The recorded motion beside the systems."""
Kind = Literal["raw", "savgol"]
"""A motion as it is, or behind the Savitzky-Golay filter."""
KINDS: tuple[Kind, ...] = get_args(Kind)
