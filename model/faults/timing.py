"""A motion that is the reference, or is late or early against it or against the speech."""

import numpy as np
from jaxtyping import Float

from conventions.joints import JOINT_INDEX, UPPER_BODY
from conventions.rates import FPS, SAMPLE_RATE
from model.faults.evidence import BODY, Evidence, Finding

SAME_RAD = 1e-5
MOST_LAG_FRAMES = 3 * FPS
LEAST_LAG_FRAMES = 3
COPY_CORRELATION = 0.85
"""Of upper body speeds at the best lag; a copy has 1."""
JAW_LAG_FRAMES = 4
"""Clean: jaws follow the sound by no more than a frame."""
JAW_PEAK = 5.5
"""Deviations by which the best lag of jaw and loudness stands out of the other lags; clean, and at
the right time: 5.7 to 13.6 where the jaw follows the sound at all. Jaws that do not: 3.9 at most.
"""
LEVEL_FRAMES = 61
_LEAST_FRAMES = 10 * FPS


def loudness_of(waveform: Float[np.ndarray, " N"]) -> Float[np.ndarray, " T"]:
    """Logarithm of the root mean square of each thirtieth of a second of 16 kHz speech."""
    count = int(len(waveform) / SAMPLE_RATE * FPS)
    edges = np.round(np.arange(count + 1) * SAMPLE_RATE / FPS).astype(int)
    energy = np.add.reduceat(np.square(waveform, dtype=np.float64), edges[:-1]) if count else []
    return np.log(np.sqrt(np.asarray(energy) / (SAMPLE_RATE / FPS)) + 1e-3)


def identical(evidence: Evidence) -> list[Finding]:
    if evidence.reference is None:
        return []
    own, theirs = evidence.motion, evidence.reference.motion
    apart = np.abs(own.poses - theirs.poses).reshape(-1, 55, 3)[:, list(BODY)]
    if apart.max() > SAME_RAD or np.abs(own.trans - theirs.trans).max() > SAME_RAD:
        return []
    return [
        Finding(
            "identical",
            "This is the reference: every joint is the same in every frame.",
            {"largest_difference_rad": float(apart.max())},
        )
    ]


def shifted_reference(evidence: Evidence) -> list[Finding]:
    """The reference's own movement, earlier or later."""
    if evidence.reference is None or evidence.num_frames < _LEAST_FRAMES:
        return []
    own, theirs = (
        each.turning_deg_s[:, list(UPPER_BODY)].mean(axis=1)
        for each in (evidence, evidence.reference)
    )
    by_lag = _correlations(own, theirs)
    lag = int(by_lag.argmax()) - MOST_LAG_FRAMES
    best = float(by_lag.max())
    if abs(lag) < LEAST_LAG_FRAMES or best < COPY_CORRELATION:
        return []
    return [
        Finding(
            "time_shift",
            f"This moves as the reference does, {abs(lag) / FPS:.2f} s"
            f" {'later' if lag > 0 else 'earlier'}: their speeds then correlate with {best:.2f}.",
            {"against": "reference", "lag_frames": lag, "correlation": best},
            excess=abs(lag) / LEAST_LAG_FRAMES,
        )
    ]


def shifted_speech(evidence: Evidence) -> list[Finding]:
    """The jaw's opening beside the loudness of the speech, both less their level of two seconds."""
    if evidence.loudness is None or evidence.num_frames < _LEAST_FRAMES:
        return []
    frames = min(evidence.num_frames, len(evidence.loudness))
    jaw = evidence.motion.poses.reshape(-1, 55, 3)[:frames, JOINT_INDEX["jaw"], 0]
    if frames < _LEAST_FRAMES or jaw.std() < 1e-4:
        return []
    loud = np.convolve(evidence.loudness[:frames], np.ones(3) / 3, "same")
    by_lag = _correlations(_less_level(jaw), _less_level(loud))
    best = int(by_lag.argmax())
    lag = best - MOST_LAG_FRAMES
    others = by_lag[np.abs(np.arange(len(by_lag)) - best) > FPS // 2]
    peak = float((by_lag[best] - others.mean()) / max(float(others.std()), 1e-9))
    if abs(lag) < JAW_LAG_FRAMES or peak < JAW_PEAK:
        return []
    return [
        Finding(
            "time_shift",
            f"The jaw is {abs(lag) / FPS:.2f} s {'behind' if lag > 0 else 'ahead of'} the speech:"
            f" there its opening fits the loudness best (correlation {by_lag[best]:.2f}, against"
            f" {by_lag[MOST_LAG_FRAMES]:.2f} as it is).",
            {"against": "speech", "lag_frames": lag, "correlation": float(by_lag[best])},
            excess=abs(lag) / JAW_LAG_FRAMES,
        )
    ]


def _less_level(track: Float[np.ndarray, " N"]) -> Float[np.ndarray, " N"]:
    return track - np.convolve(track, np.ones(LEVEL_FRAMES) / LEVEL_FRAMES, "same")


def _correlations(
    late: Float[np.ndarray, " N"], early: Float[np.ndarray, " N"]
) -> Float[np.ndarray, " lags"]:
    """Entry ``MOST_LAG_FRAMES + lag``: how ``late`` goes with ``early`` that many frames before."""
    found = []
    for lag in range(-MOST_LAG_FRAMES, MOST_LAG_FRAMES + 1):
        a, b = (late[lag:], early[: len(early) - lag]) if lag >= 0 else (late[:lag], early[-lag:])
        is_flat = a.std() < 1e-12 or b.std() < 1e-12
        found.append(0.0 if is_flat else float(np.corrcoef(a, b)[0, 1]))
    return np.array(found)
