"""How quiet a body is: 1 while it listens, 0 while it speaks."""

import numpy as np
from jaxtyping import Float

from tools.corpus.body.signals import minimum_jerk
from tools.corpus.words.prosody import Utterance

SETTLES_S = (0.2, 1.1)  # after the last word
WAKES_S = (0.6, 0.0)  # before the next


def quiet(utterance: Utterance, time_s: Float[np.ndarray, " T"]) -> Float[np.ndarray, " T"]:
    """0 to 1: the body settles when it begins to listen, and wakes shortly before it speaks."""
    level = np.zeros(len(time_s))
    for span in utterance.listening:
        rise, fall = np.ones(len(time_s)), np.zeros(len(time_s))
        if span.start_s > 0:
            begin, end = SETTLES_S
            rise = minimum_jerk((time_s - span.start_s - begin) / (end - begin))
        if span.end_s < utterance.duration_s:
            begin, end = WAKES_S
            fall = minimum_jerk((time_s - span.end_s + begin) / (begin - end))
        level += rise - fall
    return np.clip(level, 0.0, 1.0)
