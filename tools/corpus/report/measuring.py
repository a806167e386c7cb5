"""What the report keeps of each clip, and how often its hands are inside the body.

Trunk and thighs are stacks of ellipses in the rest pose. A point is carried back into the rest
pose by the joint that moves that part of the stack.
"""

import csv
import logging
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float
from tqdm import tqdm

from conventions.joints import JOINT_INDEX
from conventions.rates import FPS
from model.plan.textgrid import Row, textgrid_tiers
from model.speech.audio import SpeechError
from model.storage.npz import MotionError
from tools.corpus.layout import MOTION, SOUND, SPLIT_TABLE, ClipPaths, clip_paths
from tools.corpus.people.rig import Rig
from tools.corpus.report.realism import (
    Figures,
    hand_speed,
    head_windows,
    realism_windows,
    sound_features,
)
from tools.corpus.report.statistics import (
    PosedClip,
    clip_statistics,
    read_posed_clip,
    window_features,
)


@dataclass(frozen=True)
class Part:
    """The part of a stack between two heights of the rest pose, and the joint that moves it."""

    joint: str
    bottom_m: float
    top_m: float
    stack: str


STACKS: dict[str, Float[np.ndarray, "E 5"]] = {
    # height, centre (x, z) and half axes (x, z) in metres, measured on the open body's mesh
    "trunk": np.array(
        [
            [-0.45, 0.0, 0.045, 0.178, 0.111],
            [-0.35, 0.0, 0.059, 0.164, 0.116],
            [-0.25, 0.0, 0.068, 0.148, 0.104],
            [-0.15, 0.0, 0.055, 0.148, 0.108],
            [-0.05, 0.0, 0.037, 0.179, 0.120],
            [0.00, 0.0, 0.026, 0.186, 0.117],
            [0.05, 0.0, 0.009, 0.162, 0.099],
            [0.10, 0.0, -0.001, 0.133, 0.075],
        ]
    ),
    "left thigh": np.array(
        [
            [-0.80, 0.128, 0.014, 0.066, 0.075],
            [-0.70, 0.116, 0.033, 0.077, 0.080],
            [-0.60, 0.106, 0.045, 0.089, 0.092],
            [-0.50, 0.094, 0.045, 0.095, 0.095],
        ]
    ),
}
STACKS["right thigh"] = STACKS["left thigh"] * np.array([1.0, -1.0, 1.0, 1.0, 1.0])

PARTS = (
    Part("pelvis", -0.45, -0.241, "trunk"),
    Part("spine1", -0.241, -0.111, "trunk"),
    Part("spine2", -0.111, -0.057, "trunk"),
    Part("spine3", -0.057, 0.10, "trunk"),
    Part("left_hip", -0.80, -0.45, "left thigh"),
    Part("right_hip", -0.80, -0.45, "right thigh"),
)
HAND_JOINTS = (
    JOINT_INDEX["left_wrist"],
    JOINT_INDEX["right_wrist"],
    *range(JOINT_INDEX["left_index1"], 55),
)


def hand_inside_share(clip: PosedClip, rig: Rig) -> float:
    """Share of frames in which a hand's joint or fingertip lies inside the trunk or a thigh.

    Joints lie about a centimetre under the skin, so a hand that rests on the body is not inside.
    """
    tip_joints = list(rig.tip_joints)
    reach = np.einsum("tjab,jb->tja", clip.global_rot[:, tip_joints], rig.tip_offsets)
    tips = clip.positions[:, tip_joints] + reach
    points = np.concatenate([clip.positions[:, HAND_JOINTS], tips], axis=1)
    inside = np.zeros(points.shape[:2], dtype=bool)
    for part in PARTS:
        joint = JOINT_INDEX[part.joint]
        offset = points - clip.positions[:, joint, None]
        at_rest = offset @ clip.global_rot[:, joint] + rig.rest_joints[joint]
        inside |= _in_part(at_rest, part)
    return float(inside.any(axis=1).mean())


