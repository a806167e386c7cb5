"""Classifier test of whether windows of the corpus can be distinguished from real motion.

Statistics of windows of two seconds are compared one by one and all together, by a logistic
regression tested on clips outside its training data. How well the same statistics distinguish two
real clips of one person is the floor: a corpus cannot do better than real motion.
"""

from collections.abc import Sequence, Sized
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Float
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import roc_auc_score
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import StandardScaler

from conventions.joints import JOINT_INDEX
from conventions.rates import FPS
from model.motion.motion import load_motion
from model.plan.annotation_files import parse_textgrid
from tools.corpus.clip import ClipPaths
from tools.corpus.people.rig import Rig, axis_angles, forward_kinematics, matrices

LEFT_WRIST, RIGHT_WRIST = JOINT_INDEX["left_wrist"], JOINT_INDEX["right_wrist"]
RIGHT_MIDDLE_TIP_JOINT = JOINT_INDEX["right_middle3"]


@dataclass(frozen=True)
class PosedClip:
    """Clip on the skeleton of the corpus, whatever body it was recorded on."""

    R_parent_joint: Float[np.ndarray, "T 55 3 3"]
    R_world_joint: Float[np.ndarray, "T 55 3 3"]
    positions: Float[np.ndarray, "T 55 3"]
    right_tip: Float[np.ndarray, "T 3"]


def read_posed_clip(path: Path, rig: Rig) -> PosedClip:
    """Read a motion file in BEAT2's layout; raises MotionError if it cannot be used."""
    motion = load_motion(path)
    R_parent_joint = matrices(motion.poses.astype(np.float64).reshape(-1, 55, 3))
    R_world_joint, positions = forward_kinematics(
        rig, R_parent_joint, motion.trans.astype(np.float64)
    )
    offset = rig.tip_offsets[rig.tip_joints.index(RIGHT_MIDDLE_TIP_JOINT)]
    tip = positions[:, RIGHT_MIDDLE_TIP_JOINT] + R_world_joint[:, RIGHT_MIDDLE_TIP_JOINT] @ offset
    return PosedClip(R_parent_joint, R_world_joint, positions, tip)


def derivative(positions: Float[np.ndarray, "T D"], order: int) -> Float[np.ndarray, " S"]:
    """Compute the magnitude of the time derivative of this order, by finite differences."""
    return np.linalg.norm(np.diff(positions, order, axis=0), axis=-1) * FPS**order


def turning_deg_s(rotmat: Float[np.ndarray, "T J 3 3"]) -> Float[np.ndarray, "S J"]:
    """Compute the angular speed of each joint between frames."""
    step = np.swapaxes(rotmat[:-1], -1, -2) @ rotmat[1:]
    angle = Rotation.from_matrix(step.reshape(-1, 3, 3)).magnitude()
    return np.degrees(angle).reshape(step.shape[:2]) * FPS


def in_chest(clip: PosedClip, joint: int) -> Float[np.ndarray, "T 3"]:
    """Return a joint's position in the chest's frame: metres to its left, up and forward."""
    chest = JOINT_INDEX["spine3"]
    offset = clip.positions[:, joint] - clip.positions[:, chest]
    return np.einsum("tba,tb->ta", clip.R_world_joint[:, chest], offset)


WINDOW, HOP = 60, 30  # frames
PENALTY = 0.01  # factor on the squared weights, added to the mean loss
TREMOR_HZ = 5.0
SHUT_DEG = 1.5  # jaw opening below which the mouth is shut
FINGERS = range(JOINT_INDEX["left_index1"], JOINT_INDEX["right_thumb3"] + 1)

Figures = pd.DataFrame
"""Statistics: one row per window, one column per statistic, with the unit in its name."""


@dataclass(frozen=True)
class Separability:
    """Separability of real windows and windows of the corpus; 0.5 is chance."""

    joint: float
    """Area under the curve of all statistics together: mean over real clips left out of training.
    """
    floor: float
    """Area between two real clips, trained on three quarters of each and tested on the rest."""
    features: pd.DataFrame
    """Columns by statistic, sorted by ``auc``: medians of the ``first`` and ``second`` real clip
    and of the ``corpus``, the area under the curve by it alone (``auc``, 0.5 to 1) and of the first
    real clip against the second (``real_auc``), and its ``share`` in the regression's mean distance
    between real and corpus, negative if it works against the others."""


ListeningSpans = Sequence[tuple[float, float]]
"""Starts and ends (s) of the person's listening."""


def realism_windows(clip: PosedClip, silences: ListeningSpans = ()) -> Figures:
    """Compute statistics of 2 s windows without listening, one a second, from 65 frames on."""
    paths = {
        "fingertip": clip.right_tip,
        "head": axis_angles(clip.R_world_joint[:, JOINT_INDEX["head"]]),
        "chest": clip.positions[:, JOINT_INDEX["spine3"]],
    }
    return _figures(_series(clip), paths, silences)


