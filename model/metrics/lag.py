"""Lag of a motion behind its speech, with a confidence interval; unknown if it does not follow it.

Face (expression coefficients and jaw) and sound (mel bands) are high-pass filtered at about a
second and transformed into uncorrelated components of equal variance. Their agreement at a lag is
the sum of all squared correlations between components: nobody has to know which coefficient opens
the mouth. A lag is reported if that sum is far above its values at implausible lags
(`CHANCE_LAG_FRAMES` and more, in a circle), of which a clip has hundreds.

The interval, and the growth of the lag along the clip (`Lag.lag_drift_s`), come from a bootstrap
over the clip's blocks of three seconds.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Float32
from scipy.ndimage import gaussian_filter1d

from conventions.joints import JOINT_INDEX
from conventions.rates import FPS, SAMPLE_RATE
from model.motion.motion import Motion, first_frames
from model.speech.librosa_cache import load_librosa

LagSource = Literal["face", "body", "unknown"]
MOST_LAG_FRAMES = 3 * FPS
CHANCE_LAG_FRAMES = 100
LEAST_FRAMES = 12 * FPS
"""Shortest clip for which a lag is estimated (frames)."""
MIN_Z_SCORE: dict[LagSource, float] = {"face": 6.5, "body": 8.0}
"""Deviations by which the best lag must exceed the mean of implausible lags. Recorded faces of 30 s
have 11 and more, of 15 s from 6; with another speech at most 5.6, bodies 6.1 (600 and 300 pairs of
12 s and more). Recorded bodies have no more with their own speech: they do not show a lag."""
BEYOND_CHANCE = 1.3
"""Smallest ratio of the best lag's agreement to the highest at implausible lags."""
PARTS, BANDS = 6, 12
FINE_FRAMES, LEVEL_FRAMES = 1.0, 8.0
"""Deviations (frames) of the Gaussians that smooth a track, and that compute its level."""
_WINDOW, _FFT, _LOWEST_HZ = 800, 1024, 80.0
_BLOCK_FRAMES, _MAX_BLOCKS, _NEAR, _DRAWS = 3 * FPS, 60, 15, 200
_DRIFT_FRAMES, _DRIFT_STEP, _MIN_DRIFT = 90, 3, 6
_DRIFTING_FROM = 25 * FPS
"""Shortest clip for which a drift is estimated (frames)."""


@dataclass(frozen=True)
class Lag:
    """Delay of a motion relative to its speech; negative if the motion is earlier."""

    lag_s: float
    """Lag in the middle of the clip (s)."""
    lag_low_s: float
    lag_high_s: float
    """95 % interval of the lag over bootstrap draws of the clip's blocks (s)."""
    lag_drift_s: float
    """Growth of the lag from the first to the last frame (s); 0 if it might be chance."""
    lag_corrected_fps: float
    """Frame rate that would compensate for the drift (fps); 30 without drift."""
    lag_source: LagSource
    """Part of the body that follows the speech; if it is unknown, all numbers are NaN."""
    lag_z_score: float
    """Deviations of the best lag's agreement above chance; see `MIN_Z_SCORE`."""

    @property
    def is_detected(self) -> bool:
        return self.lag_source != "unknown"


_NAN = float("nan")
UNKNOWN = Lag(_NAN, _NAN, _NAN, _NAN, _NAN, "unknown", _NAN)


