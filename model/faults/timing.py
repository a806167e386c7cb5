"""A motion that is the reference, or is late or early against it or against the speech."""

from collections.abc import Iterator

import numpy as np

from conventions.joints import UPPER_BODY
from conventions.rates import FPS
from model.faults.evidence import BODY, Evidence, Finding
from model.measures.face import correlation

SAME_RAD = 1e-5
MOST_LAG_FRAMES = 3 * FPS
LEAST_LAG_FRAMES = 3
COPY_CORRELATION = 0.85
"""Of upper body speeds at the best lag; a copy has 1."""
LEAST_SPEECH_LAG_FRAMES = 4
"""Clean: faces are within a frame of the sound."""
_LEAST_FRAMES = 10 * FPS


def identical(evidence: Evidence) -> Iterator[Finding]:
    if evidence.reference is None:
        return
    own, theirs = evidence.motion, evidence.reference.motion
    apart = np.abs(own.poses - theirs.poses).reshape(-1, 55, 3)[:, list(BODY)]
    if apart.max() > SAME_RAD or np.abs(own.trans - theirs.trans).max() > SAME_RAD:
        return
    yield Finding(
        "This is the reference: every joint is the same in every frame.",
        {"largest_difference_rad": float(apart.max())},
    )


def shifted_reference(evidence: Evidence) -> Iterator[Finding]:
    """The reference's own movement, earlier or later."""
    if evidence.reference is None or evidence.num_frames < _LEAST_FRAMES:
        return
    own, theirs = (
        each.turning_deg_s[:, list(UPPER_BODY)].mean(axis=1)
        for each in (evidence, evidence.reference)
    )
    lags = range(-MOST_LAG_FRAMES, MOST_LAG_FRAMES + 1)
    best, lag = max((correlation(own, theirs, lag), lag) for lag in lags)
    if abs(lag) < LEAST_LAG_FRAMES or best < COPY_CORRELATION:
        return
    yield Finding(
        f"This moves as the reference does, {abs(lag) / FPS:.2f} s"
        f" {'later' if lag > 0 else 'earlier'}: their speeds then correlate with {best:.2f}.",
        {"against": "reference", "lag_frames": lag, "correlation": best},
        excess=abs(lag) / LEAST_LAG_FRAMES,
    )


def shifted_speech(evidence: Evidence) -> Iterator[Finding]:
    """Late or early all along, or more and more."""
    lag = evidence.raw.lag
    if lag is None or not lag.is_known:
        return
    is_apart = min(abs(lag.lag_low_s), abs(lag.lag_high_s)) * FPS >= LEAST_SPEECH_LAG_FRAMES - 0.5
    if not lag.lag_drift_s and not (is_apart and lag.lag_low_s * lag.lag_high_s > 0):
        return
    numbers = {"against": "speech", "lag_frames": round(lag.lag_s * FPS), **vars(lag)}
    why = f"there its {lag.lag_ground} fits the speech best"
    if not lag.lag_drift_s:
        most_s = lag.lag_s
        sentence = (
            f"This seems {_apart(lag.lag_s)}: {why} (between {lag.lag_low_s:.2f} and"
            f" {lag.lag_high_s:.2f} s); --assume lag={lag.lag_s:.2f} moves it there."
        )
    else:
        most_s = lag.lag_drift_s
        start, end = (lag.lag_s + sign * lag.lag_drift_s / 2 for sign in (-1, 1))
        sentence = (
            f"This drifts against the speech, {_apart(start)} at its start and {_apart(end)} at its"
            f" end: {why}, as with {lag.lag_rate:.4g} frames a second that are taken for {FPS};"
            f" --assume rate={lag.lag_rate:.4g} makes up for it."
        )
    excess = abs(most_s) * FPS / LEAST_SPEECH_LAG_FRAMES
    yield Finding(sentence, numbers, excess)


def _apart(lag_s: float) -> str:
    return f"{abs(lag_s):.2f} s {'late' if lag_s > 0 else 'early'}"
