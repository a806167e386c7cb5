import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from model.evaluate import main
from model.evaluation.clips import ClipContext
from model.evaluation.matching import MEASURES, matched, pieces, preferred, spoken
from model.evaluation.one_clip import read_recording
from model.motion.motion import first_frames, load_motion
from model.speech.audio import load_speech
from model.speech.features import MelEncoder
from model.storage.cards import BUNDLED_WEIGHTS
from model.systems.matching.config import HEARING_JUDGE
from model.systems.matching.network import load_judge
from tests.helpers import ROOT, beat2_folder
from tests.model.made import make_data_folder, make_weights
from tests.model.systems.matching.made import (
    made_envelope,
    made_features,
    made_motion,
    save_judge,
    save_task,
    trained,
)

NAMES = ["1_ann_0_0_0", "2_bob_0_1_1"]
EXAMPLES = ROOT / "examples"
FRAMES = 1500
ENVELOPES = [made_envelope(FRAMES, seed) for seed in (101, 102)]
OWN, FOREIGN = (made_features(envelope) for envelope in ENVELOPES)


@pytest.fixture(scope="module")
def judge(tmp_path_factory):
    folder = tmp_path_factory.mktemp("judge")
    save_task(trained(folder)[0], folder)
    return load_judge(folder, HEARING_JUDGE)


def test_the_own_speech_is_preferred_and_another_is_not(judge):
    motion = made_motion(ENVELOPES[0])
    found = matched(judge, motion, OWN, FOREIGN)
    assert set(found) == {*MEASURES, "arm_speed_heard"}
    assert found["matched_arms"] > 0.95 and found["arm_speed_heard"] > 0.8
    swapped = matched(judge, motion, FOREIGN, OWN)
    # The own speech is among the foreign pieces now, and beats all that stand beside it.
    assert swapped["matched_arms"] < 0.5 and swapped["arm_speed_heard"] < 0.3


def test_who_stands_still_is_at_chance(judge):
    motion = made_motion(ENVELOPES[0])
    still = replace(motion, poses=np.repeat(motion.poses[:1], FRAMES, axis=0))
    found = matched(judge, still, OWN, FOREIGN)
    assert [found[measure] for measure in MEASURES] == [0.5] * 3
    assert found["arm_speed_heard"] == pytest.approx(0, abs=1e-3)


def test_a_jaw_that_gives_all_away_is_not_seen_in_the_body(judge):
    motion = made_motion(ENVELOPES[0])
    poses = motion.poses.copy()
    poses[:, 66:69] = 0.1 * ENVELOPES[0][:, None]
    talking = matched(judge, replace(motion, poses=poses), OWN, FOREIGN)
    mute = matched(judge, motion, OWN, FOREIGN)
    assert talking["matched"] == mute["matched"]
    assert talking["matched_face"] != 0.5 == mute["matched_face"]


def test_silence_around_the_speech_is_cut_away(judge):
    silence = np.full((200, 68), -2.0, np.float32)
    silence[:, 67] = 0.0
    motion = made_motion(ENVELOPES[0])
    late = replace(
        first_frames(made_motion(np.zeros(FRAMES + 400)), FRAMES + 400),
        poses=np.concatenate(
            [motion.poses[:1].repeat(200, 0), motion.poses, motion.poses[-1:].repeat(200, 0)]
        ),
    )
    padded = np.concatenate([silence, OWN, silence])
    assert spoken(padded) == slice(200, 200 + FRAMES)
    found = matched(judge, late, padded, np.concatenate([silence, FOREIGN]))
    assert found == pytest.approx(matched(judge, motion, OWN, FOREIGN), abs=1e-6)


