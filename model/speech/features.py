"""Log-mel bands, energy, onset strength and pitch of speech at 30 fps, without any weights.

All features are computed at 100 Hz (hop 160; 16000 / 30 is not an integer) and averaged over the
exact span of each motion frame. Blocks bound the memory; results do not depend on their size.

Streamed speech has the same features except for the reference level and pitch: a clip's are
computed from all of it, a live speaker's from the speech so far. Sound is processed in blocks of
100 ms (3 motion frames, 10 hops) with a look-ahead of 27 ms, half of the pitch window.
"""

import hashlib
import threading
from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, Float64
from torch import Tensor

from conventions.rates import FPS, SAMPLE_RATE
from model.speech.librosa_cache import load_librosa

HOP = 160  # 10 ms
WINDOW = 400  # 25 ms of speech under each spectrum
FFT_SIZE = 512
NUM_MELS = 64
LOWEST_MEL_HZ = 50.0
PITCH_WINDOW = 1024  # 64 ms: two periods of 31 Hz
PITCH_RANGE_HZ = (60.0, 420.0)
_HOPS_AT_ONCE = 1000  # 10 s

FLOOR_DB = -80.0
SPEECH_PERCENTILE = 90.0


@dataclass(frozen=True)
class VoiceReference:
    """Level and pitch of a speaker, to which features are relative."""

    level_db: float
    """Level of the loud parts of the speech (dB), comparable to `SpectralHops.energy_db`."""
    log2_pitch_hz: float
    """Median pitch, log2 of Hz."""


@dataclass(frozen=True)
class SpectralHops:
    """Features of sound at 100 Hz, before normalisation by a voice."""

    log_mel: Float64[np.ndarray, "hops mels"]
    """Power per mel band (hops, mels) in dB."""
    energy_db: Float64[np.ndarray, " hops"]
    """Total power (hops,) in dB."""
    log2_pitch_hz: Float64[np.ndarray, " hops"]
    """Log2 of the fundamental frequency in Hz (hops,), meaningful where `is_tonal`."""
    is_tonal: Bool[np.ndarray, " hops"]
    """Mask (hops,) of a steady fundamental within `PITCH_RANGE_HZ`."""

    def voiced(self, level_db: float) -> Bool[np.ndarray, " hops"]:
        """Return a mask (hops,) of tonal hops that are not much quieter than the speech."""
        return self.is_tonal & (self.energy_db - level_db > -25.0)


class MelEncoder:
    """Encoder of 64 log-mels, energy, onset strength, log pitch and voicing: 68 numbers per frame.

    Levels are relative to the clip's speech level (the 90th percentile of its frame energy), so the
    gain of a microphone does not matter.
    """

    name = "mel64"
    dim = NUM_MELS + 4

    def encode(
        self, waveform: Float32[np.ndarray, " N"], num_frames: int
    ) -> Float32[np.ndarray, "num_frames dim"]:
        return self.encode_relative_to(None, waveform, num_frames)

    def encode_relative_to(
        self, voice: VoiceReference | None, waveform: Float32[np.ndarray, " N"], num_frames: int
    ) -> Float32[np.ndarray, "num_frames dim"]:
        """Return the features of `encode` relative to a voice; None uses that of the clip."""
        columns = _clip_columns(waveform) if voice is None else _columns(waveform, voice)
        silence = np.zeros(self.dim)
        silence[:NUM_MELS] = (FLOOR_DB + 40.0) / 20.0
        silence[NUM_MELS] = (FLOOR_DB + 20.0) / 20.0
        return average_over_frames(columns, num_frames, silence).astype(np.float32)


_MAX_CACHED_HOPS = 60_000
"""Size of the cache in hops: ten minutes, 33 MB."""
_cache: OrderedDict[bytes, Float64[np.ndarray, "hops 68"]] = OrderedDict()
_cache_lock = threading.Lock()


