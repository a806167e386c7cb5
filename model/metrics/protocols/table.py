"""Records of all protocols, by ids that never change.

A number that is measured by another rule gets another id. The table of docs/evaluation.md and the
command ``protocols`` are made from these records. Their formulas are in
`model.metrics.protocols.formulas`; this module needs no package, so that the page can import it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, TypeVar

from model.metrics.protocols.record import Need, Protocol

if TYPE_CHECKING:
    from model.metrics.results import BeatSpeeds

WORKBENCH = "workbench/1"
"""Id of the metrics that have no published rule of their own."""
PROTOCOL_CAPTION = f"Numbers by protocol {WORKBENCH}."
"""Last sentence of captions."""
GENEA_LENGTHS = (30, 60, 90)
"""Lengths of the pieces of GENEA's encoders (frames)."""
_OPEN = "the 55 joints of the open body (m), y up, flat hands, no betas"
_ROOTED = f"{_OPEN}, pelvis-aligned"
_WHOLE = "whole clip; mean over clips"
_CODES = "whole clip; one distance over the codes of all clips"
_UPPER = "13 upper-body joints of the open body (m), pelvis-aligned; onsets of librosa, hop 512"
_BEAT = {"beat_align": "0 to 1"}
_FACE = "vertices of SMPL-X (m) with jaw, FLAME expressions and betas"
_BY_LENGTH = "whole clip; clips weighted by their length"
_INNER = "all but 2 s at both ends; mean over clips"
_PANTOMATRIX = "PantoMatrix/PantoMatrix"
_GENEA = "genea-workshop/genea_numerical_evaluations"
_RAG = "m-hamza-mughal/RAG-Gesture"


