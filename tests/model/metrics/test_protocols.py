"""Protocols against the authors' numbers, and against slow versions of their formulas."""

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from sklearn.cross_decomposition import CCA

from conventions.joints import FACE, PARENTS
from model.formats.read import read_any_motion
from model.metrics.beats import BEAT_JOINTS, speech_onsets
from model.metrics.protocols import face
from model.metrics.protocols.clip import Clip, Sums
from model.metrics.protocols.coverage import covered_cells, dice_score
from model.metrics.protocols.formulas import FORMULAS, Formula, protocol_sums, protocol_values
from model.metrics.protocols.semantics import read_semantics
from model.metrics.protocols.table import FLAG_OF_INPUT, PROTOCOLS
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion, first_frames
from model.motion.tracks import track_points
from model.storage.npz import MotionError
from tests.helpers import beat2_folder, foreign_folder, protocols_folder, smooth_motion_example

NAMES = {
    "slide_m": "Slide",
    "floating_share": "Float",
    "jitter_m": "Jitter",
    "dynamic_m": "Dynamic",
    "penetration_m": "Penet",
}


def clip_of(motion: Motion, reference: Clip | None = None, **inputs) -> Clip:
    tracks = track_points(motion, open_body_skeleton())
    return Clip(tracks.joints, tracks.R_world_joint[:, 0], reference, **inputs)


@pytest.fixture(scope="module")
def clip() -> Clip:
    """Twelve seconds of two different smooth motions with a speech of clicks."""
    rng = np.random.default_rng(3)
    waveform = rng.normal(0, 1e-3, 16000 * 12)
    for time in rng.uniform(0, 12, 40):
        waveform[int(16000 * time) :][:400] += rng.normal(0, 0.3, 400)[
            : 16000 * 12 - int(16000 * time)
        ]
    inputs = {
        "waveform": waveform.astype(np.float32),
        "published_mean_speeds": rng.uniform(0.05, 0.4, 13),
    }
    recorded = clip_of(smooth_motion_example(360, 1), **inputs)
    return clip_of(
        smooth_motion_example(360, 2), recorded, semantics=rng.uniform(0, 0.5, 360), **inputs
    )


def value(name: str, clip: Clip) -> dict[str, float]:
    return FORMULAS[name].evaluate(FORMULAS[name].sums(clip))


def test_physical_and_coverage_give_the_numbers_of_the_authors_code():
    wanted = json.loads((protocols_folder() / "reference.json").read_text())
    scores = wanted.pop("gac_dice")
    folders = foreign_folder(), beat2_folder() / "smplxflame_30"
    cells = {}
    for name, numbers in wanted.items():
        path = next(path for folder in folders if (path := folder / name).exists())
        clip = clip_of(first_frames(read_any_motion(path).motion, numbers["frames"]))
        found = value("physical/mbench", clip)
        for key, title in NAMES.items():
            assert found[key] == pytest.approx(numbers["physical"][title], rel=1e-4), (name, key)
        cells[name] = covered_cells(clip.joints)
        assert cells[name].sum() == numbers["gac_cells"] == value("gac/unicamp", clip)["cells"]
    for pair, score in scores.items():
        assert dice_score(*(cells[name] for name in pair.split())) == pytest.approx(score, abs=1e-6)


def test_ids_are_frozen_and_records_complete():
    assert [name for name in FORMULAS if not PROTOCOLS[name].is_own_metric] == [
        *("beats/emage", "beats/evaltools", "beats/raggesture", "physical/mbench", "gac/unicamp"),
        *("srgr/beat", "srgr/raggesture", "hellinger/genea", "cca/genea"),
        *("mse_face/emage", "lvd/emage"),
    ]
    for name, record in PROTOCOLS.items():
        assert (
            record.id == name
            and record.source
            and record.measured_quantity
            and record.frames_and_averaging
        )
        assert record.rule.endswith(".") and record.rule.count(". ") <= 2, name
        assert set(record.required_inputs) <= set(FLAG_OF_INPUT)
        with pytest.raises(AttributeError):
            record.id = "other"  # pyright: ignore