def _in_part(points: Float[np.ndarray, "T P 3"], part: Part) -> Bool[np.ndarray, "T P"]:
    x, height, z = np.moveaxis(points, -1, 0)
    stack = STACKS[part.stack]
    centre_x, centre_z, half_x, half_z = (
        np.interp(height, stack[:, 0], column) for column in stack[:, 1:].T
    )
    in_ellipse = ((x - centre_x) / half_x) ** 2 + ((z - centre_z) / half_z) ** 2 < 1
    return in_ellipse & (height >= part.bottom_m) & (height < part.top_m)


log = logging.getLogger(__name__)

MIN_FRAMES = 6 * FPS  # four windows of `realism`
EDGE = slice(30, -30)  # a second at both ends is left out of correlations
STRIP_FRAMES = 8 * FPS  # kept for pictures, from the middle
PHRASE_PAUSE_S, PHRASE_WORDS = 0.2, 5


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
    statistics: dict[str, float]
    speaker_windows: Float[np.ndarray, "W F"]
    realism: Figures
    """Of the body, while it speaks."""
    head_realism: Figures
    """Of head and jaw, while they speak."""
    duration_s: float
    listening_s: float
    hand_speed: Float[np.ndarray, " T"]
    sound: Float[np.ndarray, "T B"]
    phrases: tuple[str, ...]
    """Runs of at least five words between pauses; empty without an annotation."""
    strip: tuple[Float[np.ndarray, "S 55 3 3"], Float[np.ndarray, "S 55 3"]]
    """World rotations and positions of the middle of the clip."""


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
    inside = 100 * hand_inside_share(posed, rig)
    annotated = clip.paths.textgrid.is_file()
    silences = read_listening(clip.paths.textgrid) if annotated else ()
    return MeasuredClip(
        clip_id=clip.clip_id,
        speaker=clip.speaker,
        statistics=clip_statistics(posed) | {"hand inside trunk or thigh, % of frames": inside},
        speaker_windows=window_features(posed),
        realism=realism_windows(posed, silences),
        head_realism=head_windows(posed, silences),
        duration_s=num_frames / FPS,
        listening_s=sum((end - start for start, end in silences), 0.0),
        hand_speed=hand_speed(posed)[EDGE],
        sound=sound_features(clip.paths.sound, num_frames)[EDGE].astype(np.float32),
        phrases=read_phrases(clip.paths.textgrid) if annotated else (),
        strip=_middle(posed),
    )


def read_phrases(path: Path) -> tuple[str, ...]:
    """Runs of at least five words between pauses of a fifth of a second, from a TextGrid.

    Raises:
        ReportError: if the file cannot be read.
    """
    runs: list[list[str]] = [[]]
    for row in _tier(path, "words"):
        if row.label:
            runs[-1].append(row.label)
        elif row.end_s - row.start_s >= PHRASE_PAUSE_S:
            runs.append([])
    return tuple(" ".join(run) for run in runs if len(run) >= PHRASE_WORDS)


def read_listening(path: Path) -> tuple[tuple[float, float], ...]:
    """Seconds from and to which the speaker listens, from a TextGrid; none without such a tier.

    Raises:
        ReportError: if the file cannot be read.
    """
    return tuple((row.start_s, row.end_s) for row in _tier(path, "listening") if row.label)


def _tier(path: Path, name: str) -> tuple[Row, ...]:
    try:
        tiers, _ = textgrid_tiers(path.read_text())
    except (OSError, UnicodeDecodeError) as error:
        raise ReportError(f"{path.name} cannot be read.") from error
    return next((tier.rows for tier in tiers if tier.name == name), ())


def _middle(
    clip: PosedClip,
) -> tuple[Float[np.ndarray, "S 55 3 3"], Float[np.ndarray, "S 55 3"]]:
    start = max(0, (len(clip.positions) - STRIP_FRAMES) // 2)
    part = slice(start, start + STRIP_FRAMES)
    return clip.global_rot[part].copy(), clip.positions[part].copy()
