"""Protocol ``motion``: metrics of each clip, stored on disk, and their intervals over clips."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import MappingProxyType

import numpy as np
from jaxtyping import Float, Int

from conventions.joints import JOINT_INDEX
from conventions.rates import FPS, SAMPLE_RATE
from model.data.recordings import parse_speaker, read_motion_and_speech
from model.diagnostics import GLOBALDIFF_WINDOWS, analyse_raw
from model.evaluation import classifiers, frechet
from model.evaluation.frechet import window_diversity
from model.evaluation.tables import Estimate, bootstrap_mean, bootstrap_ratio, bootstrap_statistic
from model.generation.base import System
from model.generation.windows import GenerateOptions, generate_motion
from model.metrics import beats, face, reference_error, speech_effect
from model.metrics.reference_error import l1_distance_to_mean
from model.metrics.speech_effect import MEASURED_SILENCE_S, silence_speed_ratio
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion, first_frames
from model.motion.tracks import track_points
from model.networks.autoencoder import FrozenMotionEncoder
from model.sampling.samplers import Sampling, noise_seed_of_clip
from model.speech.audio import Speech
from model.speech.features import MelEncoder
from model.storage.files import written_atomically
from model.systems.helpers.matching import SpeechMotionMatcher

_ANKLES = [JOINT_INDEX["left_ankle"], JOINT_INDEX["right_ankle"]]
MOTION_MEASURES = (
    "tip_jerk_m_s3",
    "tip_speed_m_s",
    "tip_velocity_power_share_above_5hz",
    "seam_jerk_ratio",
    "foot_slide_m_s",
)


def clip_measures(
    motion: Motion, recorded: Motion, joints: Float[np.ndarray, "T 55 3"]
) -> dict[str, float]:
    """Compute smoothness, wander, diversity and face error, as far as the clip is long enough."""
    analysis = analyse_raw(
        motion, open_body_skeleton(), windows=GLOBALDIFF_WINDOWS
    ).metrics.as_json()
    numbers = {name: analysis[name] for name in MOTION_MEASURES if analysis[name] is not None}
    jerk = np.asarray(analysis["joint_jerk_m_s3"], float)
    numbers["ankle_jerk_m_s3"] = float(jerk[_ANKLES].mean())
    place = motion.trans[:, [0, 2]]
    numbers["pelvis_wander_m"] = float(np.sqrt(np.square(place - place.mean(0)).sum(1).mean()))
    numbers["l1_to_mean_m"] = l1_distance_to_mean(joints)
    if motion is not recorded and motion.expression_basis == recorded.expression_basis:
        numbers["face_mse"] = expression_mse(motion, recorded)
    return numbers


def speech_effect_metrics(
    motions: Sequence[Motion], foreign_speech_motions: Sequence[Motion]
) -> dict[str, float]:
    """Compute the effect of speech and noise by body part; empty for one seed or short motion."""
    grid = {("own", seed): motion for seed, motion in enumerate(motions)}
    grid |= {("foreign", seed): motion for seed, motion in enumerate(foreign_speech_motions)}
    shortest = min(motion.num_frames for motion in grid.values())
    if len(motions) < 2 or len(foreign_speech_motions) < 2 or shortest < speech_effect.LEAST_FRAMES:
        return {}
    metrics: dict[str, float] = {}
    for part, shares in speech_effect.speech_and_noise_shares(grid).items():
        metrics[f"{part}_by_speech"] = shares.by_speech
        metrics[f"{part}_same_noise"] = shares.same_noise
    return metrics | {
        "arm_rotations_same_noise": speech_effect.arm_rotation_correlation_same_noise(grid)
    }


def pelvis_centred_positions(motion: Motion) -> Float[np.ndarray, "T 55 3"]:
    """Compute pelvis-aligned joint positions (m) with the pelvis' orientation, as EMAGE does."""
    joints = track_points(motion, open_body_skeleton()).joints
    return joints - joints[:, :1]


def mean_pairwise_l1(positions: Sequence[Float[np.ndarray, "_ J 3"]]) -> Float[np.ndarray, "n n"]:
    """Compute the mean L1 distance (m) of every two clips, summed over coordinates."""
    distances = np.zeros((len(positions), len(positions)))
    for i, a in enumerate(positions):
        for j, b in enumerate(positions[:i]):
            frames = min(len(a), len(b))
            distances[i, j] = np.abs(a[:frames] - b[:frames]).sum((1, 2)).mean()
    return distances + distances.T


