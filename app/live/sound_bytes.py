"""Sound that comes from a browser during a live session: 16-bit numbers of 16 kHz mono.

What goes back is in `app.run.pieces`.
"""

from __future__ import annotations

import numpy as np

from app.errors import RunError

MAX_SOUND_BYTES = 32_000
"""Of one message: a second."""


def read_sound(content: bytes) -> np.ndarray:
    """Samples between -1 and 1.

    Raises:
        RunError: if these are no such bytes, or more than a second of sound.
    """
    if not content or len(content) % 2:
        raise RunError("The sound that came is damaged; start again.")
    if len(content) > MAX_SOUND_BYTES:
        raise RunError(
            f"A block of sound has {len(content)} bytes; at most {MAX_SOUND_BYTES} are taken."
        )
    return np.frombuffer(content, "<i2").astype(np.float32) / 32_768
