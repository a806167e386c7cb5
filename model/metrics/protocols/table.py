"""Records of all protocols, by ids that never change.

A number that is measured by another rule gets another id. The table of docs/evaluation.md and the
command ``protocols`` are made from these records. Their formulas are in
`model.metrics.protocols.formulas`; this module needs no package, so that the page can import it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, TypeVar

from model.metrics.protocols.record import Protocol, ProtocolInput

if TYPE_CHECKING:
    from model.metrics.results import BeatSpeedSource

WORKBENCH = "workbench/1"
"""Id of the metrics that have no published rule of their own."""
PROTOCOL_CAPTION = f"Metrics follow protocol {WORKBENCH}."
"""Last sentence of captions."""
GENEA_PIECE_FRAMES = (30, 60, 90)
"""Lengths of the pieces of GENEA's encoders (frames)."""
_OPEN = "positions of 55 joints of the bundled body (m), y up, flat hands, betas 0"
_PELVIS_ALIGNED = f"{_OPEN}, pelvis-aligned"
_WHOLE = "whole clips; mean over clips"
_CODES = "one distance between the latent codes of all generated and all recorded clips"
_CODES_8 = f"whole clips; {_CODES}; one code per 8 frames"
_UPPER = (
    "onsets detected by librosa (hop of 512 samples); positions of 13 upper-body joints of the "
    "bundled body (m), pelvis-aligned"
)
_BEAT = {"beat_align": "0 to 1"}
_FACE = "SMPL-X vertices (m) from betas, jaw pose and FLAME expressions (other joints at rest)"
_BY_LENGTH = "whole clips; mean over clips, weighted by length"
_WITHOUT_60 = "without the first and last 60 frames; mean over clips, weighted by length"
_WITHOUT_2_S = "without the first and last 2 s; mean over clips"
_NEEDS_ARKIT = "It cannot be computed for motions with FLAME coefficients."
_PANTOMATRIX = "PantoMatrix/PantoMatrix"
_GENEA = "genea-workshop/genea_numerical_evaluations"
_RAG = "m-hamza-mughal/RAG-Gesture"