def expression_mse(motion: Motion, recorded: Motion) -> float:
    """Compute the mean squared error of the expression coefficients over the shared frames."""
    frames = min(motion.num_frames, recorded.num_frames)
    difference = motion.expressions[:frames] - recorded.expressions[:frames]
    used = np.abs(recorded.expressions).max(0) > 0  # the basis may fill fewer columns
    return float(np.square(difference[:, used]).mean()) if used.any() else 0.0


RECORDED = "recorded"
RATIOS = (
    "tip_jerk_m_s3",
    "tip_speed_m_s",
    "tip_velocity_power_share_above_5hz",
    "foot_slide_m_s",
    "ankle_jerk_m_s3",
    "pelvis_wander_m",
    "seam_jerk_ratio",
)
"""Metrics that are also shown as ratios to those of the recorded clips."""
ROWS_FORMAT = 4
"""Format version of `save_clip_rows`; it changes with the content."""
PAIRWISE_FRAMES = 300
"""Frames of each clip in pairwise distances: the first 10 s."""


@dataclass(frozen=True)
class ClipRow:
    """Metrics of one row on one clip, averaged over noise seeds."""

    measures: dict[str, float]
    arrays: dict[str, np.ndarray]
    """``positions``: pelvis-aligned joints of the first frames for each noise seed, for the
    pairwise distances; ``windows`` of the first seed (`reference_error.diversity_windows`); and
    codes by distance."""


