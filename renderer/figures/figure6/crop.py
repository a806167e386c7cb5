"""Cutting empty margins off snapshots so that they can still be compared."""

import numpy as np
from jaxtyping import Bool, UInt8

_MARGIN = 0.03  # around the content, as a share of its longer side


def crop_alike(
    snapshots: dict[str, UInt8[np.ndarray, "N H W 3"]], tolerance: int = 10
) -> dict[str, UInt8[np.ndarray, "N h w 3"]]:
    """Every picture cut to one size; the cut is at one place in all pictures of a frame.

    So bodies keep their size everywhere and their place among the systems, while one who walks
    stays in the middle from frame to frame. The size is what the largest frame needs. The
    background is what pictures show at their left and right edge, row by row: a plain wall, a
    vertical gradient and a plain floor all count as empty. Empty pictures keep their whole frame.

    Args:
        tolerance: largest difference from the background, of 255, that still counts as empty.
    """
    has_content = _content(list(snapshots.values()), tolerance)
    top, bottom = _extents(np.asarray(has_content.any(axis=2)))
    left, right = _extents(np.asarray(has_content.any(axis=1)))
    _, height, width = has_content.shape
    margin = 1 + round(_MARGIN * max(np.max(bottom - top), np.max(right - left)))
    rows = _windows(top, bottom, margin, height)
    columns = _windows(left, right, margin, width)
    return {
        name: np.stack(
            [picture[r, c] for picture, r, c in zip(pictures, rows, columns, strict=True)]
        )
        for name, pictures in snapshots.items()
    }


def _content(
    stacks: list[UInt8[np.ndarray, "N H W 3"]], tolerance: int
) -> Bool[np.ndarray, "N H W"]:
    """Where at least one system's picture of a frame differs from the background."""
    edges = np.stack([stack[:, :, [0, -1]] for stack in stacks])  # (systems, N, H, 2, 3)
    background = np.median(edges, axis=(0, 1, 3)).astype(np.int16)[None, :, None]
    has_content = np.zeros(stacks[0].shape[:3], dtype=bool)
    for stack in stacks:
        has_content |= (np.abs(stack - background) > tolerance).any(axis=-1)
    return has_content


def _extents(has_content: Bool[np.ndarray, "N L"]) -> tuple[np.ndarray, np.ndarray]:
    """First and one past the last place with content, per frame; all of it where there is none."""
    length = has_content.shape[1]
    is_empty = ~has_content.any(axis=1)
    first = np.where(is_empty, 0, has_content.argmax(axis=1))
    end = np.where(is_empty, length, length - has_content[:, ::-1].argmax(axis=1))
    return first, end


def _windows(first: np.ndarray, end: np.ndarray, margin: int, length: int) -> list[slice]:
    """Windows of one size around the content, moved where they would leave the picture."""
    size = min(length, int((end - first).max()) + 2 * margin)
    starts = np.clip((first + end - size) // 2, 0, length - size)
    return [slice(int(start), int(start) + size) for start in starts]
