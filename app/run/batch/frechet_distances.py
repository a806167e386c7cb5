"""Fréchet distances of sets of motion to the recorded set, with our encoder and with others'.

A clip's features are stored next to its record. Sets are summed up clip by clip, for all bootstrap
draws at once, so that memory does not grow with the number of clips.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from app.errors import RunError
from app.findings.metric_table import FGD, FGD_EMAGE, FGD_ENCODERS, FGD_GENEA
from app.run.batch.published_metrics import DRAWS, PLAIN, apply_variation, interval_rows
from app.run.requests.parts import MetricOptions
from conventions.names import REFERENCE_NAME
from model.evaluation.frechet import FeatureMoments, frechet_from_moments, motion_features
from model.evaluation.tables import bootstrap_indices
from model.motion.kinematics import RestSkeleton
from model.motion.motion import Motion
from model.networks.autoencoder import load_motion_encoder
from model.storage.cards import BUNDLED_WEIGHTS, CheckpointError, load_card
from model.storage.files import FileStamps, file_sha256, file_stamps, written_atomically
from model.systems.helpers import emage, genea
from model.systems.helpers.config import FGD_ENCODER

LEFT_OUT = (
    "FGD with {encoder} was not computed: the clips together have {codes} feature vectors, one for "
    "every {frames} frames, and at least {least} are needed."
)
_CLIPS_AT_ONCE = 50


@dataclass(frozen=True)
class FeatureEncoder:
    """Encoder of the features that are compared."""

    metric: str
    """Key of the distance by this encoder."""
    protocol: str
    """Id of the protocol (`model.metrics.protocols`)."""
    encode: Callable[[Motion, RestSkeleton], Any]
    frames_per_code: int
    sha256: str
    covariance_offset: float = 0.0
    """Offset argument of `frechet_from_moments`."""


def feature_encoders(metrics: MetricOptions) -> tuple[FeatureEncoder, ...]:
    """Return our, EMAGE's and GENEA's encoders, loaded once; raises CheckpointError."""
    files = BUNDLED_WEIGHTS.glob(f"{FGD_ENCODER}.*")
    named = filter(None, (metrics.emage_weights, *metrics.genea_weights))
    return _load_encoders(metrics, file_stamps((*files, *named)))


@cache
def _load_encoders(metrics: MetricOptions, stamps: FileStamps) -> tuple[FeatureEncoder, ...]:
    ours = load_motion_encoder(BUNDLED_WEIGHTS, FGD_ENCODER)
    frames, sha256 = max(ours.network.config.scales), load_card(BUNDLED_WEIGHTS, FGD_ENCODER).sha256
    judges = [
        FeatureEncoder(FGD, "fgd/workbench", lambda m, _: motion_features(ours, m), frames, sha256)
    ]
    if metrics.emage_weights is not None:
        theirs = emage.load_emage_encoder(metrics.emage_weights)
        frames, sha256 = emage.FRAMES_PER_CODE, file_sha256(metrics.emage_weights)
        judges.append(
            FeatureEncoder(
                FGD_EMAGE,
                "fgd/emage",
                lambda m, _: emage.emage_codes(theirs, m),
                frames,
                sha256,
                emage.COVARIANCE_OFFSET,
            )
        )
    for path in metrics.genea_weights:
        encoder = genea.load_genea_encoder(path)
        key, length = FGD_GENEA[encoder.length], encoder.length
        if any(judge.metric == key for judge in judges):
            raise CheckpointError(
                f"{path.name} is a second GENEA encoder for {length} frames; give only one for "
                "each length."
            )
        codes, sha256 = partial(genea.genea_codes, encoder), file_sha256(path)
        judges.append(FeatureEncoder(key, f"fgd/genea-{length}", codes, length // 2, sha256))
    return tuple(judges)


def encoder_digests(metrics: MetricOptions) -> dict[str, str]:
    """Return the sha256 of the encoders' files; ours is called ``FGD``."""
    return {
        "FGD" if judge.metric == FGD else judge.protocol: judge.sha256
        for judge in feature_encoders(metrics)
    }


def check_fgd_options(metrics: MetricOptions, reference: Path | None) -> None:
    """Check before measuring that FGD has a recorded set and readable encoder files.

    Raises RunError without a recorded set, CheckpointError for any other file.
    """
    if metrics.emage_weights is None and not metrics.genea_weights:
        return
    if reference is None:
        raise RunError(
            "FGD compares a set with recorded motion; also give the recorded set "
            "(--reference FOLDER)."
        )
    feature_encoders(metrics)


def features_path(record_path: Path) -> Path:
    """Return the path of a clip's features, next to its record."""
    return record_path.with_suffix(".codes.npz")


