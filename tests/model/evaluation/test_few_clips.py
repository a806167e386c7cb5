import json

import numpy as np
import pytest

from model.data.recordings import read_files
from model.evaluate import evaluate, main
from model.evaluation.few_clips import UNKNOWN_SPEAKERS, FewClips, with_silence
from model.evaluation.speakers import LEFT_OUT, calm_over_lively
from model.generation.clip_noise import clip_seed
from model.generation.windows import GenerateOptions, generate_motion
from model.measures.hearing import arm_rotations_alike, speed_in_silence
from model.motion.motion import first_frames
from model.systems.registry import load_system
from tests.model.made import made_speech, make_data_folder, make_weights

CLIPS = ["1_ann_0_0_0", "2_bob_0_1_1", "1_ann_0_2_2"]
PAIR = "bob", "ann"


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    root = tmp_path_factory.mktemp("few")
    return make_data_folder(root / "data", seconds=4), make_weights(root / "weights")


@pytest.fixture(scope="module")
def system(folders):
    return load_system("globaldiff/local", folders[1])


def test_silence_follows_ten_seconds_or_what_there_is():
    for given, kept in ((4, 4), (12, 10)):
        speech = made_speech(16_000 * given)
        heard = with_silence(speech)
        assert heard.num_frames == 30 * (kept + 5)
        end = 16_000 * kept
        np.testing.assert_array_equal(heard.waveform[:end], speech.waveform[:end])
        assert not heard.waveform[end:].any()


def test_numbers_are_those_of_motions_made_one_by_one(folders, system):
    data, _ = folders
    few = FewClips.choose(data, CLIPS, [system], PAIR, count=1)
    name, speech = CLIPS[0], read_files(data, CLIPS[0])[1]
    found = few.measures(system, name, speech, None)
    made = {}
    for speaker in PAIR:
        options = GenerateOptions(speaker, seed=clip_seed(0, name), samples=2)
        made[speaker] = generate_motion(system, with_silence(speech), options)
    spoken = {who: [first_frames(motion, 120) for motion in own] for who, own in made.items()}
    ratio = found["calm_wrist_m_s"] / found["lively_wrist_m_s"]
    assert ratio == pytest.approx(calm_over_lively(spoken["bob"], spoken["ann"]), rel=1e-6)
    alike = [arm_rotations_alike(*pair) for pair in zip(*spoken.values(), strict=True)]
    assert found["arm_rotations_other_speaker"] == pytest.approx(np.mean(alike), abs=1e-6)
    silent = [
        speed_in_silence(motion, np.arange(270) < 120)["arms_in_silence"]
        for own in made.values()
        for motion in own
    ]
    assert found["arms_in_silence"] == pytest.approx(np.mean(silent), rel=1e-6)
    assert few.measures(system, CLIPS[1], speech, None) == {}, "not among the few"


def test_the_table_has_manner_beside_that_of_recordings(folders, system):
    data, _ = folders
    table = evaluate(data, CLIPS, [system], 1, speakers=PAIR)
    motion = table["motion"]
    calm, lively = (read_files(data, name)[0] for name in ("2_bob_0_1_1", "1_ann_0_0_0"))
    wanted = calm_over_lively([calm], [lively])  # bob has one recording
    assert motion["recorded"]["calm_over_lively"]["mean"] == pytest.approx(wanted, rel=1e-6)
    assert set(motion["globaldiff/local"]) >= {
        "calm_over_lively",
        "arms_by_speaker",
        "arm_rotations_other_speaker",
        "arms_in_silence",
    }
    assert "arms_in_silence" not in motion["recorded"], "no silence of 5 s is recorded"
    assert UNKNOWN_SPEAKERS not in table["left_out"]


def test_speakers_that_a_system_does_not_know_are_left_out(folders, system):
    table = evaluate(folders[0], CLIPS, [system], 1)
    assert "calm_over_lively" not in table["motion"]["globaldiff/local"]
    assert table["motion"]["globaldiff/local"]["arms_in_silence"]["mean"] > 0
    assert table["left_out"][-2:] == [UNKNOWN_SPEAKERS, LEFT_OUT]


def test_two_speakers_are_asked_for_by_name(folders, tmp_path, capsys):
    data, weights = folders
    command = ["--data", str(data), "--weights", str(weights), "--out", str(tmp_path)]
    for wrong in ("ann", "ann,ann", ",bob"):
        assert main([*command, "--speakers", wrong]) == 1
        assert "CALM,LIVELY" in capsys.readouterr().err
    split = data / "train_test_split.csv"
    split.write_text(split.read_text().replace("train\n", "test\n"))
    more = ["--systems", "globaldiff/local", "--seeds", "1", "--speakers", "bob,ann"]
    assert main([*command, *more]) == 0
    told = json.loads((tmp_path / "evaluation.json").read_text())["motion"]
    assert told["globaldiff/local"]["calm_over_lively"]["mean"] > 0
    assert "wrist speed, calm over lively speaker" in capsys.readouterr().out