PROTOCOLS: Mapping[str, Protocol] = {
    record.id: record
    for record in (
        Protocol(
            WORKBENCH,
            "Metrics defined by this program; see docs/formats.md and docs/evaluation.md. Compare "
            "them only with other results of this program.",
            _OPEN, _WHOLE, "docs/formats.md", "our own",
        ),
        Protocol(
            "beats/workbench",
            "BeatAlign: how close each speech onset is to the nearest motion beat. A motion beat "
            "is a local minimum of a joint's speed that is above 0.3 times the joint's mean speed "
            "in the reference. Variants take the mean speed from the evaluated motion "
            "(beats/workbench-own) or from EMAGE (beats/workbench-emage).",
            _UPPER, _WITHOUT_2_S,
            "EMAGE's formula, with the times of beats and onsets counted from the start of the "
            "clip",
            "our own", _BEAT, ("waveform", "reference"), is_own_metric=True,
        ),
        Protocol(
            "beats/workbench-own",
            "BeatAlign as in beats/workbench, but with the joint's mean speed in the evaluated "
            "motion instead of the reference, so that a slow motion is not penalised.",
            _UPPER, _WITHOUT_2_S, "as beats/workbench", "our own", _BEAT, ("waveform",),
            is_own_metric=True,
        ),
        Protocol(
            "beats/workbench-emage",
            "BeatAlign as in beats/workbench, but with the mean joint speeds published by EMAGE. "
            "EMAGE's own code gives another value (beats/emage), because it finds beats in "
            "the evaluated slice, but tests the speed threshold at the same frame "
            "numbers of the whole clip.",
            _UPPER, _WITHOUT_2_S, "as beats/workbench", "our own", _BEAT,
            ("waveform", "published_mean_speeds"), is_own_metric=True,
        ),
        Protocol(
            "beats/emage",
            "BeatAlign as printed by the training code of EMAGE and its successors (SemTalk). "
            "That code first replaces the joint positions by their absolute differences from the "
            "mean position (for L1 diversity), so its motion beats are minima of the speed of "
            "these differences.",
            _UPPER, _WITHOUT_60, f"{_PANTOMATRIX}, scripts/EMAGE_2024", value_units=_BEAT,
            required_inputs=("waveform", "published_mean_speeds"),
        ),
        Protocol(
            "beats/evaltools",
            "BeatAlign of EMAGE's later evaluation tools. It uses joint positions, a lower speed "
            "threshold (0.1) and no pelvis rotation. Its values are higher than those of "
            "beats/emage.",
            _UPPER, _WITHOUT_60, f"{_PANTOMATRIX}, emage_evaltools/mertic.py", value_units=_BEAT,
            required_inputs=("waveform", "published_mean_speeds"),
        ),
        Protocol(
            "beats/raggesture",
            "BeatAlign of RAG-Gesture. It uses the first 10 s of a clip and leaves out a third "
            "of a second at each end. A joint's speed threshold is 0.3 times its mean speed as "
            "published by EMAGE.",
            _UPPER,
            "frames 10 to 290 of each clip (shorter clips: up to 10 frames before the end); mean "
            "over clips, weighted by length",
            f"{_RAG}, tools/evaluate.py", value_units=_BEAT,
            required_inputs=("waveform", "published_mean_speeds"),
        ),
        Protocol(
            "beats/asynfusion",
            "How close each motion beat is to the nearest speech onset, with a Gaussian kernel "
            "(standard deviation 0.1 s). The AsynFusion paper does not state the standard "
            "deviation of its kernel, so values cannot be compared with the paper's.",
            _UPPER, _WITHOUT_2_S, "AsynFusion, eq. 18",
            value_units={"beat_align_motion_to_audio": "0 to 1"},
            required_inputs=("waveform", "reference"),
        ),
        Protocol(
            "l1div/emage",
            "L1 distance between the joint positions and their mean over the clip, summed over "
            "all 165 coordinates. EMAGE itself uses a body with the mean hand pose and the clip's "
            "betas, so its values differ.",
            _PELVIS_ALIGNED, _WHOLE, f"{_PANTOMATRIX}, L1div", value_units={"l1_diversity_m": "m"},
            is_own_metric=True,
        ),
        Protocol(
            "diversity/globaldiff",
            "Mean L1 distance between the joint positions in the first 10 s of two clips, over all "
            "pairs of clips. It is implemented from the paper's text, because the paper's "
            "repository has no code for it.",
            _PELVIS_ALIGNED, "first 10 s; mean over pairs of clips", "GlobalDiff, section 4",
            value_units={"pairwise_l1_m": "m"},
        ),
        Protocol(
            "div/asynfusion",
            "Mean L1 distance between windows of 2 s, in random batches of 50 windows. "
            "`div_gesture` compares axis-angle rotations, `div` also the 52 blendshapes.",
            "55 local rotations (rad), 52 blendshapes", "windows of 2 s", "AsynFusion, eq. 17",
            value_units={"div": "", "div_gesture": ""}, rate_fps=15.0, seed="0",
        ),
        Protocol(
            "fgd/workbench",
            "Fréchet distance between the latent codes of generated and recorded motion, with the "
            "encoder of this program. It cannot be compared with a published FGD.",
            "55 local rotations, root velocity along x and z, root height",
            _CODES_8, "Yoon et al. 2020",
            "our own", {"fgd": ""}, ("reference",),
            encoder="fgd-encoder of the bundled weights",
        ),
        Protocol(
            "fed/workbench",
            "Fréchet distance as in fgd/workbench, but with an encoder of the 52 facial "
            f"blendshapes only. {_NEEDS_ARKIT}",
            "52 blendshapes", _CODES_8, "AsynFusion, eq. 16", "our own",
            {"fed": ""}, ("reference",), encoder="fed-encoder of the bundled weights",
        ),
        Protocol(
            "fmd/workbench",
            "Fréchet distance as in fgd/workbench, but with an encoder of body motion and facial "
            f"blendshapes together. {_NEEDS_ARKIT}",
            "55 local rotations, root velocity along x and z, root height, 52 blendshapes",
            _CODES_8, "AsynFusion, eq. 16", "our own", {"fmd": ""},
            ("reference",), encoder="fmd-encoder of the bundled weights",
        ),
        Protocol(
            "fgd/emage",
            "FGD as in papers on BEAT2, with EMAGE's autoencoder on whole clips. Compare only "
            "values that were computed on the same clips (the value also depends on the number of "
            "speakers). Papers report this value multiplied by 10.",
            "55 local rotations as 6D vectors (first two rows)",
            f"{_CODES}; clips cut to a multiple of 32 frames; one code per 16 frames",
            f"{_PANTOMATRIX}, emage_evaltools/mertic.py", value_units={"fgd": ""},
            required_inputs=("reference", "emage_weights"),
            encoder="AESKConv_240_100.bin, which you provide",
        ),
        *(
            Protocol(
                f"fgd/genea-{length}",
                f"FGD of GENEA's evaluation scripts, with their autoencoder of {length} frames. "
                "Their skeleton has a joint between neck and head that SMPL-X lacks; the midpoint "
                "of neck and head is used for it.",
                "positions of 14 upper-body joints (cm), pelvis-aligned, normalised with GENEA's "
                "mean and standard deviation",
                f"windows of {length} frames, one every {length // 2} frames; one distance over "
                "all windows",
                f"{_GENEA}, FGD",
                value_units={"fgd": ""}, required_inputs=("reference", "genea_weights"),
                encoder=f"model_checkpoint_{length}.bin, which you provide",
            )
            for length in GENEA_PIECE_FRAMES
        ),
        Protocol(
            "physical/mbench",
            "Foot sliding, floating, jitter, dynamic degree and floor penetration of 22 joints: "
            "MBench's metrics as the Motius leaderboard computes them. Distances are per frame at "
            "30 fps. Compare the dynamic degree with that of the recorded motion; penetration is "
            "nearly always 0.",
            "positions of 22 body joints of the bundled body (m), y up, float32", _WHOLE,
            "ZeyuLing/Motius, evaluation/metrics/physical.py",
            "yes, relative differences of at most 4e-7 on six clips",
            {"slide_m": "m", "floating_share": "share", "jitter_m": "m", "dynamic_m": "m",
             "penetration_m": "m"},
            required_parts=("detail", "place", "legs"),
        ),
        Protocol(
            "gac/unicamp",
            "Number of grid cells (5 mm) that the bones cover during the clip, seen from the "
            "front, and the Dice score with the cells of the recorded motion. A higher Dice score "
            "means that the gestures reach the same places.",
            "20 bones between the 22 body joints (cm), pelvis-aligned, lowest point at height 0",
            _WHOLE, "AI-Unicamp/gesture-area-coverage, GAC",
            "yes, the same cells on six clips, the same Dice score on four pairs",
            {"cells": "cells", "dice": "0 to 1"}, required_parts=("legs",),
        ),
        Protocol(
            "srgr/beat",
            "Share of joints within 10 cm of the recorded position, weighted per frame by BEAT's "
            "labels of semantic relevance and divided by their mean in BEAT (0.165).",
            _PELVIS_ALIGNED, _BY_LENGTH,
            "BEAT (Liu et al. 2022), SRGR, with the Euclidean norm of emage_evaltools",
            value_units={"srgr": ""}, required_inputs=("reference", "semantics"),
        ),
        Protocol(
            "srgr/raggesture",
            "SRGR as in srgr/beat, but a joint counts if the absolute differences of its three "
            "coordinates add up to less than 30 cm. RAG-Gesture itself evaluates only the first "
            "10 s of each clip, so its values differ.",
            _PELVIS_ALIGNED, _BY_LENGTH, f"{_RAG}, tools/evaluate.py", value_units={"srgr": ""},
            required_inputs=("reference", "semantics"),
        ),
        Protocol(
            "hellinger/genea",
            "Hellinger distance between the histograms of joint speeds of generated and recorded "
            "motion, in bins of 0.05 cm/s from 0 to 49 cm/s. Higher speeds are left out.",
            "positions of 51 joints of body and hands (cm), pelvis-aligned",
            "whole clips; one histogram of all clips",
            f"{_GENEA}, calc_histogram.py and hellinger_distance.py",
            value_units={"hellinger": "0 to 1"}, required_inputs=("reference",),
            required_parts=("detail", "hands"),
        ),
        Protocol(
            "cca/genea",
            "First canonical correlation between the 153 joint coordinates of a clip and those of "
            "its recording. In clips of up to about 150 s it is near 1 for any two motions; clips "
            "shorter than 10 s are left out.",
            "positions of 51 joints of body and hands (cm), pelvis-aligned", _WHOLE,
            f"{_GENEA}, cca.py, with the mean over clips instead of one value over all clips",
            value_units={"cca": "0 to 1"}, required_inputs=("reference",),
        ),
        Protocol(
            "mse_face/emage",
            "Mean squared error of the vertices of the SMPL-X model (which you provide), posed by "
            "jaw and expressions only. Papers report it in units of 1e-8.",
            _FACE, _BY_LENGTH, f"{_PANTOMATRIX}, emage_evaltools/mertic.py",
            value_units={"mse_m2": "m²"}, required_inputs=("reference", "face_vertices"),
        ),
        Protocol(
            "lvd/emage",
            "Mean absolute error of the displacement between frames, of the same vertices as in "
            "mse_face/emage. Papers report it in units of 1e-5; values of older papers are four "
            "times too large because of a bug in their code.",
            _FACE, _BY_LENGTH, f"{_PANTOMATRIX}, emage_evaltools/mertic.py",
            value_units={"lvd_m": "m"}, required_inputs=("reference", "face_vertices"),
        ),
    )
}  # fmt: skip
"""Records by id."""

