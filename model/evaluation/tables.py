"""Table of the evaluation as Markdown, CSV and LaTeX, with bootstrap intervals over clips."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float, Int

from model.metrics.protocols.table import WORKBENCH, protocol_of
from model.storage import escaping

DRAWS = 2000
PERCENTILES = (2.5, 97.5)


@dataclass(frozen=True)
class Estimate:
    """Value over clips with its 95 % percentile interval."""

    mean: float
    """The value: a mean over clips, a ratio of means, or a distance such as FGD."""
    low: float
    high: float

    def __str__(self) -> str:
        if self.low == self.high:  # one clip, or all alike: resamples cannot differ
            return f"{self.mean:.3g}"
        return f"{self.mean:.3g} [{self.low:.3g}, {self.high:.3g}]"


def bootstrap_statistic(
    statistic: Callable[[Int[np.ndarray, " n"]], float], num_clips: int, draws: int = DRAWS
) -> Estimate:
    """Compute a statistic of clip indices for all clips, with its bootstrap interval."""
    values = [statistic(index) for index in bootstrap_indices(num_clips, draws)]
    return percentile_interval(statistic(np.arange(num_clips)), values)


@lru_cache(maxsize=4)  # 16 MB each for 1,000 clips
def bootstrap_indices(num_clips: int, draws: int) -> Int[np.ndarray, "draws n"]:
    """Draw as many clips as there are, with replacement; the same for all callers."""
    rng = np.random.default_rng(0)
    drawn = np.stack([rng.integers(num_clips, size=num_clips) for _ in range(draws)])
    drawn.flags.writeable = False
    return drawn


def percentile_interval(
    value: float, samples: Sequence[float] | Float[np.ndarray, " draws"]
) -> Estimate:
    """Make the estimate of a value from its bootstrap draws."""
    low, high = np.percentile(samples, PERCENTILES)
    return Estimate(float(value), float(low), float(high))


def bootstrap_mean(values: Sequence[float]) -> Estimate:
    """Compute the mean over clips with its interval."""
    array = np.asarray(values, float)
    drawn = array[bootstrap_indices(len(array), DRAWS)].mean(axis=1)
    return percentile_interval(float(array.mean()), drawn)


def bootstrap_ratio(values: Sequence[float], reference: Sequence[float]) -> Estimate:
    """Compute mean over mean of the same clips; clips are drawn in pairs."""
    a, b = np.asarray(values, float), np.asarray(reference, float)
    index = bootstrap_indices(len(a), DRAWS)
    return percentile_interval(
        float(a.mean() / b.mean()), a[index].mean(axis=1) / b[index].mean(axis=1)
    )


COLUMNS = {
    "fmd": "FMD",
    "fed": "FED",
    "fgd": "FGD",
    "beat_align_audio_to_motion": "BeatAlign a->m",
    "beat_align_audio_to_motion_chance": "BeatAlign a->m, chance level",
    "beat_align_motion_to_audio": "BeatAlign m->a",
    "beat_align_motion_to_audio_chance": "BeatAlign m->a, chance level",
    "l1_to_mean_m": "L1 to mean, m",
    "pairwise_l1_m": "pairwise L1, m",
    "spread_at_will_m": "pairwise L1 within one speech (recorded: one speaker), m",
    "div": "Div",
    "div_gesture": "Div of gestures",
    "matched": "matched-speech accuracy",
    "matched_arms": "matched-speech accuracy, arms only",
    "matched_face": "matched-speech accuracy, jaw only",
    "arm_speed_heard": "arm speed with its prediction from speech, r",
    "wrists_loudness": "wrist speed with loudness, r",
    "wrists_loudness_shifted": "shifted",
    "wrists_loudness_foreign": "other speech",
    "wrists_loudness_less_shifted": "matched minus shifted speech",
    "wrists_loudness_less_foreign": "matched minus other speech",
    "face_mse": "face MSE",
    "blinks_per_min": "blinks per minute",
    "brow_std": "brow raise, std",
    "jaw_loudness": "jaw angle with loudness, r",
    "brow_with_hands": "brow raise with wrist speed, r above chance",
    "head_with_hands": "head speed with wrist speed, r above chance",
    "arms_by_speech": "arm speed: effect of speech, r",
    "head_by_speech": "head speed: effect of speech, r",
    "brows_by_speech": "brows: effect of speech, r",
    "jaw_by_speech": "jaw: effect of speech, r",
    "arms_same_noise": "r with same noise, other speech: arm speed",
    "head_same_noise": "head speed",
    "arm_rotations_same_noise": "arm rotations",
    "arms_by_speaker": "arm speed: effect of speaker, r",
    "arm_rotations_other_speaker": "r with same noise, other speaker: arm rotations",
    "speaker_told": "speaker classification accuracy",
    "calm_over_lively": "wrist speed, calm / lively speaker",
    "arms_in_silence": "arm speed, silence / speech",
    "jaw_in_silence": "jaw speed",
    "tip_jerk_m_s3": "fingertip jerk, m/s^3",
    "tip_jerk_m_s3_ratio": "of recorded",
    "tip_speed_m_s": "fingertip speed, m/s",
    "tip_path_m_s_ratio": "of recorded",
    "tip_velocity_power_share_above_5hz": "power > 5 Hz",
    "tip_velocity_power_above_5hz_ratio": "of recorded",
    "seam_jerk_ratio": "jerk at seams / elsewhere",
    "seam_jerk_ratio_ratio": "of recorded",
    "foot_slide_m_s": "foot sliding, m/s",
    "foot_slide_m_s_ratio": "of recorded",
    "ankle_jerk_m_s3": "ankle jerk, m/s^3",
    "ankle_jerk_m_s3_ratio": "of recorded",
    "pelvis_wander_m": "pelvis drift, m",
    "pelvis_wander_m_ratio": "of recorded",
}
"""Metrics of the part ``motion`` and their headings, in the order of the table."""


def _heading(measure: str) -> str:
    """Return the heading of a metric; it names all protocols but the workbench's own."""
    protocol = protocol_of(measure)
    return COLUMNS[measure] if protocol == WORKBENCH else f"{COLUMNS[measure]} · {protocol}"


