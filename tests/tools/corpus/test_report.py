"""The report measures what it says: closed forms, planted differences, and a page from a corpus."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from conventions.joints import JOINT_INDEX
from conventions.rates import FPS
from model.motion.motion import save_motion
from model.speech.audio import wav_bytes
from tests.helpers import ROOT, smooth_motion_example
from tools.corpus.people.rig import open_body_rig
from tools.corpus.report import __main__ as report
from tools.corpus.report.measuring import (
    STACKS,
    ReportError,
    hand_inside_share,
    list_clips,
    measure_clips,
    read_phrases,
)
from tools.corpus.report.page import report_page
from tools.corpus.report.realism import (
    alignment_scores,
    area_under_curve,
    ridge_weights,
    sound_features,
)
from tools.corpus.report.statistics import (
    PosedClip,
    clip_statistics,
    window_features,
)


def standing(seconds: float, shake_hz: float) -> PosedClip:
    """The rest pose with a right fingertip that moves by 1 cm at one frequency."""
    rig = open_body_rig()
    time = np.arange(int(seconds * FPS)) / FPS
    rest = np.tile(np.eye(3), (len(time), 55, 1, 1))
    places = np.tile(rig.rest_joints, (len(time), 1, 1))
    shake = 0.01 * np.sin(2 * np.pi * shake_hz * time)
    places[:, 21, 1] += shake
    places[:, 20, 1] += 0.5 * shake
    tip = places[:, 45] + shake[:, None]
    return PosedClip(rest, rest, places, tip)


def test_a_shaking_tip_has_its_power_where_it_shakes():
    key = "fingertip velocity power above 5 Hz, share"
    slow, fast = (clip_statistics(standing(20.0, hz)) for hz in (2.0, 8.0))
    assert slow[key] < 0.01
    assert fast[key] > 0.99
    assert fast["right fingertip jerk, m/s^3"] > 10 * slow["right fingertip jerk, m/s^3"]
    assert abs(slow["right wrist speed, m/s"] - 4 * 0.01 * 2.0) < 0.005  # 4 amplitudes a period
    assert slow["left-right speed correlation"] > 0.99
    assert slow["planted ankle slip, cm/s"] == 0
    assert slow["knee bend, median, deg"] == 0
    assert len(window_features(standing(20.0, 1.0), window_s=4.0)) == 8  # they overlap by half


def test_area_under_the_curve():
    low, high = np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0])
    assert area_under_curve(low, high) == 1.0
    assert area_under_curve(high, low) == 0.0
    assert area_under_curve(low, low) == 0.5
    assert area_under_curve(np.array([1.0, 3.0]), np.array([2.0])) == 0.5


def test_speech_that_drives_a_motion_is_told_from_shifted_speech(tmp_path):
    rng = np.random.default_rng(1)
    features, targets = [], []
    for k in range(4):
        loudness = np.repeat(rng.uniform(0, 1, 40), 12)  # 0.4 s each, 16 s
        samples = 0.2 * np.repeat(loudness, 533) * rng.normal(size=480 * 533)
        path = tmp_path / f"{k}.wav"
        path.write_bytes(wav_bytes(np.clip(samples, -1, 1)))
        features.append(sound_features(path, 480))
        targets.append((loudness - loudness.mean()) / loudness.std())
    assert features[0].shape[0] == 480
    weights = ridge_weights(features[:2], targets[:2])
    right, shifted = alignment_scores(weights, features[2:], targets[2:], 7.0)
    assert right.min() > 0.8
    assert np.abs(shifted).max() < 0.5


def test_a_hand_in_the_belly_is_inside_and_one_at_the_side_or_in_front_is_not():
    rig = open_body_rig()
    rest = np.tile(np.eye(3), (10, 55, 1, 1))

    def with_right_hand_at(place: list[float], turn_deg: float) -> PosedClip:
        places = np.tile(rig.rest_joints, (10, 1, 1))
        hand = [21, *range(40, 55)]
        places[5:, hand] += place - rig.rest_joints[43]  # the middle finger's first joint there
        turn = Rotation.from_euler("XY", [20.0, turn_deg], degrees=True).as_matrix()
        return PosedClip(turn @ rest, turn @ rest, places @ turn.T + [1.0, 2.0, 3.0], places[:, 45])

    for turn_deg in (0.0, 130.0):
        for place, share in (
            ([0.0, -0.2, 0.1], 0.5),
            ([-0.13, -0.6, 0.06], 0.5),  # the right thigh
            ([-0.4, -0.45, 0.05], 0.0),
            ([0.0, -0.2, 0.35], 0.0),
            ([0.0, -0.2, -0.25], 0.0),
        ):
            assert hand_inside_share(with_right_hand_at(place, turn_deg), rig) == share


def test_trunk_and_thighs_have_the_open_bodys_measures():
    """Every slice of the mesh is as wide and deep as the ellipses, within 1 cm."""
    with np.load(ROOT / "renderer" / "assets" / "open_body.npz", allow_pickle=False) as body:
        mesh = body["template"].astype(float)
        strongest = body["weight_shares"].argmax(1)
        moved_by = body["weight_joints"][np.arange(len(mesh)), strongest]
    trunk = [JOINT_INDEX[name] for name in ("pelvis", "spine1", "spine2", "spine3", "neck")]
    collars_hips = [JOINT_INDEX[f"{s}_{p}"] for s in ("left", "right") for p in ("collar", "hip")]
    joints = {
        "trunk": trunk + collars_hips,
        "left thigh": [JOINT_INDEX["left_hip"]],
        "right thigh": [JOINT_INDEX["right_hip"]],
    }
    for name, rows in STACKS.items():
        for height, *ellipse in rows:
            level = np.abs(mesh[:, 1] - height) < 0.012
            places = mesh[level & np.isin(moved_by, joints[name])][:, [0, 2]]
            low, high = places.min(0), places.max(0)
            measured = np.concatenate([(low + high) / 2, (high - low) / 2])
            np.testing.assert_allclose(measured, ellipse, atol=0.01)


def test_phrases_are_runs_of_words_between_pauses(tmp_path):
    rows = [(0, 0.5, ""), (0.5, 1, "one"), (1, 1.1, ""), (1.1, 2, "two"), (2, 3, "three")]
    rows += [(3, 4, "four"), (4, 5, "five"), (5, 5.2, ""), (5.2, 6, "too"), (6, 7, "short")]
    intervals = "".join(
        f"        intervals [1]:\n            xmin = {a}\n            xmax = {b}\n"
        f'            text = "{word}"\n'
        for a, b, word in rows
    )
    path = tmp_path / "a.TextGrid"
    tier = '    item [1]:\n        class = "IntervalTier"\n        name = "{}"\n'
    path.write_text(tier.format("words") + intervals + tier.format("phones") + intervals)
    assert read_phrases(path) == ("one two three four five",)


def copies_of(corpus: Path, root: Path, names: list[str]) -> Path:
    """A data folder whose clips are all the one of the corpus."""
    for folder, suffix in (("smplxflame_30", "npz"), ("wave16k", "wav"), ("textgrid", "TextGrid")):
        (root / folder).mkdir(parents=True)
        for name in names:
            shutil.copy(next((corpus / folder).iterdir()), root / folder / f"{name}.{suffix}")
    (root / "train_test_split.csv").write_text(
        "id,type\n" + "".join(f"{name},test\n" for name in names)
    )
    return root


@pytest.mark.slow
def test_the_page_names_every_speaker_and_shows_pictures(corpus, tmp_path, capsys):
    assert report.main(["--data", str(tmp_path), "--out", str(tmp_path / "page.md")]) == 1
    assert "holds no clips in BEAT2's layout" in capsys.readouterr().err
    assert not (tmp_path / "page.md").exists()
    out = tmp_path / "docs" / "corpus.md"
    out.parent.mkdir()
    assert report.main(["--data", str(corpus), "--real", str(corpus), "--out", str(out)]) == 0
    page = out.read_text()
    assert "| figure | **1_anna_0_0_0** |" in page
    assert "of seed 3 of 2 speakers" in page
    assert page.count("Too few clips to say.") == 2
    for name in ("corpus_gestures.png", "corpus_speakers.png"):
        assert f"(figures/{name})" in page
        assert (out.parent / "figures" / name).read_bytes().startswith(b"\x89PNG")


def test_clips_that_cannot_be_used_are_named_and_left_out(corpus, tmp_path, caplog):
    names = ["1_a_0_1_1", "1_a_0_2_2", "1_a_0_3_3", "1_a_0_4_4", "1_a_0_5_5"]
    root = copies_of(corpus, tmp_path / "real", names)
    (root / "smplxflame_30" / "1_a_0_1_1.npz").write_bytes(b"no npz")
    (root / "wave16k" / "1_a_0_2_2.wav").write_bytes(b"no wav")
    (root / "wave16k" / "1_a_0_3_3.wav").unlink()
    short = smooth_motion_example(179)
    save_motion(short, root / "smplxflame_30" / "1_a_0_4_4.npz")
    with caplog.at_level("WARNING"):
        clips = measure_clips(list_clips(root), open_body_rig(), "Measuring")
    assert [clip.clip_id for clip in clips] == ["1_a_0_5_5"]
    for words in ("Skipped 1_a_0_1_1: ", "Skipped 1_a_0_2_2: ", "179 frames; at least 180"):
        assert words in caplog.text
    assert "1 of the 5 clips" in caplog.text
    (root / "smplxflame_30" / "1_a_0_5_5.npz").write_bytes(b"no npz")
    with pytest.raises(ReportError, match="None of the 4 clips could be used"):
        measure_clips(list_clips(root), open_body_rig(), "Measuring")
    with (root / "train_test_split.csv").open("a") as table:
        table.write("../real/smplxflame_30/../../real/1_a_0_1_1,test\n1_a/../1_a_0_1_1,test\n")
    assert [clip.clip_id for clip in list_clips(root)] == [n for n in names if n[-1] != "3"]


def test_the_page_says_what_gives_the_corpus_away(corpus, tmp_path):
    """Copies of one clip as real and as corpus cannot be told apart; a changed figure can."""
    root = copies_of(corpus, tmp_path / "real", [f"1_a_0_{k}_{k}" for k in range(4)])
    clips = measure_clips(list_clips(root), open_body_rig(), "Measuring")
    assert "is reached." in report_page({"a": clips[:2]}, clips[2:], None)
    shaky = [
        replace(
            clip,
            realism=clip.realism | {"wrist jerk, m/s^3": clip.realism["wrist jerk, m/s^3"] + 500.0},
        )
        for clip in clips[:2]
    ]
    page = report_page({"a": shaky}, clips[2:], None)
    assert "area under the curve of **1.00**" in page
    assert "is missed." in page
    assert re.search(r"\| wrist jerk, m/s\^3 \|.*\| 1.00 \| 0.50 \| 100% \|", page)
    spoken = len(clips[0].phrases)
    assert f"Of {2 * spoken} runs of five and more words between pauses, {spoken} (50.0%)" in page
