"""The first picture of a video as a small file: what a page shows until the video has come."""

from __future__ import annotations

import subprocess
from pathlib import Path

POSTER_SUFFIX = ".jpg"
WIDTH_PX = 240
_QUALITY = 4
"""Of ffmpeg's JPEG, from 2, the best, to 31."""


def write_poster(video: Path, out: Path) -> None:
    """
    Raises:
        VideoError: if ffmpeg cannot read what this program has drawn.
    """
    from processes.ended import Ended
    from renderer.video.encoder import VideoError, ffmpeg_path

    command = [
        *(ffmpeg_path(), "-hide_banner", "-loglevel", "error", "-nostats", "-y"),
        *("-i", str(video), "-frames:v", "1", "-vf", f"scale={WIDTH_PX}:-2"),
        *("-q:v", str(_QUALITY), "-f", "mjpeg", str(out)),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        end, said = Ended(done.returncode).how, done.stderr.strip() or "it said nothing"
        raise VideoError(
            f"The picture of {video.name} cannot be written: ffmpeg ended {end}; {said}"
        )