def _cell(columns: dict[str, dict], measure: str) -> str:
    return str(Estimate(**columns[measure])) if measure in columns else "-"


def as_markdown(table: dict) -> str:
    """Format the table as Markdown, with systems in columns so that they stay narrow."""
    rows = table["motion"]
    heads = [f"{len(table['clips'])} test clips", *map(escaping.escape_markdown, rows)]
    cells = [
        [_heading(measure), *(_cell(columns, measure) for columns in rows.values())]
        for measure in COLUMNS
        if any(measure in columns for columns in rows.values())
    ]
    lines = ["| " + " | ".join(row) + " |" for row in (heads, ["---"] * len(heads), *cells)]
    for measure in COLUMNS:
        if f"{measure}_floor" in table:
            floor = Estimate(**table[f"{measure}_floor"])
            lines += ["", f"{_heading(measure)} between two halves of the recordings: {floor}"]
    for sentence in table["left_out"]:
        lines += ["", sentence]
    return "\n".join([*lines, ""])


def as_csv(table: dict) -> str:
    """Format the table as CSV with one line for each value.

    Columns are row, measure, mean, low, high and the id of the protocol.
    """
    floors = {f"{m}_floor": table[f"{m}_floor"] for m in COLUMNS if f"{m}_floor" in table}
    lines = [
        [row, measure, *(value[key] for key in ("mean", "low", "high")), protocol_of(measure)]
        for row, columns in [*table["motion"].items(), ("recorded", floors)]
        for measure, value in columns.items()
    ]
    return escaping.csv_text(
        [["row", "measure", "mean", "low", "high", "protocol"], *lines], line_end="\n"
    )


def as_latex(table: dict) -> str:
    """Format the table as a LaTeX tabular: metrics in rows, systems in columns."""
    rows = table["motion"]
    lines = [
        r"\begin{tabular}{l" + "r" * len(rows) + "}",
        r"\hline",
        " & ".join(["", *map(escaping.escape_latex, rows)]) + r" \\",
        r"\hline",
    ]
    for measure in COLUMNS:
        if any(measure in columns for columns in rows.values()):
            cells = [_cell(columns, measure) for columns in rows.values()]
            lines.append(" & ".join([escaping.escape_latex(_heading(measure)), *cells]) + r" \\")
    return "\n".join([*lines, r"\hline", r"\end{tabular}", ""])