def _clip_columns(waveform: Float32[np.ndarray, " N"]) -> Float64[np.ndarray, "hops 68"]:
    """Return features of each hop relative to the clip's voice, cached for the systems of a run."""
    key = hashlib.sha256(waveform.tobytes()).digest()
    with _cache_lock:
        columns = _cache.pop(key, None)
        _cache[key] = columns = _columns(waveform) if columns is None else columns
        while sum(map(len, _cache.values())) > _MAX_CACHED_HOPS:
            _cache.popitem(last=False)
    return columns


def _columns(
    waveform: Float32[np.ndarray, " N"], voice: VoiceReference | None = None
) -> Float64[np.ndarray, "hops 68"]:
    hops = analyse_hops(waveform, 0, max(1, -(-len(waveform) // HOP)))
    return hop_features(hops, voice or _voice_of(hops))


def analyse_hops(waveform: Float32[np.ndarray, " N"], first: int, last: int) -> SpectralHops:
    """Analyse hops ``first`` to ``last - 1``, with silence outside the waveform.

    The steadiness of the first hop's pitch is unknown; it counts as steady.
    """
    decibels = _by_blocks(waveform, first, last, FFT_SIZE, _mel_power_db)
    log_mel, energy = decibels[:, :NUM_MELS], decibels[:, NUM_MELS]
    hz = _by_blocks(waveform, first, last, PITCH_WINDOW, _fundamental)
    low, high = PITCH_RANGE_HZ
    in_range = (hz > low * 1.05) & (hz < high * 0.97)
    pitch = np.log2(hz)
    is_steady = np.abs(np.diff(pitch, prepend=pitch[0])) < 0.15
    return SpectralHops(log_mel, energy, pitch, in_range & is_steady)


def hop_features(hops: SpectralHops, voice: VoiceReference) -> Float64[np.ndarray, "hops 68"]:
    """Normalise hops by a voice; the onset strength of the first is unknown, and 0."""
    log_mel = np.maximum(hops.log_mel - voice.level_db, FLOOR_DB)
    energy = np.maximum(hops.energy_db - voice.level_db, FLOOR_DB)
    voiced = hops.voiced(voice.level_db).astype(float)
    onset = np.zeros_like(energy)
    onset[1:] = np.maximum(np.diff(log_mel, axis=0), 0).mean(1)
    return np.concatenate(
        [
            (log_mel + 40.0) / 20.0,
            (energy[:, None] + 20.0) / 20.0,
            onset[:, None] / 3.0,
            np.clip(2.0 * (hops.log2_pitch_hz - voice.log2_pitch_hz) * voiced, -2.5, 2.5)[:, None],
            voiced[:, None],
        ],
        axis=1,
    )


def _voice_of(hops: SpectralHops) -> VoiceReference:
    level_db = float(np.percentile(hops.energy_db, SPEECH_PERCENTILE))
    voiced = hops.voiced(level_db)
    return VoiceReference(
        level_db, float(np.median(hops.log2_pitch_hz[voiced])) if voiced.any() else 0.0
    )


def _padded_samples(
    waveform: Float32[np.ndarray, " N"], first: int, last: int, size: int
) -> Float32[np.ndarray, " samples"]:
    """Return the samples under windows of ``size`` centred on hops ``first .. last - 1``.

    Outside the waveform there is silence.
    """
    start = first * HOP + HOP // 2 - size // 2
    stop = (last - 1) * HOP + HOP // 2 - size // 2 + size
    piece = np.zeros(stop - start, np.float32)
    inside = waveform[max(start, 0) : max(stop, 0)]
    piece[max(-start, 0) : max(-start, 0) + len(inside)] = inside
    return piece


def _by_blocks(
    waveform: Float32[np.ndarray, " N"],
    first: int,
    last: int,
    size: int,
    analyse: Callable[[Float32[np.ndarray, " samples"]], Float[np.ndarray, " hops *numbers"]],
) -> Float64[np.ndarray, " hops *numbers"]:
    """Analyse windows of ``size`` samples in blocks of hops, and concatenate the results."""
    parts = [
        analyse(_padded_samples(waveform, start, min(last, start + _HOPS_AT_ONCE), size))
        for start in range(first, last, _HOPS_AT_ONCE)
    ]
    return np.concatenate(parts).astype(np.float64)


def _mel_power_db(piece: Float32[np.ndarray, " samples"]) -> Float32[np.ndarray, "hops 65"]:
    """Compute the power in mel bands (Slaney's scale) and of the whole spectrum, in dB."""
    spectrum = load_librosa().stft(
        piece, n_fft=FFT_SIZE, hop_length=HOP, win_length=WINDOW, center=False,
        window=np.hanning(WINDOW).astype(np.float32),
    )  # fmt: skip
    power = np.abs(spectrum) ** 2
    mels = load_librosa().feature.melspectrogram(
        S=power, sr=SAMPLE_RATE, n_fft=FFT_SIZE, n_mels=NUM_MELS, fmin=LOWEST_MEL_HZ
    )
    return 10 * np.log10(np.concatenate([mels + 1e-8, power.sum(axis=0)[None] + 1e-6])).T


def _fundamental(piece: Float32[np.ndarray, " samples"]) -> Float64[np.ndarray, " hops"]:
    """Estimate each hop's pitch (Hz), voiced or not (YIN, de Cheveigne and Kawahara, JASA 2002)."""
    low, high = PITCH_RANGE_HZ
    return load_librosa().yin(
        piece, fmin=low, fmax=high, sr=SAMPLE_RATE,
        frame_length=PITCH_WINDOW, hop_length=HOP, center=False,
    )  # fmt: skip


def average_over_frames(
    hop_vectors: Float64[np.ndarray, "hops dim"],
    num_frames: int,
    silence: Float64[np.ndarray, " dim"],
) -> Float64[np.ndarray, "num_frames dim"]:
    """Average over ``[k / 30, (k + 1) / 30)`` a signal that is constant over each 10 ms hop."""
    hops_per_second = SAMPLE_RATE / HOP
    needed = int(np.ceil(num_frames / FPS * hops_per_second))
    if needed > len(hop_vectors):
        hop_vectors = np.concatenate(
            [hop_vectors, np.tile(silence, (needed - len(hop_vectors), 1))]
        )
    integral = np.concatenate([np.zeros((1, hop_vectors.shape[1])), np.cumsum(hop_vectors, axis=0)])
    edges = np.arange(num_frames + 1) * (hops_per_second / FPS)
    whole = np.minimum(edges.astype(int), len(hop_vectors) - 1)
    at_edges = integral[whole] + (edges - whole)[:, None] * hop_vectors[whole]
    return np.diff(at_edges, axis=0) * (FPS / hops_per_second)


BLOCK_FRAMES = 3
BLOCK_SAMPLES = BLOCK_FRAMES * SAMPLE_RATE // FPS
LOOK_AHEAD = PITCH_WINDOW // 2 - HOP // 2
"""Number of samples after a block that its features need."""
_NUM_PAST_HOPS = PITCH_WINDOW // HOP
"""Number of earlier hops under the first hop's window, and one more for its onset strength."""


class RunningVoice:
    """Running estimate of the voice from the last half minute of voiced sound.

    It starts with half a second of a typical voice, so that the first word is at a normal level.
    """

    WINDOW_HOPS = 3000
    START_HOPS = 50
    START = VoiceReference(level_db=28.0, log2_pitch_hz=7.3)
    """Typical voice: loud parts at -18 dB of full scale; 158 Hz."""
    QUIETEST_DB = 0.0
    """Lowest speech level, -46 dB of full scale: quieter sound stays quiet at any length."""
    PERCENTILE = 85.0
    """Percentile over voiced hops; about `SPEECH_PERCENTILE` over all hops with pauses."""

    def __init__(self) -> None:
        start = (
            [self.START.level_db] * self.START_HOPS,
            [self.START.log2_pitch_hz] * self.START_HOPS,
        )
        self._energy = deque(start[0], maxlen=self.WINDOW_HOPS)
        self._pitch = deque(start[1], maxlen=self.WINDOW_HOPS)
        self._voice = self.START

    def update(self, hops: SpectralHops) -> VoiceReference:
        """Update the estimate with the next hops, and return it."""
        voiced: Bool[np.ndarray, " hops"] = hops.voiced(self._voice.level_db)
        if voiced.any():
            self._energy.extend(hops.energy_db[voiced].tolist())
            self._pitch.extend(hops.log2_pitch_hz[voiced].tolist())
            level_db = float(np.percentile(self._energy, self.PERCENTILE))
            pitch = float(np.median(self._pitch))
            self._voice = VoiceReference(max(level_db, self.QUIETEST_DB), pitch)
        return self._voice


class StreamingMelEncoder:
    """Streaming `MelEncoder` for sound that arrives in blocks; past features never change."""

    def __init__(self) -> None:
        self._voice = RunningVoice()
        self._sound = np.zeros(0, np.float32)
        self._first_hop = 0
        """Index of the first hop in the buffer."""
        self._next_hop = 0

    def add_samples(self, samples: Float32[np.ndarray, " N"]) -> Float32[np.ndarray, "frames 68"]:
        """Append samples (N,) at 16 kHz, mono, and return the features of completed frames."""
        self._sound = np.concatenate([self._sound, samples])
        there = self._first_hop * HOP + len(self._sound)
        blocks = (there - LOOK_AHEAD) // BLOCK_SAMPLES - self._next_hop * HOP // BLOCK_SAMPLES
        rows = [self._next_block() for _ in range(blocks)]
        none = np.zeros((0, MelEncoder.dim), np.float32)
        return np.concatenate([none, *rows])

    def _next_block(self) -> Float32[np.ndarray, "3 68"]:
        hops = BLOCK_SAMPLES // HOP
        start = self._next_hop - self._first_hop
        before = min(1, start)  # for the onset and the steadiness of the first new hop
        block = analyse_hops(self._sound, start - before, start + hops)
        new = SpectralHops(*(values[before:] for values in vars(block).values()))
        columns = hop_features(block, self._voice.update(new))[before:]
        self._next_hop += hops
        self._drop_before(self._next_hop - _NUM_PAST_HOPS)
        silence = np.zeros(MelEncoder.dim)  # none is needed: a block's hops are its frames'
        return average_over_frames(columns, BLOCK_FRAMES, silence).astype(np.float32)

    def _drop_before(self, hop: int) -> None:
        if hop > self._first_hop:
            self._sound = self._sound[(hop - self._first_hop) * HOP :]
            self._first_hop = hop


def simulate_microphone(
    features: Float[Tensor, "B T 68"], generator: torch.Generator
) -> Float[Tensor, "B T 68"]:
    """Simulate another microphone in the features, with one draw per sample.

    Level +-3 dB, a spectral tilt of +-6 dB, sometimes a missing top band, and a floor of coloured
    noise 20 to 60 dB below the speech level. Pitch and voicing are unchanged.
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


def vocal_tract_perturbation(
    features: Float[Tensor, "B T 68"], factor_range: tuple[float, float], generator: torch.Generator
) -> Float[Tensor, "B T 68"]:
    """Stretch the mel bands by one factor per sample in ``factor_range``; pitch and energy stay.

    This is vocal tract length perturbation (Jaitly and Hinton 2013).
    """
    lowest, highest = factor_range
    draw = torch.rand(len(features), 1, generator=generator)
    factor = lowest + (highest - lowest) * draw
    at = (torch.arange(NUM_MELS) * factor).clamp(0, NUM_MELS - 1)
    below = at.long().clamp(max=NUM_MELS - 2)
    share = (at - below)[:, None]
    level = features[..., :NUM_MELS]
    low, high = (
        level.gather(2, place[:, None].expand(-1, level.shape[1], -1))
        for place in (below, below + 1)
    )
    return torch.cat([low + share * (high - low), features[..., NUM_MELS:]], dim=-1)
