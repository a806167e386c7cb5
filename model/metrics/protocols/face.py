"""Protocols ``mse_face/emage`` and ``lvd/emage``: errors of the vertices of a licensed face."""

import numpy as np

from model.metrics.protocols.clip import Clip, Sums

_FRAMES = 64
"""Frames that are posed at once: 64 of SMPL-X take 16 MB."""


def face_squared_error_sums(clip: Clip) -> Sums:
    """Sum up the squared errors of the coordinates (m^2)."""
    return _face_sums(clip, "mse_m2")


def face_velocity_error_sums(clip: Clip) -> Sums:
    """Sum up the absolute errors of the coordinates' steps to the next frame (m)."""
    return _face_sums(clip, "lvd_m")


def _face_sums(clip: Clip, key: str) -> Sums:
    assert clip.face_vertices and clip.reference and clip.reference.face_vertices
    total = count = 0.0
    last = None
    for start in range(0, len(clip.joints), _FRAMES):
        frames = slice(start, min(start + _FRAMES, len(clip.joints)))
        error = clip.face_vertices(frames).astype(np.float64) - clip.reference.face_vertices(frames)
        if key == "mse_m2":
            total += float(np.square(error).sum())
        else:
            total += float(np.abs(np.diff(error, axis=0)).sum())
            total += 0.0 if last is None else float(np.abs(error[0] - last).sum())
        last, count = error[-1], count + error.size
    return {"count": np.array(count), key: np.array(total)}
