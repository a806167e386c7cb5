"""Can speakers be told apart by motion, and right speech from shifted speech?

Both questions are answered on clips that the classifier or regression has not seen.
"""

from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d
from scipy.signal import stft
from scipy.stats import rankdata

from conventions.rates import FPS, SAMPLE_RATE
from model.speech.audio import SpeechLimits, load_speech
from tools.corpus.report.statistics import LEFT_WRIST, RIGHT_WRIST, PosedClip, derivative

BANDS = 12
LAGS = range(-24, 25, 3)  # frames, 0.8 s either way
RIDGE = 0.1
SOUND_LIMITS = SpeechLimits(max_s=3600)


def area_under_curve(low: Float[np.ndarray, " A"], high: Float[np.ndarray, " B"]) -> float:
    """Probability that a draw of ``high`` exceeds one of ``low``; ties count half."""
    ranks = rankdata(np.concatenate([low, high]))[len(low) :]
    return float((ranks.sum() - len(high) * (len(high) + 1) / 2) / (len(low) * len(high)))


def separability(
    a_train: Float[np.ndarray, "A F"],
    b_train: Float[np.ndarray, "B F"],
    a_test: Float[np.ndarray, "C F"],
    b_test: Float[np.ndarray, "D F"],
) -> float:
    """Area under the curve of a linear discriminant between two people, on other windows."""
    both = np.concatenate([a_train, b_train])
    mean, scale = both.mean(0), both.std(0) + 1e-9
    a, b = (a_train - mean) / scale, (b_train - mean) / scale
    within = 0.5 * (np.cov(a.T) + np.cov(b.T)) + 0.1 * np.eye(a.shape[1])
    direction = np.linalg.solve(within, b.mean(0) - a.mean(0))
    scores = [((x - mean) / scale) @ direction for x in (a_test, b_test)]
    return area_under_curve(*scores)


def sound_features(path: Path, num_frames: int) -> Float[np.ndarray, "T F"]:
    """Standardised log energies of 12 bands at 30 frames a second, with lags of 0.8 s.

    Raises:
        SpeechError: if the sound cannot be used.
    """
    samples = load_speech(path, SOUND_LIMITS).waveform.astype(np.float64)
    hop = SAMPLE_RATE // 100
    _, times, spectrum = stft(samples, SAMPLE_RATE, nperseg=512, noverlap=512 - hop)
    power = np.abs(spectrum) ** 2
    edges = np.unique(np.geomspace(3, power.shape[0] - 1, BANDS + 1).astype(int))
    bands = np.stack([power[a:b].sum(0) for a, b in pairwise(edges)], 1)
    level = gaussian_filter1d(np.log(bands + 1e-8), 1.5, axis=0)
    level = (level - level.mean(0)) / (level.std(0) + 1e-9)
    frame_s = np.arange(num_frames) / FPS
    at_frames = np.stack([np.interp(frame_s, times, band) for band in level.T], 1)
    return np.concatenate([np.roll(at_frames, -lag, axis=0) for lag in LAGS], axis=1)


def hand_speed(clip: PosedClip) -> Float[np.ndarray, " T"]:
    """Standardised speed of both wrists, smoothed over a tenth of a second."""
    speed = sum(derivative(clip.positions[:, wrist], 1) for wrist in (LEFT_WRIST, RIGHT_WRIST))
    smooth = gaussian_filter1d(np.concatenate([[0.0], np.asarray(speed)]), 3.0)
    return (smooth - smooth.mean()) / (smooth.std() + 1e-9)


def ridge_weights(
    features: list[Float[np.ndarray, "_ F"]], targets: list[Float[np.ndarray, " _"]]
) -> Float[np.ndarray, " F"]:
    """Ridge regression over all clips."""
    x, y = np.concatenate(features), np.concatenate(targets)
    return np.linalg.solve(x.T @ x + RIDGE * len(x) * np.eye(x.shape[1]), x.T @ y)


def alignment_scores(
    weights: Float[np.ndarray, " F"],
    features: list[Float[np.ndarray, "_ F"]],
    targets: list[Float[np.ndarray, " _"]],
    shift_s: float,
) -> tuple[Float[np.ndarray, " N"], Float[np.ndarray, " N"]]:
    """Correlation of predicted and true hand speed for each clip: right and shifted speech."""
    shift = round(shift_s * FPS)
    right, shifted = [], []
    for x, y in zip(features, targets, strict=True):
        predicted = x @ weights
        right.append(np.corrcoef(predicted, y)[0, 1])
        shifted.append(np.corrcoef(np.roll(predicted, shift), y)[0, 1])
    return np.array(right), np.array(shifted)