PROTOCOLS: Mapping[str, Protocol] = {
    record.id: record
    for record in (
        Protocol(
            WORKBENCH,
            "Metrics of this workbench, defined in docs/formats.md and docs/evaluation.md. They "
            "can be compared between results of this program only.",
            _OPEN, _WHOLE, "docs/formats.md", "our own",
        ),
        Protocol(
            "beats/workbench",
            "Nearness of each speech onset to the nearest motion beat, a minimum of a joint's "
            "speed above 0.3 of its mean in the reference. With other mean speeds it is called "
            "beats/workbench-own or beats/workbench-emage.",
            _UPPER, _INNER,
            "EMAGE's formula, with beats and onsets counted from the start of the clip", "our own",
            _BEAT, ("waveform", "reference"), is_own=True,
        ),
        Protocol(
            "beats/workbench-own",
            "As beats/workbench, but a beat's speed is compared with the mean speed of the same "
            "motion. A slow motion is thus not penalised.",
            _UPPER, _INNER, "as beats/workbench", "our own", _BEAT, ("waveform",), is_own=True,
        ),
        Protocol(
            "beats/workbench-emage",
            "As beats/workbench, but with the mean speeds that EMAGE publishes. EMAGE's own code "
            "counts beats from another start and so gives another number: beats/emage.",
            _UPPER, _INNER, "as beats/workbench", "our own", _BEAT, ("waveform", "mean_speeds"),
            is_own=True,
        ),
        Protocol(
            "beats/emage",
            "BeatAlign as the trainers of EMAGE and of its successors (SemTalk) print it. Before "
            "it, the trainer's L1 diversity replaces the joint positions in the same array by "
            "their absolute differences from the mean, so that beats are minima of their speed.",
            _UPPER, "all but 60 frames at both ends; clips weighted by their length",
            f"{_PANTOMATRIX}, scripts/EMAGE_2024", values=_BEAT, needs=("waveform", "mean_speeds"),
        ),
        Protocol(
            "beats/evaltools",
            "BeatAlign of EMAGE's later evaluation tools: a lower speed threshold (0.1), joint "
            "positions, and no rotation of the pelvis. It is higher than beats/emage.",
            _UPPER, "all but 60 frames at both ends; clips weighted by their length",
            f"{_PANTOMATRIX}, emage_evaltools/mertic.py", values=_BEAT,
            needs=("waveform", "mean_speeds"),
        ),
        Protocol(
            "beats/raggesture",
            "BeatAlign of RAG-Gesture: the first 10 s of a clip, of which only a third of a second "
            "is left out at both ends. The threshold is 0.3 of the published mean speeds.",
            _UPPER, "frames 10 to 290 of each clip, or to 10 before its end; weighted by length",
            f"{_RAG}, tools/evaluate.py", values=_BEAT, needs=("waveform", "mean_speeds"),
        ),
        Protocol(
            "beats/asynfusion",
            "Nearness of each motion beat to the nearest speech onset, with a standard deviation "
            "of 0.1 s. The paper names none, so its numbers cannot be compared.",
            _UPPER, _INNER, "AsynFusion, eq. 18", values={"beat_align_motion_to_audio": "0 to 1"},
            needs=("waveform", "reference"),
        ),
        Protocol(
            "l1div/emage",
            "L1 distance of the joints to their mean position in the clip, summed over all 165 "
            "coordinates. EMAGE adds the mean hand pose and the betas of the clip's body.",
            _ROOTED, "whole clip; mean over clips", f"{_PANTOMATRIX}, L1div",
            values={"l1_diversity_m": "m"}, is_own=True,
        ),
        Protocol(
            "diversity/globaldiff",
            "Mean L1 distance of pairs of clips, joint by joint, in their first 10 s. The paper "
            "describes it; its repository has no code for it.",
            _ROOTED, "first 10 s; mean over pairs of clips", "GlobalDiff, section 4",
            values={"pairwise_l1_m": "m"},
        ),
        Protocol(
            "div/asynfusion",
            "Mean L1 distance of windows of 2 s in random batches of 50. Rotations are axis-angle; "
            "`div` adds 52 blendshapes.",
            "55 local rotations (rad), 52 blendshapes", "windows of 2 s at 15 frames per second",
            "AsynFusion, eq. 17", values={"div": "", "div_gesture": ""}, rate_fps=15.0, seeds="0",
        ),
        Protocol(
            "fgd/workbench",
            "Fréchet distance between the codes of generated and recorded motion, by the encoder "
            "that is part of this program. It cannot be compared with a published FGD.",
            "55 local rotations, root velocity along x and z, root height",
            f"{_CODES}; a code per 8 frames", "Yoon et al. 2020",
            "our own", {"fgd": ""}, ("reference",),
            encoder="fgd-encoder of the bundled weights",
        ),
        Protocol(
            "fed/workbench",
            "The same with an encoder of the 52 blendshapes alone. Motion with FLAME coefficients "
            "has none.",
            "52 blendshapes", f"{_CODES}; a code per 8 frames", "AsynFusion, eq. 16", "our own",
            {"fed": ""}, ("reference",), encoder="fed-encoder of the bundled weights",
        ),
        Protocol(
            "fmd/workbench",
            "The same with an encoder of body and blendshapes. Motion with FLAME coefficients has "
            "none.",
            "55 local rotations, velocity, 52 blendshapes", f"{_CODES}; a code per 8 frames",
            "AsynFusion, eq. 16", "our own", {"fmd": ""}, ("reference",),
            encoder="fmd-encoder of the bundled weights",
        ),
        Protocol(
            "fgd/emage",
            "FGD of papers on BEAT2, by EMAGE's autoencoder over whole clips. Numbers of other "
            "clips, or of one and of 25 speakers, cannot be compared; papers print it times 10.",
            "55 local rotations as 6D (rows)", f"{_CODES}, cut to 32 frames; a code per 16 frames",
            f"{_PANTOMATRIX}, emage_evaltools/mertic.py", values={"fgd": ""},
            needs=("reference", "emage_weights"), encoder="AESKConv_240_100.bin, yours",
        ),
        *(
            Protocol(
                f"fgd/genea-{length}",
                f"FGD of GENEA's evaluation scripts, by their autoencoder of {length} frames. "
                "Their skeleton has a joint between neck and head that SMPL-X lacks; the midpoint "
                "of the two takes its place.",
                "14 upper-body joints (cm), pelvis-aligned, standardised by GENEA's means",
                f"pieces of {length} frames, hop {length // 2}; one distance over all pieces",
                f"{_GENEA}, FGD",
                values={"fgd": ""}, needs=("reference", "genea_weights"),
                encoder=f"model_checkpoint_{length}.bin, yours",
            )
            for length in GENEA_LENGTHS
        ),
        Protocol(
            "physical/mbench",
            "Plausibility of feet and movement from 22 joints, as the Motius leaderboard measures "
            "MBench's. Values are per frame at 30 frames per second; dynamics are compared with "
            "the recorded motion, and penetration is nearly always 0.",
            "22 body joints of the open body (m), y up, float32", _WHOLE,
            "ZeyuLing/Motius, evaluation/metrics/physical.py",
            "yes, equal to 4e-7 relative on six clips",
            {"slide_m": "m", "floating_share": "share", "jitter_m": "m", "dynamic_m": "m",
             "penetration_m": "m"},
            parts=("detail", "place", "legs"),
        ),
        Protocol(
            "gac/unicamp",
            "Number of cells of 5 mm that the bones sweep over, seen from the front, and its Dice "
            "score with the recorded motion. A higher score means that gestures reach the same "
            "places.",
            "20 bones of the 22 body joints (cm), pelvis-aligned, lowest point at 0", _WHOLE,
            "AI-Unicamp/gesture-area-coverage, GAC",
            "yes, equal cells on six clips, equal Dice on four pairs",
            {"cells": "cells", "dice": "0 to 1"}, parts=("legs",),
        ),
        Protocol(
            "srgr/beat",
            "Share of joints within 10 cm of the recorded ones, weighted by BEAT's labels of "
            "semantic relevance. It is scaled so that a mean relevance of 0.165 gives 1.",
            _ROOTED, _BY_LENGTH, "BEAT (Liu et al. 2022), SRGR; Euclidean norm of emage_evaltools",
            values={"srgr": ""}, needs=("reference", "semantics"),
        ),
        Protocol(
            "srgr/raggesture",
            "As srgr/beat, but a joint counts if the absolute differences of its three coordinates "
            "add up to less than 30 cm. It differs from RAG-Gesture's own number, which is of the "
            "first 10 s of each clip.",
            _ROOTED, _BY_LENGTH, f"{_RAG}, tools/evaluate.py", values={"srgr": ""},
            needs=("reference", "semantics"),
        ),
        Protocol(
            "hellinger/genea",
            "Hellinger distance between the histograms of joint speeds of generated and recorded "
            "motion, in bins of 0.05 cm/s up to 49 cm/s. Faster movement does not count.",
            "51 joints of body and hands (cm), pelvis-aligned",
            "steps between frames of all clips together",
            f"{_GENEA}, calc_histogram.py and hellinger_distance.py",
            values={"hellinger": "0 to 1"}, needs=("reference",), parts=("detail", "hands"),
        ),
        Protocol(
            "cca/genea",
            "First canonical correlation of the coordinates of a clip with those of its recording. "
            "It is near 1 for any two motions with as many coordinates as seconds, so clips of "
            "under 10 s are left out.",
            "51 joints of body and hands (cm), pelvis-aligned", _WHOLE,
            f"{_GENEA}, cca.py; the mean of clips, not their global value",
            values={"cca": "0 to 1"}, needs=("reference",),
        ),
        Protocol(
            "mse_face/emage",
            "Mean squared error of a licensed face's vertices, moved by jaw and expressions alone. "
            "Papers print it in units of 1e-8.",
            _FACE, _BY_LENGTH, f"{_PANTOMATRIX}, emage_evaltools/mertic.py",
            values={"mse_m2": "m²"}, needs=("reference", "face_vertices"),
        ),
        Protocol(
            "lvd/emage",
            "Mean absolute error of the same vertices' steps between frames. Papers print it in "
            "units of 1e-5, and older ones with a fault that gives four times as much.",
            _FACE, _BY_LENGTH, f"{_PANTOMATRIX}, emage_evaltools/mertic.py", values={"lvd_m": "m"},
            needs=("reference", "face_vertices"),
        ),
    )
}  # fmt: skip
"""Records by id."""