def test_every_input_that_is_missing_leaves_its_protocols_out(clip: Clip):
    measured = set(protocol_values(protocol_sums(clip)))
    assert measured == {
        *("beats/emage", "beats/evaltools", "beats/raggesture", "physical/mbench", "gac/unicamp"),
        *("srgr/beat", "srgr/raggesture", "hellinger/genea", "cca/genea"),
    }
    alone = replace(clip, reference=None, waveform=None)
    assert set(protocol_sums(alone)) == {"physical/mbench", "gac/unicamp"}
    assert "dice" not in value("gac/unicamp", alone)


def test_sums_of_clips_add_up_to_the_value_of_a_set(clip: Clip):
    halves = clip.first_frames(200), replace(clip.first_frames(160), joints=clip.joints[200:])

    def added(formula: Formula) -> Sums:
        first, second = map(formula.sums, halves)
        return {key: first[key] + second[key] for key in first}

    srgr, physical, speeds = (
        FORMULAS[name] for name in ("srgr/beat", "physical/mbench", "hellinger/genea")
    )
    rates = [srgr.evaluate(srgr.sums(half))["srgr"] for half in halves]
    assert srgr.evaluate(added(srgr))["srgr"] == pytest.approx(
        (200 * rates[0] + 160 * rates[1]) / 360
    )
    means = [physical.evaluate(physical.sums(half)) for half in halves]
    assert physical.evaluate(added(physical)) == pytest.approx(
        {key: (means[0][key] + means[1][key]) / 2 for key in means[0]}
    )
    assert 0 < speeds.evaluate(added(speeds))["hellinger"] < 1


def slow_beats(clip: Clip, threshold: float, margin: int, joints: np.ndarray, end: int) -> float:
    """EMAGE's formula, joint by joint, onset by onset."""
    assert clip.waveform is not None and clip.published_mean_speeds is not None
    frames, start = len(joints), margin * 16000 // 30
    onsets = speech_onsets(clip.waveform[: int(16000 / 30 * frames)][start:end])
    scores = []
    for joint, mean in zip(BEAT_JOINTS, clip.published_mean_speeds, strict=True):
        path = joints[:, joint]
        steps = [path[1] - path[0], *((path[2:] - path[:-2]) / 2), path[-1] - path[-2]]
        speed = [float(np.linalg.norm(step)) * 30 / mean for step in steps]
        inner = speed[margin : frames - margin]
        beats = [
            i
            for i in range(len(inner))
            if all(
                inner[i] < inner[min(max(i + k, 0), len(inner) - 1)] for k in range(-7, 8) if k != 0
            )
            and speed[i] > threshold
        ]
        near = [min((abs(beat / 30 - onset) for beat in beats), default=np.inf) for onset in onsets]
        scores.append(sum(np.exp(-(gap**2) / (2 * 0.3**2)) for gap in near) / len(near))
    return sum(scores) / len(scores)


