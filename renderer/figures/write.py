"""Figure 6 by the name that its callers import it by."""

from renderer.figures.figure6.figure6 import (
    WINDOW_FRAMES,
    JointMarks,
    choose_snapshot_frames,
    figure6,
)

__all__ = ["WINDOW_FRAMES", "JointMarks", "choose_snapshot_frames", "figure6"]
