"""What the report keeps of each clip."""

import csv
import logging
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from tqdm import tqdm

from conventions.rates import FPS
from model.plan.textgrid import textgrid_tiers
from model.speech.audio import SpeechError
from model.storage.npz import MotionError
from tools.corpus.layout import MOTION, SOUND, SPLIT_TABLE, ClipPaths, clip_paths
from tools.corpus.people.rig import Rig
from tools.corpus.report.realism import (
    Figures,
    hand_speed,
    head_windows,
    read_posed_clip,
    realism_windows,
    sound_features,
)

log = logging.getLogger(__name__)

MIN_FRAMES = 6 * FPS  # four windows of `realism`
EDGE = slice(30, -30)  # a second at both ends is left out of correlations


class ReportError(ValueError):
    """A report that cannot be made."""


@dataclass(frozen=True)
class ClipFile:
    """A clip of a data folder."""

    clip_id: str
    paths: ClipPaths

    @property
    def speaker(self) -> str:
        return self.clip_id.split("_")[1]


@dataclass(frozen=True)
class MeasuredClip:
    """All figures of a clip."""

    clip_id: str
    speaker: str
    realism: Figures
    """Of the body, while it speaks."""
    head_realism: Figures
    """Of head and jaw, while they speak."""
    duration_s: float
    listening_s: float
    hand_speed: Float[np.ndarray, " T"]
    sound: Float[np.ndarray, "T B"]


def list_clips(root: Path) -> list[ClipFile]:
    """The clips in the table of splits that have motion and sound.

    Raises:
        ReportError: if there are none.
    """
    table = root / SPLIT_TABLE
    ids: list[str] = []
    if table.is_file():
        with table.open(newline="") as file:
            ids = [row.get("id") or "" for row in csv.DictReader(file)]
    # An id that holds anything but letters, digits and _ could lead out of the folder.
    clips = [ClipFile(i, clip_paths(root, i)) for i in ids if re.fullmatch(r"\d+_\w+", i)]
    there = [c for c in clips if c.paths.motion.is_file() and c.paths.sound.is_file()]
    if not there:
        raise ReportError(
            f"{root} holds no clips in BEAT2's layout ({MOTION}, {SOUND}, {SPLIT_TABLE})."
        )
    if len(there) < len(ids):
        log.warning(
            "%d of the %d clips in %s have no files.", len(ids) - len(there), len(ids), table
        )
    return there


def measure_clips(clips: list[ClipFile], rig: Rig, title: str) -> list[MeasuredClip]:
    """Measure all clips that can be used; the others are named in the log.

    Raises:
        ReportError: if none can be used.
    """
    measured = []
    for clip in tqdm(clips, unit="clip", desc=title):
        try:
            measured.append(measure_clip(clip, rig))
        except (MotionError, SpeechError, ReportError) as error:
            log.warning("Skipped %s: %s", clip.clip_id, error)
    if not measured:
        raise ReportError(f"None of the {len(clips)} clips could be used; see the reasons above.")
    return measured


def measure_clip(clip: ClipFile, rig: Rig) -> MeasuredClip:
    """All figures of one clip.

    Raises:
        MotionError, SpeechError, ReportError: if its files cannot be used.
    """
    posed = read_posed_clip(clip.paths.motion, rig)
    num_frames = len(posed.positions)
    if num_frames < MIN_FRAMES:
        raise ReportError(f"it has {num_frames} frames; at least {MIN_FRAMES} are needed.")
    annotation = clip.paths.textgrid
    silences = read_listening(annotation) if annotation.is_file() else ()
    return MeasuredClip(
        clip_id=clip.clip_id,
        speaker=clip.speaker,
        realism=realism_windows(posed, silences),
        head_realism=head_windows(posed, silences),
        duration_s=num_frames / FPS,
        listening_s=sum((end - start for start, end in silences), 0.0),
        hand_speed=hand_speed(posed)[EDGE],
        sound=sound_features(clip.paths.sound, num_frames)[EDGE].astype(np.float32),
    )


def read_listening(path: Path) -> tuple[tuple[float, float], ...]:
    """Seconds from and to which the speaker listens, from a TextGrid; none without such a tier.

    Raises:
        ReportError: if the file cannot be read.
    """
    try:
        tiers, _ = textgrid_tiers(path.read_text())
    except (OSError, UnicodeDecodeError) as error:
        raise ReportError(f"{path.name} cannot be read.") from error
    rows = next((tier.rows for tier in tiers if tier.name == "listening"), ())
    return tuple((row.start_s, row.end_s) for row in rows if row.label)
