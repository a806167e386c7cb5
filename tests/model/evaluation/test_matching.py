"""Whether motion belongs to its speech, as a judge hears it and as loudness tells."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from model.evaluation.classifiers import (
    BODY_PARTS_OF_METRIC,
    frame_loudness_db,
    matched_speech_metrics,
    piece_tensors,
    speech_span,
    win_rate,
)
from model.evaluation.clips import read_recording_cut_to_speech
from model.motion.motion import first_frames, load_motion
from model.speech.audio import load_speech
from model.speech.features import MelEncoder
from model.storage.cards import BUNDLED_WEIGHTS
from model.systems.helpers.config import MATCHING_NETWORK
from model.systems.helpers.matching import load_matcher
from tests.helpers import ROOT, beat2_folder
from tests.model.systems.helpers.made_matching import (
    made_envelope,
    made_features,
    made_motion,
    make_judge,
)

EXAMPLES = ROOT / "examples"
FRAMES = 1500
ENVELOPES = [made_envelope(FRAMES, seed) for seed in (101, 102)]
OWN, FOREIGN = (made_features(envelope) for envelope in ENVELOPES)


@pytest.fixture(scope="module")
def bundled():
    return load_matcher(BUNDLED_WEIGHTS, MATCHING_NETWORK)


@pytest.fixture(scope="module")
def judge(made_once):
    return load_matcher(made_once("judge", make_judge), MATCHING_NETWORK)


def test_the_own_speech_is_preferred_and_another_is_not(judge):
    motion = made_motion(ENVELOPES[0])
    found = matched_speech_metrics(judge, motion, OWN, FOREIGN)
    assert set(found) == {*BODY_PARTS_OF_METRIC, "arm_speed_heard"}
    assert found["matched_arms"] > 0.95 and found["arm_speed_heard"] > 0.8
    swapped = matched_speech_metrics(judge, motion, FOREIGN, OWN)
    # The own speech is among the foreign pieces now, and beats all that stand beside it.
    assert swapped["matched_arms"] < 0.5 and swapped["arm_speed_heard"] < 0.3


def test_a_jaw_that_gives_all_away_is_not_seen_in_the_body(judge):
    motion = made_motion(ENVELOPES[0])
    poses = motion.poses.copy()
    poses[:, 66:69] = 0.1 * ENVELOPES[0][:, None]
    talking = matched_speech_metrics(judge, replace(motion, poses=poses), OWN, FOREIGN)
    mute = matched_speech_metrics(judge, motion, OWN, FOREIGN)
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
    assert speech_span(padded) == slice(200, 200 + FRAMES)
    found = matched_speech_metrics(judge, late, padded, np.concatenate([silence, FOREIGN]))
    assert found == pytest.approx(matched_speech_metrics(judge, motion, OWN, FOREIGN), abs=1e-6)


def test_less_than_ten_seconds_have_no_measure(judge):
    motion, short = made_motion(ENVELOPES[0]), OWN[:299]
    assert matched_speech_metrics(judge, motion, short, FOREIGN) == {}
    assert matched_speech_metrics(judge, motion, OWN, FOREIGN[:299]) == {}
    assert matched_speech_metrics(judge, first_frames(motion, 299), OWN, FOREIGN) == {}
    quiet = OWN.copy()
    quiet[:, 67] = 0.0  # nobody speaks
    assert matched_speech_metrics(judge, motion, quiet, FOREIGN) == {}
    assert matched_speech_metrics(judge, first_frames(motion, 300), OWN, FOREIGN) != {}


def features_of(path: Path) -> np.ndarray:
    speech = load_speech(path)
    return MelEncoder().encode(speech.waveform, speech.num_motion_frames)


def test_the_bundled_judge_finds_the_speech_of_the_example(bundled):
    assert (BUNDLED_WEIGHTS / f"{MATCHING_NETWORK}.safetensors").stat().st_size < 2_000_000
    motion = load_motion(next((EXAMPLES / "procedural_speaker").glob("*.npz")))
    own = features_of(next((EXAMPLES / "procedural_speaker").glob("*.wav")))
    late = replace(motion, poses=np.roll(motion.poses, 30, axis=0))
    for path in sorted(EXAMPLES.glob("*.wav")):
        found = matched_speech_metrics(bundled, motion, own, features_of(path))
        assert [found[measure] for measure in BODY_PARTS_OF_METRIC] == [1.0] * 3
        assert found["arm_speed_heard"] > 0.1
    agreed = [
        bundled.agreements(
            piece_tensors(m.poses[speech_span(own)]),
            piece_tensors(own[speech_span(own)]),
            BODY_PARTS_OF_METRIC["matched"],
        ).item()
        for m in (motion, late)
    ]
    assert agreed[0] > 0.5 > 0.3 > agreed[1]


def test_the_bundled_judge_reads_the_lips_of_real_people(bundled):
    folder = beat2_folder()
    recordings = [
        read_recording_cut_to_speech(folder, name) for name in ("2_scott_0_1_1", "2_scott_0_2_2")
    ]
    heard = [
        MelEncoder().encode(speech.waveform, speech.num_motion_frames) for _, speech in recordings
    ]
    for (motion, _), own, foreign in zip(recordings, heard, heard[::-1], strict=True):
        found = matched_speech_metrics(bundled, motion, own, foreign)
        assert found["matched_face"] > 0.9
        assert found["matched"] > 0.5  # far from what it finds in the corpus


def test_loudness_is_in_decibels_by_frame_and_silent_after_the_end():
    tone = np.concatenate([np.ones(16_000), 0.1 * np.ones(16_000)]).astype(np.float32)
    loudness = frame_loudness_db(tone, 70)
    np.testing.assert_allclose(loudness[[0, 29, 30, 59]], [0, 0, -20, -20], atol=0.1)
    np.testing.assert_allclose(loudness[60:], -60)


def test_who_stands_still_is_at_chance_and_ties_count_half(judge):
    motion = made_motion(ENVELOPES[0])
    still = replace(motion, poses=np.repeat(motion.poses[:1], FRAMES, axis=0))
    found = matched_speech_metrics(judge, still, OWN, FOREIGN)
    assert [found[measure] for measure in BODY_PARTS_OF_METRIC] == [0.5] * 3
    assert found["arm_speed_heard"] == pytest.approx(0, abs=1e-3)
    others = torch.tensor([[0.4, 0.6, 0.5], [0.1, 0.1, 0.1]])
    assert win_rate(torch.tensor([0.5, 0.2]), others) == pytest.approx((1 + 0 + 0.5 + 3) / 6)
