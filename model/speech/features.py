"""Log-mel, energy, onset strength and pitch of speech at 30 fps, with nothing to download.

Everything is computed at 100 Hz (160 samples; 16000 / 30 is no integer) and averaged over the
exact span of each motion frame. Blocks bound the memory, and give the same numbers for any size.
"""

import numpy as np
import torch
from jaxtyping import Float, Float32, Float64
from torch import Tensor

from model.motion.timing import FPS, SAMPLE_RATE

HOP = 160  # 10 ms
WINDOW = 400  # 25 ms of speech under each spectrum
FFT_SIZE = 512
NUM_MELS = 64
PITCH_WINDOW = 1024  # 64 ms: two periods of 31 Hz
PITCH_RANGE_HZ = (60.0, 420.0)
BLOCK_FRAMES = 1000  # 10 s

FLOOR_DB = -80.0
SPEECH_PERCENTILE = 90.0


class MelEncoder:
    """64 log-mels, energy, onset strength, log pitch and voicing: 68 numbers for each frame.

    Levels are relative to the clip's own speech level (the 90th percentile of its frame energy),
    so the gain of a microphone does not matter.
    """

    name = "mel64"
    dim = NUM_MELS + 4

    def encode(
        self, waveform: Float32[np.ndarray, " N"], num_frames: int
    ) -> Float32[np.ndarray, "num_frames dim"]:
        """See `SpeechEncoder.encode`."""
        log_mel, energy = _log_mel(waveform)
        level = np.percentile(energy, SPEECH_PERCENTILE)
        log_mel = np.maximum(log_mel - level, FLOOR_DB)
        relative_energy = np.maximum(energy - level, FLOOR_DB)
        onset = np.zeros_like(energy)
        onset[1:] = np.maximum(np.diff(log_mel, axis=0), 0).mean(1)
        pitch, voiced = _pitch(waveform, relative_energy)
        centre = np.median(pitch[voiced > 0]) if voiced.any() else 0.0
        columns = np.concatenate(
            [
                (log_mel + 40.0) / 20.0,
                (relative_energy[:, None] + 20.0) / 20.0,
                onset[:, None] / 3.0,
                np.clip(2.0 * (pitch - centre) * voiced, -2.5, 2.5)[:, None],
                voiced[:, None],
            ],
            axis=1,
        )
        silence = np.zeros(self.dim)
        silence[:NUM_MELS] = (FLOOR_DB + 40.0) / 20.0
        silence[NUM_MELS] = (FLOOR_DB + 20.0) / 20.0
        return _average_over_frames(columns, num_frames, silence).astype(np.float32)


