"""Shapes in which several measures come."""

from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from jaxtyping import Float

ByJoint = Float[np.ndarray, " 55"]
ByDepth = Float[np.ndarray, " 11"]
ByFingertip = Float[np.ndarray, " 10"]
T = TypeVar("T")


@dataclass(frozen=True)
class Sides(Generic[T]):
    """One thing of the left and of the right side."""

    left: T
    right: T