def test_less_than_ten_seconds_have_no_measure(judge):
    motion, short = made_motion(ENVELOPES[0]), OWN[:299]
    assert matched(judge, motion, short, FOREIGN) == {}
    assert matched(judge, motion, OWN, FOREIGN[:299]) == {}
    assert matched(judge, first_frames(motion, 299), OWN, FOREIGN) == {}
    quiet = OWN.copy()
    quiet[:, 67] = 0.0  # nobody speaks
    assert matched(judge, motion, quiet, FOREIGN) == {}
    assert matched(judge, first_frames(motion, 300), OWN, FOREIGN) != {}


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Clips of 11 s, and tiny systems."""
    root = tmp_path_factory.mktemp("evaluation")
    data = make_data_folder(root / "data", seconds=11)
    split = (data / "train_test_split.csv").read_text()
    (data / "train_test_split.csv").write_text(split.replace("train\n", "test\n"))
    return data, make_weights(root / "weights")


def test_the_table_has_a_row_for_recorded_and_generated_motion(folders, judge, tmp_path, capsys):
    data, weights = folders
    command = ["--data", str(data), "--systems", "globaldiff/local", "--seeds", "1"]
    command += ["--processes", "1", "--out", str(tmp_path / "out")]
    assert main([*command, "--weights", str(weights)]) == 0
    text = capsys.readouterr().out
    assert f"Matched speech is left out: its judge {HEARING_JUDGE} is not among" in text
    assert "matched, share right" not in text
    judged = shutil.copytree(weights, tmp_path / "weights")
    save_judge(judge, judged)
    assert main([*command, "--weights", str(judged)]) == 0  # what was kept knew no judge
    text = capsys.readouterr().out
    assert "Matched speech is left out" not in text
    assert "| matched, share right | " in text and "| of the jaw | " in text
    table = json.loads((tmp_path / "out" / "evaluation.json").read_text())
    for row in ("recorded", "globaldiff/local"):
        for measure in (*MEASURES, "arm_speed_heard"):
            found = table["motion"][row][measure]
            assert found["low"] <= found["mean"] <= found["high"]
    context = ClipContext(
        recorded=read_recording(data, NAMES[0]).motion,
        sound=read_recording(data, NAMES[0]).speech.waveform,
        foreign=read_recording(data, NAMES[1]).speech.waveform,
        mean_speed=np.ones(13),
        judges={},
        matching=judge,
    )
    alone = context.row([context.recorded]).measures
    mean = table["motion"]["recorded"]["matched"]["mean"]
    assert alone["matched"] in (0.0, 0.5, 1.0)  # one piece against one
    assert mean in (alone["matched"] / 2 + other / 2 for other in (0.0, 0.5, 1.0))


def test_pieces_lie_end_to_end_and_a_rest_is_left_out():
    rows = np.arange(700.0)[:, None]
    cut = pieces(rows)
    assert cut.shape == (2, 300, 1)
    assert cut[0, 0] == 0 and cut[1, 0] == 300 and cut[1, -1] == 599
    assert pieces(rows[:299]).shape == (0, 300, 1)


def test_ties_count_half():
    own = torch.tensor([0.5, 0.2])
    others = torch.tensor([[0.4, 0.6, 0.5], [0.1, 0.1, 0.1]])
    assert preferred(own, others) == pytest.approx((1 + 0 + 0.5 + 3) / 6)


@pytest.fixture(scope="module")
def bundled():
    return load_judge(BUNDLED_WEIGHTS, HEARING_JUDGE)


def features_of(path: Path) -> np.ndarray:
    speech = load_speech(path)
    return MelEncoder().encode(speech.waveform, speech.num_frames)


def test_the_bundled_judge_finds_the_speech_of_the_example(bundled):
    assert (BUNDLED_WEIGHTS / f"{HEARING_JUDGE}.safetensors").stat().st_size < 2_000_000
    motion = load_motion(next((EXAMPLES / "procedural_speaker").glob("*.npz")))
    own = features_of(next((EXAMPLES / "procedural_speaker").glob("*.wav")))
    late = replace(motion, poses=np.roll(motion.poses, 30, axis=0))
    for path in sorted(EXAMPLES.glob("*.wav")):
        found = matched(bundled, motion, own, features_of(path))
        assert [found[measure] for measure in MEASURES] == [1.0] * 3
        assert found["arm_speed_heard"] > 0.1
    agreed = [
        bundled.agreements(
            pieces(m.poses[spoken(own)]), pieces(own[spoken(own)]), MEASURES["matched"]
        ).item()
        for m in (motion, late)
    ]
    assert agreed[0] > 0.5 > 0.3 > agreed[1]


def test_the_bundled_judge_reads_the_lips_of_real_people(bundled):
    folder = beat2_folder()
    recordings = [read_recording(folder, name) for name in ("2_scott_0_1_1", "2_scott_0_2_2")]
    heard = [
        MelEncoder().encode(each.speech.waveform, each.speech.num_frames) for each in recordings
    ]
    for each, own, foreign in zip(recordings, heard, heard[::-1], strict=True):
        found = matched(bundled, each.motion, own, foreign)
        assert found["matched_face"] > 0.9
        assert found["matched"] > 0.5  # far from what it finds in the corpus