def test_beats_are_those_of_the_published_formulas(clip: Clip):
    assert clip.waveform is not None
    pelvis_aligned = clip.joints - clip.joints[:, :1]
    offset = 60 * 16000 // 30
    spread = np.abs(pelvis_aligned - pelvis_aligned.mean(0))
    found = value("beats/emage", clip)["beat_align"]
    assert found == pytest.approx(slow_beats(clip, 0.3, 60, spread, len(clip.waveform) - offset))
    upright = np.stack(
        [
            joints @ turn
            for joints, turn in zip(pelvis_aligned, clip.root_rotations.astype(float), strict=True)
        ]
    )
    found = value("beats/evaltools", clip)["beat_align"]
    assert found == pytest.approx(slow_beats(clip, 0.1, 60, upright, (360 - 60) * 16000 // 30))
    found = value("beats/raggesture", clip)["beat_align"]
    assert found == pytest.approx(
        slow_beats(clip, 0.3, 10, pelvis_aligned[:300], 290 * 16000 // 30)
    )


def test_semantic_recall_is_that_of_the_papers_formula(clip: Clip):
    assert clip.reference is not None and clip.semantics is not None
    ours, theirs = (each.joints - each.joints[:, :1] for each in (clip, clip.reference))
    beat = rag = 0.0
    for frame, relevance in enumerate(clip.semantics):
        for joint in range(55):
            gap = ours[frame, joint] - theirs[frame, joint]
            beat += relevance / 0.165 * (np.sqrt((gap**2).sum()) < 0.1)
            rag += relevance / 0.165 * (np.abs(gap).sum() < 0.3)
    assert value("srgr/beat", clip)["srgr"] == pytest.approx(beat / (360 * 55))
    assert value("srgr/raggesture", clip)["srgr"] == pytest.approx(rag / (360 * 55))


def test_genea_measures_are_those_of_textbooks(clip: Clip):
    assert clip.reference is not None
    joints = [joint for joint in range(1, 55) if joint not in FACE]
    ours, theirs = (
        100 * (each.joints - each.joints[:, :1])[:, joints] for each in (clip, clip.reference)
    )
    shares = []
    for positions in (ours, theirs):
        speeds = [
            float(np.linalg.norm(b[joint] - a[joint])) * 30
            for a, b in pairwise(positions)
            for joint in range(51)
        ]
        counts = np.bincount([int(speed / 0.05) for speed in speeds if speed < 49], minlength=980)
        shares.append(counts[:980] / counts[:980].sum())
    wanted = np.sqrt(1 - sum(np.sqrt(a * b) for a, b in zip(*shares, strict=True)))
    assert value("hellinger/genea", clip)["hellinger"] == pytest.approx(wanted, rel=1e-3)

    def correlation(one: np.ndarray, other: np.ndarray) -> float:
        flat = [each.reshape(len(each), -1) for each in (one, other)]
        flat = [each[:, each.std(0) > 1e-8] for each in flat]
        model = CCA(n_components=1, max_iter=1500).fit(*flat)
        first, second = model.transform(*flat)
        return float(np.corrcoef(first.ravel(), second.ravel())[0, 1])

    found = value("cca/genea", clip)["cca"]
    assert found == pytest.approx(correlation(ours, theirs), abs=1e-3)
    assert "cca/genea" not in protocol_sums(clip.first_frames(30))


def test_faces_are_compared_over_all_frames_and_pieces(clip: Clip, monkeypatch: pytest.MonkeyPatch):
    assert clip.reference is not None
    rng = np.random.default_rng(0)
    ours, theirs = rng.normal(0, 1, (2, 360, 20, 3))
    recorded = replace(clip.reference, face_vertices=lambda frames: theirs[frames])
    faces = replace(clip, reference=recorded, face_vertices=lambda frames: ours[frames])
    monkeypatch.setattr(face, "_FRAMES", 7)
    steps = (ours[1:] - ours[:-1]) - (theirs[1:] - theirs[:-1])
    assert value("mse_face/emage", faces)["mse_m2"] == pytest.approx(((ours - theirs) ** 2).mean())
    assert value("lvd/emage", faces)["lvd_m"] == pytest.approx(np.abs(steps).sum() / ours.size)


def test_labels_of_beat_are_read_frame_by_frame_and_others_refused(tmp_path):
    path = tmp_path / "clip.txt"
    path.write_text("beat_align_01\t0.1\t0.2\t0.1\t0.7\t\n01_beat\t0.2\t0.4\t0.2\t0.1\tthis one\n")
    assert read_semantics(path, 15).tolist() == [0.0] * 3 + [0.7] * 4 + [0.1] * 6 + [0.0] * 2
    for text in ("word 0 1 1 .5", "a\t0\t1\t1\t7\tb", "a\tnan\t1\t1\t.5\tb", "a\t0\t1"):
        path.write_text(text)
        with pytest.raises(MotionError, match=r"Line 1 of clip\.txt is not a label in BEAT"):
            read_semantics(path, 10)


def test_bones_that_stand_still_cover_their_lines_only():
    joints = np.zeros((1, 55, 3))
    joints[:, 21] = [0.5, 0.5, 0.0]  # right wrist, from the elbow at the pelvis
    cells = covered_cells(joints)
    assert PARENTS[21] == 19
    assert cells.sum() == 101 and cells[np.arange(101), 200 + np.arange(101)].all()