def head_windows(clip: PosedClip, silences: ListeningSpans = ()) -> Figures:
    """Compute statistics of head and jaw in the same windows.

    Brows, lids and lips are left out, as recordings have another basis of face units, and the
    sideways turn of the jaw, which the corpus does not have.
    """
    neck, head, jaw = (clip.R_parent_joint[:, JOINT_INDEX[n]] for n in ("neck", "head", "jaw"))
    in_chest_deg = np.degrees(axis_angles(neck @ head))
    opening = np.degrees(axis_angles(jaw))[:, 0]
    series = {
        "head against chest, deg/s": turning_deg_s((neck @ head)[:, None])[:, 0],
        "head against chest, jerk, deg/s^3": derivative(in_chest_deg, 3),
        "jaw opening or closing, deg/s": derivative(opening[:, None], 1),
        "jaw opening, deg": opening,
        "jaw shut, share": (opening < SHUT_DEG).astype(float),
    }
    for name, turn in zip(("nod", "shake", "tilt"), in_chest_deg.T, strict=True):
        series[f"{name}, from its mean of 2 s, deg"] = np.abs(turn - uniform_filter1d(turn, WINDOW))
    paths = {"head against chest": in_chest_deg, "jaw": opening[:, None]}
    return _figures(series, paths, silences)


def _figures(
    series: dict[str, Float[np.ndarray, " _"]],
    paths: dict[str, Float[np.ndarray, "_ D"]],
    silences: ListeningSpans,
) -> Figures:
    """Compute window means of series, and spectral shares and centroids of paths."""
    num_frames = min(len(path) for path in paths.values())
    starts = [
        start
        for start in range(0, num_frames - WINDOW - 4, HOP)
        if not any(a * FPS < start + WINDOW and b * FPS > start for a, b in silences)
    ]
    figures = {
        name: np.array([values[start : start + WINDOW].mean() for start in starts], float)
        for name, values in series.items()
    }
    for name, path in paths.items():
        spectra = [_tremor(path[start : start + WINDOW + 1]) for start in starts]
        share, centroid = np.array(spectra).reshape(-1, 2).T
        figures[f"{name} log power share above 5 Hz"] = share
        figures[f"{name} spectral centroid, Hz"] = centroid
    return pd.DataFrame(figures)


def _series(clip: PosedClip) -> dict[str, Float[np.ndarray, " _"]]:
    """Return the series, per frame, that are averaged over a window."""
    left, right = in_chest(clip, LEFT_WRIST), in_chest(clip, RIGHT_WRIST)

    def both(name: str) -> list[int]:
        return [JOINT_INDEX[f"left_{name}"], JOINT_INDEX[f"right_{name}"]]

    def turning(joints: list[int]) -> Float[np.ndarray, " _"]:
        return turning_deg_s(clip.R_parent_joint[:, joints]).mean(1)

    def moving(name: str, order: int) -> Float[np.ndarray, " _"]:
        return np.mean([derivative(clip.positions[:, j], order) for j in both(name)], axis=0)

    finger_angles = np.linalg.norm(axis_angles(clip.R_parent_joint[:, FINGERS]), axis=-1)
    return {
        "wrist speed, m/s": moving("wrist", 1),
        "wrist jerk, m/s^3": moving("wrist", 3),
        "fingertip jerk, m/s^3": derivative(clip.right_tip, 3),
        "shoulder turning, deg/s": turning(both("shoulder")),
        "elbow turning, deg/s": turning(both("elbow")),
        "wrist turning, deg/s": turning(both("wrist")),
        "finger turning, deg/s": turning(list(FINGERS)),
        "head turning, deg/s": turning_deg_s(clip.R_world_joint[:, [JOINT_INDEX["head"]]])[:, 0],
        "chest turning, deg/s": turning_deg_s(clip.R_world_joint[:, [JOINT_INDEX["spine3"]]])[:, 0],
        "pelvis speed, m/s": derivative(clip.positions[:, 0], 1),
        "ankle speed, m/s": moving("ankle", 1),
        "knee turning, deg/s": turning(both("knee")),
        "collar turning, deg/s": turning(both("collar")),
        "wrist height over chest, m": (left[:, 1] + right[:, 1]) / 2,
        "wrist distance to the side, m": (left[:, 0] - right[:, 0]) / 2,
        "wrist distance to the front, m": (left[:, 2] + right[:, 2]) / 2,
        "height between the wrists, m": np.abs(left[:, 1] - right[:, 1]),
        "finger angle from flat, deg": np.degrees(finger_angles).mean(1),
    }


def _tremor(path: Float[np.ndarray, "S D"]) -> tuple[float, float]:
    """Return the log share of the velocity's power above 5 Hz, and its mean frequency (Hz)."""
    velocity = np.diff(path, axis=0)
    velocity = (velocity - velocity.mean(0)) * np.hanning(len(velocity))[:, None]
    power = (np.abs(np.fft.rfft(velocity, axis=0)) ** 2).sum(1) + 1e-20  # a still path has none
    frequency = np.fft.rfftfreq(len(velocity), 1 / FPS)
    share = power[frequency > TREMOR_HZ].sum() / power.sum()
    return float(np.log(share)), float((frequency * power).sum() / power.sum())


