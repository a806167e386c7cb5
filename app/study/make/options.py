"""What an export may be told besides the plan."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from app.config import BUNDLED_WEIGHTS
from app.run.videos.videos import PARALLEL_VIDEOS
from processes.pool import JobPool


@dataclass(frozen=True)
class ExportOptions:
    """What does not change what the study is."""

    weights: Path = BUNDLED_WEIGHTS
    body: Path | None = None
    """A licensed SMPL-X npz; None is the open body."""
    parallel: int = PARALLEL_VIDEOS
    """Videos drawn at once."""
    pool: JobPool | None = None
    """Who makes the clips, several at once; None makes one after the other, here."""
