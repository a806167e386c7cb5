"""Encoding of frames to browser-playable files (H.264 yuv420p, AAC) with ffmpeg in a child process.

The ffmpeg binary comes inside the ``imageio-ffmpeg`` wheel. A file gets its final name only when it
is complete; until then it has a partial name in the same folder.
"""

import fcntl
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TypeVar

import imageio_ffmpeg
import numpy as np
from jaxtyping import UInt8

from conventions.rates import FPS
from processes.exit_report import ExitReport
from processes.job import Cancelled

DEFAULT_CRF = 20
PIPE_BYTES = 1 << 20
"""Size of the pipe to ffmpeg: a whole frame fits, so that writing does not wait for ffmpeg."""


class VideoError(RuntimeError):
    """Error for a video that cannot be made; the message says why in one sentence."""


def partial_path(out: Path, process_id: int) -> Path:
    """Return the path of ``out`` while a process has not completed it."""
    return out.with_name(f".{out.stem}.{process_id}.part{out.suffix}")


def check_video_size(width: int, height: int) -> None:
    """Check that sizes are positive and, as yuv420p halves them, even; raises ValueError."""
    if width < 2 or height < 2 or width % 2 or height % 2:
        raise ValueError(
            f"A video of {width} x {height} pixels cannot be encoded; width and height must be "
            "even and at least 2."
        )


def ffmpeg_path() -> str:
    """Return the path of the ffmpeg binary; raises VideoError if there is none."""
    try:
        path = imageio_ffmpeg.get_ffmpeg_exe()
    except RuntimeError as error:
        raise VideoError("No ffmpeg was found; install it with: pip install imageio-ffmpeg") from (
            error
        )
    if shutil.which(path) is None:  # from IMAGEIO_FFMPEG_EXE, which is not checked
        raise VideoError(
            f"{path} is not an ffmpeg program that can be run; unset IMAGEIO_FFMPEG_EXE."
        )
    return path


def run_ffmpeg(*arguments: str, log_level: str = "error") -> str:
    """Run ffmpeg; return its output, or messages at ``log_level`` "info"; raises VideoError."""
    run = subprocess.run(
        [ffmpeg_path(), "-hide_banner", "-nostats", "-loglevel", log_level, "-y", *arguments],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        check=False,
    )
    messages = run.stderr.decode(errors="replace").strip()
    if run.returncode:
        last = " ".join(messages.split())[-300:] or "none"
        end = ExitReport(run.returncode).exit_text
        raise VideoError(f"ffmpeg ended {end}; its last message: {last}")
    return messages if log_level == "info" else run.stdout.decode(errors="replace")


@dataclass(frozen=True)
class VideoInfo:
    """Properties of a video that must agree between videos shown together."""

    width: int
    height: int
    num_frames: int


def probe_video(video: Path) -> VideoInfo:
    """Read size and number of frames, by counting packets; raises VideoError if it has none."""
    copied = ("-map", "0:v:0", "-c", "copy", "-f", "null", "-")
    try:
        output = run_ffmpeg("-stats", "-i", str(video), *copied, log_level="info")
    except VideoError as error:
        raise VideoError(f"{video} cannot be read as a video: {error}") from error
    size = re.search(r"Video: .*?, (\d+)x(\d+)[ ,]", output)
    counts = re.findall(r"frame=\s*(\d+)", output)
    if size is None or not counts:
        raise VideoError(f"{video} cannot be read as a video.")
    return VideoInfo(int(size[1]), int(size[2]), int(counts[-1]))


Own = TypeVar("Own", bound="Encoder")
"""An encoder or a subclass; the check of shapes refuses ``typing.Self`` in a method."""