NEEDS: Mapping[Need, str] = {
    "reference": "--reference",
    "waveform": "--speech",
    "mean_speeds": "--mean-speeds",
    "semantics": "--semantics",
    "face_vertices": "--body",
    "emage_weights": "--emage-weights",
    "genea_weights": "--genea-weights",
}
"""Flag of `diagnose` that gives each input."""


_BEATS: Mapping[BeatSpeeds, str] = {
    "reference": "beats/workbench",
    "own": "beats/workbench-own",
    "emage": "beats/workbench-emage",
}
OWN_METRICS: Mapping[str, str] = {
    "l1_diversity_m": "l1div/emage",
    "l1_to_mean_m": "l1div/emage",
    "pairwise_l1_m": "diversity/globaldiff",
    **dict.fromkeys(("div", "div_gesture"), "div/asynfusion"),
    **{metric: f"{metric}/workbench" for metric in ("fgd", "fed", "fmd")},
    "beat_align_audio_to_motion": "beats/workbench",
    "beat_align_motion_to_audio": "beats/asynfusion",
}
"""Protocols of metrics in ``diagnostics.json`` and ``evaluation.json`` that have a rule of their
own."""


def protocol_of(metric: str, speeds: BeatSpeeds = "own") -> str:
    """Return the protocol's id of a metric in our files.

    Args:
        speeds: source of the mean speeds of BeatAlign.
    """
    metric = metric.removesuffix("_floor").removesuffix("_chance").removesuffix("_chance_highest")
    is_beat = metric in ("beat_align", "beats_per_joint_s")
    return OWN_METRICS.get(metric, _BEATS[speeds] if is_beat else WORKBENCH)


T = TypeVar("T")


def without_parts(by_id: Mapping[str, T], missing_parts: Collection[str]) -> dict[str, T]:
    """Leave out protocols that need a part which a motion lacks."""
    return {
        name: each
        for name, each in by_id.items()
        if not set(PROTOCOLS[name].parts) & {*missing_parts}
    }


HEADINGS = ("id", "rule", "input", "flags", "source")


def protocol_row(record: Protocol) -> tuple[str, str, str, str, str]:
    """Return the cells of a record in a table with `HEADINGS`."""
    parts = [f"{record.input}, {record.rate_fps:g} fps", record.pieces]
    parts += [f"{name} {each}" for name, each in (
        ("encoder", record.encoder), ("seed", record.seeds)
    ) if each != "none"]  # fmt: skip
    flags = " ".join(NEEDS[need] for need in record.needs)
    source = record.source
    if record.compared != "our own":
        source += f"; checked against the authors' code: {record.compared}"
    return record.id, record.rule, "; ".join(parts), flags or "motion only", source