def speech_bands_by_frame(waveform: Float[np.ndarray, " N"]) -> Float32[np.ndarray, "T BANDS"]:
    """Compute log-mel powers around the middle of each motion frame from 16 kHz speech."""
    hop = SAMPLE_RATE / FPS
    count = len(waveform) * FPS // SAMPLE_RATE
    padded = np.pad(np.asarray(waveform, np.float32), (_WINDOW // 2, _WINDOW))
    starts = np.round((np.arange(count) + 0.5) * hop).astype(int)
    filters = load_librosa().filters.mel(sr=SAMPLE_RATE, n_fft=_FFT, n_mels=BANDS, fmin=_LOWEST_HZ)
    taper = np.hanning(_WINDOW)
    power = np.empty((count, BANDS), np.float32)
    for first in range(0, count, 1000):
        windows = padded[starts[first : first + 1000, None] + np.arange(_WINDOW)] * taper
        power[first : first + 1000] = np.abs(np.fft.rfft(windows, _FFT, axis=1)) ** 2 @ filters.T
    floor = 1e-4 * np.median(power.max(axis=1)) if count else 0.0
    return np.log(power + np.float32(floor + 1e-9))


def find_lag(motion: Motion, speech_log_mel: Float[np.ndarray, "T2 BANDS"]) -> Lag:
    """Estimate the lag from the face, else the body; unknown if neither follows this speech."""
    frames = min(motion.num_frames, len(speech_log_mel))
    if frames < LEAST_FRAMES:
        return UNKNOWN
    motion, sound = first_frames(motion, frames), _parts(speech_log_mel[:frames])
    tracks: dict[LagSource, np.ndarray] = {"face": _face(motion), "body": _body(motion)}
    for ground, track in tracks.items():
        moves = _parts(track)
        if moves.shape[1] and sound.shape[1]:
            lag = _lag(moves, sound, ground)
            if lag is not None:
                return lag
    return UNKNOWN


def _face(motion: Motion) -> Float[np.ndarray, "T columns"]:
    jaw = 3 * JOINT_INDEX["jaw"]
    return np.hstack([motion.expressions, 10 * motion.poses[:, jaw : jaw + 3]]).astype(np.float64)


def _body(motion: Motion) -> Float[np.ndarray, "T columns"]:
    """Compute the turning of the head and the arms' speed, which is low at the end of strokes."""
    poses = motion.poses.reshape(motion.num_frames, -1, 3).astype(np.float64)
    turns = np.asarray(np.gradient(poses, axis=0)) * FPS
    head = turns[:, [JOINT_INDEX["neck"], JOINT_INDEX["head"]]].reshape(motion.num_frames, -1)
    arms = [JOINT_INDEX[f"{side}_{j}"] for side in ("left", "right") for j in ("shoulder", "elbow")]
    speeds = np.log(np.linalg.norm(turns[:, arms], axis=-1) + 0.05)
    return np.hstack([each / max(float(each.std()), 1e-3) for each in (head, speeds)])


def _parts(track: Float[np.ndarray, "T columns"]) -> Float[np.ndarray, "T parts"]:
    """Transform a track into up to `PARTS` uncorrelated components of equal variance."""
    fine = gaussian_filter1d(np.asarray(track, np.float64), FINE_FRAMES, axis=0)
    track = fine - gaussian_filter1d(track, LEVEL_FRAMES, axis=0)
    track = track - track.mean(axis=0)
    size, axes = np.linalg.eigh(track.T @ track / len(track))
    size, axes = size[::-1][:PARTS], axes[:, ::-1][:, :PARTS]
    is_there = size > max(1e-6, 1e-6 * size[0])
    return track @ (axes[:, is_there] / np.sqrt(size[is_there]))


def _lag(
    moves: Float[np.ndarray, "T parts"], sound: Float[np.ndarray, "T parts2"], ground: LagSource
) -> Lag | None:
    frames = len(moves)
    shared = _shared_in_a_circle(moves, sound)
    distance = np.abs(np.fft.fftfreq(frames, 1 / frames))
    chance = shared[distance >= CHANCE_LAG_FRAMES]
    products = _products(moves, sound)
    slopes = [0]
    if frames >= _DRIFTING_FROM:
        slopes = list(range(-_DRIFT_FRAMES, _DRIFT_FRAMES + 1, _DRIFT_STEP))
    by_slope = [np.square(_with_drift(products, slope).sum(0)).sum(-1) for slope in slopes]
    scores = np.array(by_slope) / frames
    best = int(scores[len(slopes) // 2].argmax())
    best_slope = len(slopes) // 2
    if scores.max() > 1.1 * scores[best_slope, best]:
        best_slope, best = np.unravel_index(int(scores.argmax()), scores.shape)
    most = scores[best_slope, best]
    stands_out = float((most - chance.mean()) / chance.std())
    if stands_out < MIN_Z_SCORE[ground] or most < BEYOND_CHANCE * chance.max():
        return None
    lags, drifts = _drawn(products, slopes, int(best))
    low, high = np.quantile(lags, (0.025, 0.975)) / FPS
    drift = float(np.median(drifts))
    may_be_none = np.quantile(drifts, 0.025) <= 0 <= np.quantile(drifts, 0.975)
    drift = 0.0 if may_be_none or abs(drift) < _MIN_DRIFT else drift
    return Lag(
        lag_s=float(np.median(lags)) / FPS,
        lag_low_s=float(low),
        lag_high_s=float(high),
        lag_drift_s=drift / FPS,
        lag_corrected_fps=FPS / (1 - drift / frames),
        lag_source=ground,
        lag_z_score=stands_out,
    )


def _shared_in_a_circle(
    moves: Float[np.ndarray, "T parts"], sound: Float[np.ndarray, "T parts2"]
) -> Float[np.ndarray, " T"]:
    """Compute at entry ``lag`` the squared correlations with the sound so many frames before."""
    ours, theirs = np.fft.rfft(moves, axis=0), np.conj(np.fft.rfft(sound, axis=0))
    correlations = np.zeros(len(moves))
    for each in ours.T:
        for other in theirs.T:
            correlations += np.square(np.fft.irfft(each * other, len(moves)))
    return correlations / len(moves)


_REACH = MOST_LAG_FRAMES + _DRIFT_FRAMES // 2


def _products(
    moves: Float[np.ndarray, "T parts"], sound: Float[np.ndarray, "T parts2"]
) -> Float32[np.ndarray, "blocks lags products"]:
    """Compute the products of all components for each block and each lag up to `_REACH`."""
    frames = max(_BLOCK_FRAMES, -(-len(moves) // _MAX_BLOCKS))
    padded = np.pad(sound, ((_REACH, _REACH), (0, 0)))
    products = []
    for first in range(0, len(moves), frames):
        own = moves[first : first + frames]
        around = padded[first : first + len(own) + 2 * _REACH]
        windows = np.lib.stride_tricks.sliding_window_view(around, len(own), axis=0)[::-1]
        products.append(np.einsum("tp,lqt->lpq", own, windows, optimize=True))
    return np.array(products, np.float32).reshape(len(products), 2 * _REACH + 1, -1)


def _with_drift(
    products: Float32[np.ndarray, "blocks reach products"], slope: int
) -> Float32[np.ndarray, "blocks lags products"]:
    """Select products for a lag that grows by ``slope`` frames over the clip."""
    count = len(products)
    places = (np.arange(count) + 0.5) / count - 0.5
    first = np.round(slope * places).astype(int) + _REACH - MOST_LAG_FRAMES
    return np.stack(
        [own[at : at + 2 * MOST_LAG_FRAMES + 1] for own, at in zip(products, first, strict=True)]
    )


def _drawn(
    products: Float32[np.ndarray, "blocks reach products"], slopes: list[int], best: int
) -> tuple[Float[np.ndarray, " draws"], Float[np.ndarray, " draws"]]:
    """Estimate lag and slope (frames) for each bootstrap draw of the blocks."""
    count = len(products)
    draws = np.random.default_rng(0).multinomial(count, np.full(count, 1 / count), _DRAWS)
    draws, first = draws.astype(np.float32), max(0, best - _NEAR)
    near = (_with_drift(products, slope)[:, first : best + _NEAR + 1] for slope in slopes)
    scores = np.stack([np.square(np.tensordot(draws, each, axes=1)).sum(-1) for each in near])
    by_draw = scores.transpose(1, 0, 2).reshape(_DRAWS, -1)
    slope, lag = np.unravel_index(by_draw.argmax(axis=1), scores.shape[::2])
    inner = np.clip(lag, 1, scores.shape[2] - 2)
    left, at, right = (scores[slope, np.arange(_DRAWS), inner + step] for step in (-1, 0, 1))
    bend = left - 2 * at + right
    part = np.where(
        (lag == inner) & (bend < 0), (left - right) / np.where(bend < 0, 2 * bend, 1), 0
    )
    return first + lag + part - MOST_LAG_FRAMES, np.array(slopes, float)[slope]