@dataclass(frozen=True)
class ClipContext:
    """Recorded motion, speeches and models of one clip, with which every row is measured."""

    recorded: Motion
    waveform: np.ndarray
    foreign_waveform: np.ndarray
    joint_mean_speeds: np.ndarray
    """Mean speeds (m/s) of the joints with beats, over all clips."""
    models: "EvaluationModels"

    @cached_property
    def mel_features(self) -> tuple[np.ndarray, np.ndarray]:
        """Features of the clip's own speech and of the foreign one, for the classifier."""
        own, foreign = (
            MelEncoder().encode(waveform, len(waveform) * FPS // SAMPLE_RATE)
            for waveform in (self.waveform, self.foreign_waveform)
        )
        return own, foreign

    @cached_property
    def onsets_s(self) -> np.ndarray:
        """Onsets of the clip's speech (s)."""
        return beats.speech_onsets(self.waveform)

    @cached_property
    def loudness(self) -> np.ndarray:
        """Loudness of the clip's speech (dB for each frame)."""
        return classifiers.frame_loudness_db(self.waveform, self.recorded.num_frames)

    def wrist_loudness_correlations(
        self, positions: Sequence[Float[np.ndarray, "T J 3"]]
    ) -> dict[str, float]:
        """Compute correlations of wrist speed with the speech's loudness, and chance levels.

        Chance is the same speech at another time, and the foreign one: choosing a lag raises the
        correlation above 0 for any two signals.
        """
        others = {
            "shifted": np.roll(self.loudness, round(face.SHIFT_S * FPS)),
            "foreign": classifiers.frame_loudness_db(
                self.foreign_waveform, self.recorded.num_frames
            ),
        }
        own, *wrong = (
            float(
                np.mean(
                    [
                        face.max_correlation_over_lags(face.wrist_speed_sum(joints), track)
                        for joints in positions
                    ]
                )
            )
            for track in (self.loudness, *others.values())
        )
        rows = {"wrists_loudness": own}
        for name, value in zip(others, wrong, strict=True):
            rows |= {f"wrists_loudness_{name}": value, f"wrists_loudness_less_{name}": own - value}
        return rows

    def row(
        self,
        motions: Sequence[Motion],
        foreign_speech_motions: Sequence[Motion] = (),
        other_metrics: Mapping[str, float] = MappingProxyType({}),
    ) -> ClipRow:
        """Compute the metrics of one row; motions for the foreign speech have the same noise."""
        positions = [pelvis_centred_positions(motion) for motion in motions]
        numbers = [
            clip_measures(motion, self.recorded, joints)
            | beats.beat_scores(joints, self.onsets_s, self.joint_mean_speeds)
            | face.face_measures(motion, self.loudness)
            | face.face_hand_correlation_above_chance(motion, joints)
            | (
                classifiers.matched_speech_metrics(
                    self.models.matching_classifier, motion, *self.mel_features
                )
                if self.models.matching_classifier
                else {}
            )
            for joints, motion in zip(positions, motions, strict=True)
        ]
        arrays = {
            "positions": np.stack([joints[:PAIRWISE_FRAMES] for joints in positions]),
            "windows": reference_error.diversity_windows(motions[0]),
        }
        for name, judge in self.models.encoders.items():
            judged = [frechet.motion_features(judge, motion) for motion in motions]
            available_codes = [codes for codes in judged if codes is not None]
            if len(available_codes) == len(motions):
                arrays[name] = np.concatenate(available_codes)
        measures = (
            classifiers.average_metrics(numbers)
            | speech_effect_metrics(motions, foreign_speech_motions)
            | dict(other_metrics)
        )
        return ClipRow(measures | self.wrist_loudness_correlations(positions), arrays)


def save_clip_rows(path: Path, rows: dict[str, ClipRow]) -> None:
    """Write a clip's rows atomically."""
    arrays = {
        f"{name}|{part}|{key}": value
        for name, row in rows.items()
        for part, values in vars(row).items()
        for key, value in values.items()
    }
    with written_atomically(path) as file:
        np.savez(file, **arrays)


def load_rows(path: Path) -> dict[str, ClipRow]:
    """Read the rows that `save_clip_rows` wrote."""
    rows: dict[str, ClipRow] = {}
    with np.load(path, allow_pickle=False) as archive:
        for place, value in archive.items():
            name, part, key = place.split("|")
            row = rows.setdefault(name, ClipRow({}, {}))
            getattr(row, part)[key] = value if part == "arrays" else float(value)
    return rows


@dataclass(frozen=True)
class EvaluationModels:
    """Systems, and the networks with which they are evaluated."""

    systems: tuple[System, ...]
    encoders: Mapping[str, FrozenMotionEncoder] = field(default_factory=dict)
    """Encoders of the Fréchet distances, by distance; one without an encoder is left out."""
    matching_classifier: SpeechMotionMatcher | None = None
    """Classifier of matched and mismatched speech; None leaves the metric out."""


def read_recording_cut_to_speech(folder: Path, name: str) -> tuple[Motion, Speech]:
    """Read a clip's motion, cut to the frames of its speech, and its whole speech."""
    motion, speech = read_motion_and_speech(folder, name)
    return first_frames(motion, min(motion.num_frames, speech.num_motion_frames)), speech


@dataclass(frozen=True)
class ClipEvaluator:
    """Inputs of an evaluation that are the same for all clips."""

    folder: Path
    load_models: Callable[[], EvaluationModels]
    num_seeds: int
    sampling: Sampling
    speaker_comparison: classifiers.SpeakerComparisonClips
    speaker_classifier: classifiers.SpeakerClassifier | None
    joint_mean_speeds: np.ndarray
    """Mean speeds (m/s) of the joints with beats, over all clips."""

    def measure(self, name: str, foreign_clip: str, out: Path) -> None:
        """Measure clip ``name``, with mismatched speech of ``foreign_clip``, and write its rows."""
        models = self.load_models()
        (motion, speech), (_, foreign) = (
            read_recording_cut_to_speech(self.folder, clip) for clip in (name, foreign_clip)
        )
        context = ClipContext(
            motion, speech.waveform, foreign.waveform, self.joint_mean_speeds, models
        )
        # Silences of the clip's own speech; empty if none is long enough.
        in_silence = silence_speed_ratio(motion, classifiers.voiced_frames(context.mel_features[0]))
        of_recordings = (
            in_silence
            | self.speaker_comparison.recorded_wrist_speeds(self.folder, name)
            | self._speaker_metrics([motion], name)
        )
        rows = {RECORDED: context.row([motion], other_metrics=of_recordings)}
        for system in models.systems:
            sampling = system.supported_sampling(self.sampling)
            options = GenerateOptions(
                speaker=parse_speaker(name)[1],
                seed=noise_seed_of_clip(0, name),
                num_samples=self.num_seeds,
                **vars(sampling),
            )
            motions = generate_motion(system, speech, options)
            foreign_speech_motions = generate_motion(system, foreign, options)
            other_metrics = self.speaker_comparison.few_clip_metrics(system, name, speech, sampling)
            other_metrics |= self._speaker_metrics(motions, name)
            rows[system.name] = context.row(motions, foreign_speech_motions, other_metrics)
        save_clip_rows(out, rows)

    def _speaker_metrics(self, motions: Sequence[Motion], name: str) -> dict[str, float]:
        judge = self.speaker_classifier
        return {} if judge is None else judge.measures(motions, parse_speaker(name)[1])


def clip_metrics_table(clips: Sequence[dict[str, ClipRow]], speakers: Sequence[str]) -> dict:
    """Compute intervals over clips, each with its speaker, in parts.

    ``motion`` has the metrics by row; ``fmd_floor``, ``fed_floor``, ``fgd_floor`` are recorded
    halves against each other, for each distance that is available.
    """
    motion: dict[str, dict[str, dict]] = {}
    recorded = [rows[RECORDED] for rows in clips]
    judged = _judged(recorded)
    for name in clips[0]:
        rows = [clip[name] for clip in clips]
        columns: dict[str, Estimate] = {}
        for measure in dict.fromkeys(m for row in rows for m in row.measures):
            values = [row.measures[measure] for row in rows if measure in row.measures]
            columns[measure] = bootstrap_mean(values)
        for measure in RATIOS:
            pairs = [
                (row.measures[measure], own.measures[measure])
                for row, own in zip(rows, recorded, strict=True)
                if measure in row.measures and measure in own.measures
            ]
            if pairs:
                columns[f"{measure}_ratio"] = bootstrap_ratio(*zip(*pairs, strict=True))
        wrists = [
            (row.measures["calm_wrist_m_s"], row.measures["lively_wrist_m_s"])
            for row in rows
            if "calm_wrist_m_s" in row.measures
        ]
        if wrists:
            columns["calm_over_lively"] = bootstrap_ratio(*zip(*wrists, strict=True))
        columns["pairwise_l1_m"] = _pairwise([row.arrays["positions"][0] for row in rows])
        spread = _chance_spread(rows, speakers if name == RECORDED else None)
        if spread is not None:
            columns["spread_at_will_m"] = spread
        columns |= window_diversity([row.arrays["windows"] for row in rows])
        if name != RECORDED:
            for measure, features in _judged(rows).items():
                if measure in judged:
                    columns[measure] = frechet.frechet_with_interval(judged[measure], features)
        motion[name] = {measure: vars(interval) for measure, interval in columns.items()}
    floors = {
        f"{measure}_floor": vars(frechet.split_half_baseline(features))
        for measure, features in judged.items()
    }
    return {"motion": motion, **floors, "settings": metric_settings()}


def metric_settings() -> dict[str, float]:
    """Return the parameters of the metrics."""
    return {
        "beat_sigma_audio_to_motion_s": beats.SIGMA_AUDIO_TO_MOTION_S,
        "beat_sigma_motion_to_audio_s": beats.SIGMA_MOTION_TO_AUDIO_S,
        "beat_speed_threshold": beats.SPEED_THRESHOLD,
        "beat_neighbours_frames": beats.MINIMUM_ORDER,
        "beat_margin_s": beats.MARGIN_S,
        "wrong_speech_shift_s": face.SHIFT_S,
        "silence_s": MEASURED_SILENCE_S,
        "coupling_max_lag_s": face.MAX_LAG_S,
        "div_batch_windows": reference_error.BATCH_WINDOWS,
        "div_window_frames": reference_error.WINDOW_FRAMES,
        "div_every_frames": reference_error.EVERY_FRAMES,
    }


def _chance_spread(rows: Sequence[ClipRow], speakers: Sequence[str] | None) -> Estimate | None:
    """Compute the pairwise L1 distance of noise seeds, or of each speaker's recorded clips.

    None without two of either.
    """
    if speakers is None:
        drawn = [row.arrays["positions"] for row in rows]
        pairs = [mean_pairwise_l1([*positions]) for positions in drawn if len(positions) > 1]
        values = [float(d[np.triu_indices(len(d), 1)].mean()) for d in pairs]
    else:
        distances = mean_pairwise_l1([row.arrays["positions"][0] for row in rows])
        values = [
            float(distances[i, j])
            for i, one in enumerate(speakers)
            for j, other in enumerate(speakers[:i])
            if one == other
        ]
    return bootstrap_mean(values) if values else None


def _pairwise(positions: Sequence[Float[np.ndarray, "T J 3"]]) -> Estimate:
    distances = mean_pairwise_l1(positions)

    def statistic(index: Int[np.ndarray, " clips"]) -> float:
        chosen = distances[np.ix_(index, index)]
        different = index[:, None] != index
        return float(chosen[different].mean()) if different.any() else 0.0

    return bootstrap_statistic(statistic, len(positions))


def _judged(rows: Sequence[ClipRow]) -> dict[str, list[frechet.Features]]:
    """Return the codes of all clips by distance, without distances that a clip lacks."""
    names = [name for name in frechet.ENCODER_NAMES if all(name in row.arrays for row in rows)]
    return {name: [row.arrays[name] for row in rows] for name in names}