class Encoder:
    """Run of ffmpeg that makes one mp4 of ``num_frames`` frames at 30 fps, or no file.

    Use it in ``with``. Leaving the block normally completes the file; leaving it by an exception
    ends ffmpeg and leaves no file.
    """

    def __init__(
        self,
        out: Path,
        inputs: Sequence[str],
        filters: Sequence[str],
        num_frames: int,
        speech_wav: Path | None = None,
        crf: int = DEFAULT_CRF,
    ) -> None:
        """Prepare ffmpeg's command line.

        Args:
            inputs, filters: arguments of ffmpeg for the picture.
            speech_wav: sound from the first frame on; cut or padded with silence to the frames.
            crf: x264's constant quality; lower is better and larger.

        Raises:
            VideoError: if the sound file is missing.
        """
        if speech_wav is not None and not speech_wav.is_file():
            raise VideoError(f"The sound file of the video does not exist: {speech_wav}.")
        self.out = out.absolute()
        self._num_frames = num_frames
        self._partial = partial_path(self.out, os.getpid())
        exact_s = f"{num_frames / FPS:.6f}"
        sound = (
            *("-map", f"{inputs.count('-i')}:a:0"),
            # Sound that starts late or has gaps by its time stamps stays in time with the picture.
            *(
                "-af",
                f"aresample=async=1:min_comp=0.1:first_pts=0,apad=whole_dur={exact_s},"
                f"atrim=end={exact_s}",
                "-c:a",
                "aac",
            ),
            *("-b:a", "128k"),
        )
        self._arguments = [
            *inputs,
            *(("-i", str(speech_wav)) if speech_wav else ()),
            *filters,
            *("-c:v", "libx264", "-preset", "veryfast", "-crf", str(crf), "-pix_fmt", "yuv420p"),
            # A key frame each second: the page scrubs through the videos in lock-step.
            *("-g", str(FPS), "-frames:v", str(num_frames), "-r", str(FPS)),
            # Without these tags each player guesses how to turn yuv420p back into colours.
            *("-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "bt709"),
            *(sound if speech_wav else ("-an",)),
            *("-movflags", "+faststart"),
        ]
        self._messages: IO[bytes]
        self._process: subprocess.Popen[bytes]

    def __enter__(self: Own) -> Own:
        """Start ffmpeg; raises VideoError if there is no ffmpeg, or the folder does not exist."""
        if not self.out.parent.is_dir():
            raise VideoError(f"The video cannot be written: {self.out.parent} is not a folder.")
        command = [
            *(ffmpeg_path(), "-hide_banner", "-loglevel", "error", "-nostats", "-y"),
            *("-progress", "pipe:1", "-stats_period", "0.2", *self._arguments, str(self._partial)),
        ]
        is_fed = "pipe:0" in self._arguments
        self._messages = tempfile.TemporaryFile()
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE if is_fed else subprocess.DEVNULL,
            stdout=subprocess.DEVNULL if is_fed else subprocess.PIPE,
            stderr=self._messages,
        )
        if self._process.stdin is not None:
            with suppress(OSError):  # the system may not allow such a large pipe
                fcntl.fcntl(self._process.stdin, fcntl.F_SETPIPE_SZ, PIPE_BYTES)
        return self

    def wait_with_progress(
        self, on_progress: Callable[[float], None], should_cancel: Callable[[], bool]
    ) -> None:
        """Report the finished share until ffmpeg ends; raises Cancelled on ``should_cancel``."""
        assert self._process.stdout is not None
        for line in self._process.stdout:
            key, _, value = line.decode(errors="replace").strip().partition("=")
            if key == "frame" and value.isdigit():
                if should_cancel():
                    raise Cancelled(f"Composing {self.out.name} was cancelled.")
                on_progress(min(int(value) / self._num_frames, 1.0))

    def __exit__(self, kind: type[BaseException] | None, *rest: object) -> None:
        """Complete the file; remove it after an exception, or if ffmpeg failed (VideoError)."""
        if kind is not None:
            self._abort()
            return
        try:
            if self._process.stdin is not None:
                self._process.stdin.close()
        except OSError as error:
            raise self._failure() from error
        if self._process.wait() != 0:
            raise self._failure()
        self._messages.close()
        try:
            os.replace(self._partial, self.out)
        except OSError as error:
            self._partial.unlink(missing_ok=True)
            raise VideoError(
                f"{self.out.name} cannot be written: {error.strerror}; choose another name."
            ) from error

    def _abort(self) -> None:
        """Kill ffmpeg and remove the file."""
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            with suppress(OSError):  # bytes that can no longer be delivered
                if pipe is not None:
                    pipe.close()
        self._messages.close()
        self._partial.unlink(missing_ok=True)

    def _failure(self) -> VideoError:
        """Return ffmpeg's failure as one sentence, after cleaning up."""
        try:
            self._process.wait(timeout=10.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
        self._messages.seek(0)
        messages = self._messages.read().decode(errors="replace").strip()
        self._abort()
        last_line = f"its last message: {messages.splitlines()[-1] if messages else 'none'}"
        end = ExitReport(self._process.returncode).exit_text
        return VideoError(f"{self.out.name} cannot be written: ffmpeg ended {end}; {last_line}")


class VideoWriter(Encoder):
    """Encoder of streamed frames into an mp4 file of exactly ``num_frames`` frames."""

    def __init__(
        self,
        out: Path,
        width: int,
        height: int,
        num_frames: int,
        speech_wav: Path | None = None,
        crf: int = DEFAULT_CRF,
    ) -> None:
        """Prepare ffmpeg for RGB frames, see `Encoder`."""
        inputs = [
            *("-f", "rawvideo", "-pixel_format", "rgb24"),
            *("-video_size", f"{width}x{height}", "-framerate", str(FPS), "-i", "pipe:0"),
        ]
        colors = ("-map", "0:v:0", "-vf", "scale=out_color_matrix=bt709:out_range=tv")
        # One thread encodes three times as fast as pictures are drawn, with 10 % less work.
        super().__init__(out, inputs, (*colors, "-threads", "1"), num_frames, speech_wav, crf)

    def write(self, frame: UInt8[np.ndarray, "H W 3"]) -> None:
        """Append one RGB frame, upper row first; blocks; raises VideoError if ffmpeg has ended."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(np.ascontiguousarray(frame).data)
        except OSError as error:  # a broken pipe: ffmpeg has ended
            raise self._failure() from error