FLAG_OF_INPUT: Mapping[ProtocolInput, str] = {
    "reference": "--reference",
    "waveform": "--speech",
    "published_mean_speeds": "--mean-speeds",
    "semantics": "--semantics",
    "face_vertices": "--body",
    "emage_weights": "--emage-weights",
    "genea_weights": "--genea-weights",
}
"""Flag of `diagnose` that gives each input."""


_BEATS: Mapping[BeatSpeedSource, str] = {
    "reference": "beats/workbench",
    "own": "beats/workbench-own",
    "emage": "beats/workbench-emage",
}
PROTOCOL_OF_METRIC: Mapping[str, str] = {
    "l1_diversity_m": "l1div/emage",
    "l1_to_mean_m": "l1div/emage",
    "pairwise_l1_m": "diversity/globaldiff",
    **dict.fromkeys(("div", "div_gesture"), "div/asynfusion"),
    **{metric: f"{metric}/workbench" for metric in ("fgd", "fed", "fmd")},
    "beat_align_audio_to_motion": "beats/workbench",
    "beat_align_motion_to_audio": "beats/asynfusion",
}
"""Protocols of metrics in ``diagnostics.json`` and ``evaluation.json`` with a rule of their own."""


def protocol_of(metric: str, beat_speed_source: BeatSpeedSource = "own") -> str:
    """Return the protocol's id of a metric in our files."""
    metric = metric.removesuffix("_floor").removesuffix("_chance").removesuffix("_chance_highest")
    is_beat = metric in ("beat_align", "beats_per_joint_s")
    return PROTOCOL_OF_METRIC.get(metric, _BEATS[beat_speed_source] if is_beat else WORKBENCH)


T = TypeVar("T")


def measurable_without(by_id: Mapping[str, T], missing_parts: Collection[str]) -> dict[str, T]:
    """Leave out protocols that need a part which a motion lacks."""
    return {
        name: each
        for name, each in by_id.items()
        if not set(PROTOCOLS[name].required_parts) & {*missing_parts}
    }


HEADINGS = ("id", "rule", "input", "flags", "source")


def protocol_row(record: Protocol) -> tuple[str, str, str, str, str]:
    """Return the cells of a record in a table with `HEADINGS`."""
    parts = [f"{record.measured_quantity}, {record.rate_fps:g} fps", record.frames_and_averaging]
    parts += [f"{name} {each}" for name, each in (
        ("encoder", record.encoder), ("seed", record.seed)
    ) if each != "none"]  # fmt: skip
    flags = " ".join(FLAG_OF_INPUT[need] for need in record.required_inputs)
    source = record.source
    if record.code_comparison != "our own":
        source += f"; compared with the authors' code: {record.code_comparison}"
    return record.id, record.rule, "; ".join(parts), flags or "motion only", source
