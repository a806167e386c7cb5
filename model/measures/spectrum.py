"""At which frequencies points and joints move: Welch's spectra of velocities at 30 fps."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.signal import welch

from conventions.rates import FPS

WELCH_FRAMES = 128
MIN_SPECTRUM_FRAMES = 32
"""About a second: fewer frames cannot tell 5 Hz from what lies below it."""
HIGH_FREQUENCY_HZ = 5.0


@dataclass(frozen=True, eq=False)
class VelocitySpectrum:
    """Power of one velocity by frequency, its mean removed, summed over the three axes."""

    frequency_hz: Float[np.ndarray, " bins"]
    power: Float[np.ndarray, " *points bins"]
    """Mean square of the velocity in each bin, in its unit squared."""

    def above(self, hertz: float) -> Float[np.ndarray, " *points"]:
        """Mean square of what lies above a frequency."""
        return self.power[..., self.frequency_hz > hertz].sum(-1)

    def share_above(self, hertz: float) -> Float[np.ndarray, " *points"]:
        """Part, 0 to 1, of the power that lies above a frequency; NaN for what does not move."""
        return np.asarray(self.share()[..., self.frequency_hz > hertz].sum(-1))

    def share(self) -> Float[np.ndarray, " *points bins"]:
        """Each bin's part of the whole, which is 1; NaN for what does not move."""
        total = self.power.sum(-1, keepdims=True)
        return np.divide(self.power, total, out=np.full_like(self.power, np.nan), where=total > 0)


def velocity_spectrum(velocity: Float[np.ndarray, "T *points 3"]) -> VelocitySpectrum | None:
    """Welch's spectrum (Hann, 128 frames or the whole, half overlapping, mean removed).

    None for fewer than 32 frames of velocity.
    """
    if len(velocity) < MIN_SPECTRUM_FRAMES:
        return None
    frequency, density = welch(velocity, fs=FPS, nperseg=min(WELCH_FRAMES, len(velocity)), axis=0)
    power = np.moveaxis(density.sum(-1), 0, -1) * (frequency[1] - frequency[0])
    return VelocitySpectrum(frequency, power)