def _num_hops(waveform: Float32[np.ndarray, " N"]) -> int:
    return max(1, -(-len(waveform) // HOP))


def _windows(
    waveform: Float32[np.ndarray, " N"], first: int, last: int, size: int
) -> Float32[np.ndarray, "hops size"]:
    """Windows of ``size`` samples centred on hops ``first .. last - 1``; silence outside."""
    start = first * HOP + HOP // 2 - size // 2
    stop = (last - 1) * HOP + HOP // 2 - size // 2 + size
    piece = np.zeros(stop - start, np.float32)
    inside = waveform[max(start, 0) : max(stop, 0)]
    piece[max(-start, 0) : max(-start, 0) + len(inside)] = inside
    return np.lib.stride_tricks.sliding_window_view(piece, size)[::HOP]


def _log_mel(
    waveform: Float32[np.ndarray, " N"],
) -> tuple[Float64[np.ndarray, "hops mels"], Float64[np.ndarray, " hops"]]:
    """Mel power and total power in dB at 100 Hz."""
    import librosa  # takes a second to import

    filters = librosa.filters.mel(sr=SAMPLE_RATE, n_fft=FFT_SIZE, n_mels=NUM_MELS, fmin=50.0)
    taper = np.hanning(WINDOW).astype(np.float32)
    hops = _num_hops(waveform)
    log_mel = np.empty((hops, NUM_MELS))
    energy = np.empty(hops)
    for first in range(0, hops, BLOCK_FRAMES):
        last = min(hops, first + BLOCK_FRAMES)
        spectrum = np.fft.rfft(_windows(waveform, first, last, WINDOW) * taper, FFT_SIZE)
        power = spectrum.real**2 + spectrum.imag**2
        log_mel[first:last] = 10 * np.log10(power @ filters.T + 1e-8)
        energy[first:last] = 10 * np.log10(power.sum(1) + 1e-6)
    return log_mel, energy


def _pitch(
    waveform: Float32[np.ndarray, " N"], relative_energy: Float64[np.ndarray, " hops"]
) -> tuple[Float64[np.ndarray, " hops"], Float64[np.ndarray, " hops"]]:
    """Log2 of the fundamental in Hz, and 1.0 where the frame is voiced (else 0.0), at 100 Hz."""
    import librosa

    low, high = PITCH_RANGE_HZ
    hops = _num_hops(waveform)
    pitch = np.empty(hops)
    for first in range(0, hops, BLOCK_FRAMES):
        last = min(hops, first + BLOCK_FRAMES)
        windows = _windows(waveform, first, last, PITCH_WINDOW)
        samples = np.concatenate([windows[:, :HOP].ravel(), windows[-1, HOP:]])
        pitch[first:last] = librosa.yin(
            samples, fmin=low, fmax=high, sr=SAMPLE_RATE,
            frame_length=PITCH_WINDOW, hop_length=HOP, center=False,
        )  # fmt: skip
    in_range = (pitch > low * 1.05) & (pitch < high * 0.97)
    steady = np.abs(np.diff(np.log2(pitch), prepend=np.log2(pitch[0]))) < 0.15
    voiced = in_range & steady & (relative_energy > -25.0)
    return np.log2(pitch), voiced.astype(float)


def _average_over_frames(
    columns: Float64[np.ndarray, "hops dim"],
    num_frames: int,
    silence: Float64[np.ndarray, " dim"],
) -> Float64[np.ndarray, "num_frames dim"]:
    """Mean over ``[k / 30, (k + 1) / 30)`` of a signal that is constant over each 10 ms hop."""
    hops_per_second = SAMPLE_RATE / HOP
    needed = int(np.ceil(num_frames / FPS * hops_per_second))
    if needed > len(columns):
        columns = np.concatenate([columns, np.tile(silence, (needed - len(columns), 1))])
    integral = np.concatenate([np.zeros((1, columns.shape[1])), np.cumsum(columns, axis=0)])
    edges = np.arange(num_frames + 1) * (hops_per_second / FPS)
    whole = np.minimum(edges.astype(int), len(columns) - 1)
    at_edges = integral[whole] + (edges - whole)[:, None] * columns[whole]
    return np.diff(at_edges, axis=0) * (FPS / hops_per_second)


def augment_mel(
    features: Float[Tensor, "B T 68"], generator: torch.Generator
) -> Float[Tensor, "B T 68"]:
    """Features as another microphone might have heard them, one draw for each sample.

    Level +-3 dB, a spectral tilt of +-6 dB, sometimes a missing top band, and a floor of coloured
    noise 20 to 60 dB under the speech level. Pitch and voicing stay.
    """
    size = len(features)

    def uniform(low: float, high: float) -> Float[Tensor, "B 1 1"]:
        draw = torch.rand(size, generator=generator)
        return (low + (high - low) * draw)[:, None, None]

    band = torch.linspace(0, 1, NUM_MELS)
    level = features[..., :NUM_MELS] * 20.0 - 40.0  # dB under the speech level
    level = level + uniform(-3.0, 3.0) + uniform(-6.0, 6.0) * 2 * (band - 0.5)
    cut = uniform(0.55, 1.6)  # above 1: nothing is cut
    level = torch.where(band > cut, level - 35.0, level)
    noise = uniform(-75.0, -25.0) + uniform(-10.0, 4.0) * (band - 0.3)
    noisy = 10 * torch.log10(10 ** (level / 10) + 10 ** (noise / 10))
    mel = (noisy.clamp_min(FLOOR_DB) + 40.0) / 20.0
    energy = (features[..., NUM_MELS : NUM_MELS + 1] * 20.0 - 20.0).clamp_min(FLOOR_DB)
    # The floor of the whole band lies about 10 dB above that of one mel.
    energy_floor = noise.mean(-1, keepdim=True) + 10
    energy = 10 * torch.log10(10 ** (energy / 10) + 10 ** (energy_floor / 10))
    energy = (energy + 20.0) / 20.0
    return torch.cat([mel, energy, features[..., NUM_MELS + 1 :]], dim=-1)