@dataclass(frozen=True)
class MeasuredClip:
    """Statistics of a clip."""

    clip_id: str
    realism: Figures
    """Statistics of the body while the person speaks."""
    head_realism: Figures
    """Statistics of head and jaw while the person speaks."""
    duration_s: float
    listening_s: float

    @property
    def speaker(self) -> str:
        return self.clip_id.split("_")[1]


def measure_clip(clip_id: str, paths: ClipPaths, rig: Rig) -> MeasuredClip:
    """Compute all statistics of one clip; raises MotionError if its motion cannot be used."""
    posed = read_posed_clip(paths.motion, rig)
    num_frames = len(posed.positions)
    annotation = paths.textgrid
    silences = read_listening(annotation) if annotation.is_file() else ()
    return MeasuredClip(
        clip_id=clip_id,
        realism=realism_windows(posed, silences),
        head_realism=head_windows(posed, silences),
        duration_s=num_frames / FPS,
        listening_s=sum((end - start for start, end in silences), 0.0),
    )


def read_listening(path: Path) -> tuple[tuple[float, float], ...]:
    """Read starts and ends (s) of listening from a TextGrid; none without such a tier."""
    tiers, _ = parse_textgrid(path.read_text(), path.name, ValueError)
    rows = next((tier.rows for tier in tiers if tier.name == "listening"), ())
    return tuple((row.start_s, row.end_s) for row in rows if row.text)


def _judge(a: Figures, b: Figures) -> Pipeline:
    """Fit a regression that is high for windows like ``b`` and low for windows like ``a``.

    Both have equal weight whatever their number; ``PENALTY / 2`` times the squared weights is added
    to the mean log loss.
    """
    both = pd.concat([a, b])
    regression = LogisticRegression(
        C=1 / (PENALTY * len(both)), class_weight="balanced", tol=1e-10, max_iter=10_000
    )
    return make_pipeline(StandardScaler(), regression).fit(both, _sides(a, b))


def _auc(classifier: Pipeline, a: Figures, b: Figures) -> float:
    """Compute the area under the curve of a classifier."""
    return _area(classifier.decision_function(a), classifier.decision_function(b))


def _sides(a: Sized, b: Sized) -> np.ndarray:
    return np.repeat([0, 1], [len(a), len(b)])


def _area(low: Float[np.ndarray, " N"], high: Float[np.ndarray, " M"]) -> float:
    """Return the probability that a draw of ``high`` exceeds one of ``low``; ties count half."""
    return float(roc_auc_score(_sides(low, high), np.concatenate([low, high])))


def measure_separability(real: list[Figures], corpus: list[Figures]) -> Separability:
    """Compare the corpus with two real clips, trained on one and half of it, tested on the rest."""
    first, second = real[:2]
    halves = pd.concat(corpus[0::2]), pd.concat(corpus[1::2])
    judges = _judge(first, halves[0]), _judge(second, halves[1])
    # Each classifier is tested on the real clip and the half outside its training data.
    joint = [_auc(judges[0], second, halves[1]), _auc(judges[1], first, halves[0])]
    both, every = pd.concat([first, second]), pd.concat(halves)
    apart = every.mean() - both.mean()
    gaps = []
    for judge in judges:
        (_, scaler), (_, regression) = judge.steps
        gaps.append(apart / scaler.scale_ * regression.coef_[0])
    features = pd.DataFrame(
        {
            "first": first.median(),
            "second": second.median(),
            "corpus": every.median(),
            "auc": _by_themselves(both, every),
            "real_auc": _by_themselves(first, second),
            "share": np.mean([gap / max(gap.sum(), 1e-9) for gap in gaps], axis=0),
        }
    )
    return Separability(
        joint=float(np.mean(joint)),
        floor=_floor(first, second),
        features=features.sort_values("auc", ascending=False, kind="stable"),
    )


def _floor(first: Figures, second: Figures) -> float:
    """Compare the real clips by quarters in time; NaN if no quarter has windows in both."""
    areas = []
    for quarter in range(4):
        (first_rest, first_part), (second_rest, second_part) = (
            _without_quarter(windows, quarter) for windows in (first, second)
        )
        if all(len(part) for part in (first_rest, first_part, second_rest, second_part)):
            areas.append(_auc(_judge(first_rest, second_rest), first_part, second_part))
    return float(np.mean(areas)) if areas else float("nan")


def _without_quarter(windows: Figures, quarter: int) -> tuple[Figures, Figures]:
    """Return the windows that share no frame with one quarter of a clip, and that quarter's."""
    start, stop = (len(windows) * q // 4 for q in (quarter, quarter + 1))
    rest = windows.take([*range(max(start - 1, 0)), *range(stop + 1, len(windows))])
    return rest, windows.take(list(range(start, stop)))


def _by_themselves(low: Figures, high: Figures) -> list[float]:
    """Compute the area under the curve of each statistic alone, in either direction."""
    areas = [_area(low[name].to_numpy(), high[name].to_numpy()) for name in low]
    return [max(area, 1 - area) for area in areas]