def save_features(
    record_path: Path,
    motions: Mapping[str, Sequence[Motion]],
    metrics: MetricOptions,
    variations: Sequence[str] = (),
) -> None:
    """Write the features of one clip, also under each of `PROTOCOL_VARIATIONS`, atomically."""
    codes: dict[str, Any] = {
        _key(number, name, variation): np.concatenate(
            [judge.encode(*apply_variation(motion, variation)) for motion in samples]
        )
        for number, judge in enumerate(feature_encoders(metrics))
        for variation in (PLAIN, *variations)
        for name, samples in motions.items()
    }
    with written_atomically(features_path(record_path)) as part:
        np.savez(part, **{key: each.astype(np.float32) for key, each in codes.items()})


def _key(number: int, name: str, variation: str) -> str:
    return f"{number} {name}" + (f"|{variation}" if variation else "")


def distance_values(
    systems: Sequence[str],
    records: Sequence[Path],
    metrics: MetricOptions,
    variations: Sequence[str] = (),
) -> dict[tuple[str, str, str, str], float]:
    """Return the distances of all clips by system, protocol, ``fgd`` and variation.

    Distances with too few codes are left out.
    """
    values: dict[tuple[str, str, str, str], float] = {}
    for number, judge in enumerate(feature_encoders(metrics) if REFERENCE_NAME in systems else ()):
        for variation in (PLAIN, *variations):
            recorded = np.concatenate(list(_codes_of(number, records, REFERENCE_NAME, variation)))
            if len(recorded) < min_num_codes(recorded.shape[1]):
                continue
            for name in (name for name in systems if name != REFERENCE_NAME):
                codes = np.concatenate(list(_codes_of(number, records, name, variation)))
                moments = FeatureMoments.of(recorded), FeatureMoments.of(codes)
                distance = frechet_from_moments(*moments, judge.covariance_offset)
                values[name, judge.protocol, "fgd", variation] = distance
    return values


def distance_rows(
    systems: Sequence[str], records: Sequence[Path], metrics: MetricOptions
) -> tuple[list[tuple[Any, ...]], list[str]]:
    """Return the distances of systems and their differences as table rows, and notes.

    The notes say what is omitted. Without a recorded set, both are empty. The features of the clips
    are next to their ``records``.
    """
    rows: list[tuple[Any, ...]] = []
    notes: list[str] = []
    for number, judge in enumerate(feature_encoders(metrics) if REFERENCE_NAME in systems else ()):
        shapes = [codes.shape for codes in _codes_of(number, records, REFERENCE_NAME)]
        count, least = sum(length for length, _ in shapes), min_num_codes(shapes[0][1])
        if count < least:
            counts = {"codes": count, "frames": judge.frames_per_code, "least": least}
            notes.append(LEFT_OUT.format(encoder=FGD_ENCODERS[judge.metric], **counts))
            continue
        measured = [record for record, (length, _) in zip(records, shapes, strict=True) if length]
        rows += _rows(judge, systems, len(measured), partial(_codes_of, number, measured))
    return rows, notes


def min_num_codes(num_dims: int) -> int:
    """Return how many codes of ``num_dims`` dimensions a covariance of full rank needs."""
    return num_dims + 1


def _codes_of(
    encoder: int, records: Sequence[Path], name: str, variation: str = PLAIN
) -> Iterator[np.ndarray]:
    """Yield the features of one set, clip by clip."""
    for record in records:
        with np.load(features_path(record), allow_pickle=False) as file:
            yield file[_key(encoder, name, variation)].astype(np.float64)


def _rows(
    encoder: FeatureEncoder,
    systems: Sequence[str],
    num_clips: int,
    clips: Callable[[str], Iterator[Float[np.ndarray, "codes C"]]],
) -> Iterator[tuple[Any, ...]]:
    recorded = _drawn(clips(REFERENCE_NAME), num_clips)
    values = {
        name: np.array([
            frechet_from_moments(real, other, encoder.covariance_offset)
            for real, other in zip(recorded, _drawn(clips(name), num_clips), strict=True)
        ])
        for name in systems
        if name != REFERENCE_NAME
    }  # fmt: skip
    counts = dict.fromkeys(values, num_clips)
    return interval_rows((encoder.metric, ""), values, counts, encoder.protocol)


def _drawn(clips: Iterator[Float[np.ndarray, "codes C"]], num_clips: int) -> list[FeatureMoments]:
    """Sum up the features of all clips, and then those of each bootstrap draw."""
    drawn = [np.bincount(each, minlength=num_clips) for each in bootstrap_indices(num_clips, DRAWS)]
    times = np.array([np.ones(num_clips), *drawn])
    sums: Any = 0.0
    for start in range(0, num_clips, _CLIPS_AT_ONCE):
        # With a column of ones, the products also contain count and total.
        some = [np.insert(codes, 0, 1.0, axis=1) for codes in islice(clips, _CLIPS_AT_ONCE)]
        products = np.array([codes.T @ codes for codes in some])
        sums = sums + np.tensordot(times[:, start : start + _CLIPS_AT_ONCE], products, 1)
    return [FeatureMoments(round(each[0, 0]), each[0, 1:], each[1:, 1:]) for each in sums]
