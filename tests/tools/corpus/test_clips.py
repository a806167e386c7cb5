"""A clip moves like a person who speaks and listens: alive, at human speeds, feet still."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from conventions.joints import JOINT_INDEX
from conventions.rates import FPS
from model.diagnostics import diagnose
from model.generation.base import Windowing
from model.motion.kinematics import open_body_skeleton
from tests.tools.corpus.made_motion import motion_of
from tools.corpus.clip import CorpusClip, make_clip
from tools.corpus.people.rig import forward_kinematics, matrices, open_body_rig
from tools.corpus.people.speaker import SPEAKERS

pytestmark = pytest.mark.slow

LIVELY, CALM = "ewan", "hana"
NAMED = {speaker.name: speaker for speaker in SPEAKERS}


@pytest.fixture(scope="module")
def clips(flite: None) -> dict[str, CorpusClip]:
    """Half a minute of a lively, a calm and a left-handed speaker."""
    return {
        name: make_clip(open_body_rig(), NAMED[name], "train", 30.0, [7, NAMED[name].number])
        for name in (LIVELY, CALM, "gus")
    }


def kinematics(clip: CorpusClip) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    local = matrices(clip.poses.astype(np.float64).reshape(-1, 55, 3))
    return local, *forward_kinematics(open_body_rig(), local, clip.trans.astype(np.float64))


def speed_deg_s(rotmat: np.ndarray) -> np.ndarray:
    step = np.swapaxes(rotmat[:-1], -1, -2) @ rotmat[1:]
    angle = Rotation.from_matrix(step.reshape(-1, 3, 3)).magnitude()
    return np.degrees(angle).reshape(step.shape[:-2]) * FPS


@pytest.fixture(params=[LIVELY, CALM, "gus"])
def clip(request: pytest.FixtureRequest, clips: dict[str, CorpusClip]) -> CorpusClip:
    return clips[request.param]


def test_strokes_end_on_stressed_vowels(clip):
    beats = np.array([w.beat_s for w in clip.utterance.words])
    strokes = [
        key.arrive_s
        for keys in clip.plan.keys.values()
        for key in keys
        if key.phase == "stroke" and 0 < key.arrive_s < clip.utterance.duration_s
    ]
    assert len(strokes) > 8
    late = np.array([t - beats[np.abs(beats - t).argmin()] for t in strokes])
    assert abs(np.median(late)) < 0.06
    assert np.percentile(np.abs(late), 80) < 0.16


def test_the_jaw_opens_in_vowels_and_lips_close_in_bilabials(clip):
    jaw = np.degrees(clip.poses.reshape(-1, 55, 3)[:, JOINT_INDEX["jaw"], 0])
    assert jaw.min() >= 0
    assert jaw.max() < 14

    def mean_jaw(names: set[str]) -> float:
        frames = [
            int(FPS * 0.5 * (p.start_s + p.end_s)) for p in clip.utterance.phones if p.name in names
        ]
        return float(jaw[frames].mean())

    assert mean_jaw({"aa", "ao", "ae", "ay", "aw"}) > 2 * mean_jaw({"p", "b", "m"})
    assert mean_jaw({"p", "b", "m"}) < 3.0


def test_no_fault_is_found_in_any_clip(clips):
    for clip in clips.values():
        motion = motion_of(clip)
        cuts = [motion, *(motion.part(slice(start, start + 300)) for start in range(0, 900, 300))]
        for cut in cuts:
            for windows in ({}, {"a": Windowing(60, 8)}):
                found = diagnose({"a": cut}, open_body_skeleton(), windows=windows).findings
                assert found == {"a": []}


ARMS = [
    JOINT_INDEX[f"{side}_{part}"] for side in ("left", "right") for part in ("shoulder", "elbow")
]
SETTLED_S, WAKES_S = 1.1, 0.6


@pytest.fixture(scope="module")
def listeners(flite: None) -> list[CorpusClip]:
    """A minute and a half of three speakers who rest in different ways."""
    return [
        make_clip(open_body_rig(), NAMED[name], "train", 90.0, [31, NAMED[name].number])
        for name in ("ben", "anna", "pia")
    ]


def is_silent(clip: CorpusClip) -> np.ndarray:
    """Whether the hands must lie, for each step from a frame to the next."""
    time_s = np.arange(len(clip.poses) - 1) / FPS
    silent = np.zeros(len(time_s), dtype=bool)
    for span in clip.utterance.listening:
        start_s = span.start_s + SETTLED_S * (span.start_s > 0)
        end_s = span.end_s - WAKES_S * (span.end_s < clip.utterance.duration_s - 0.1)
        silent |= (time_s > start_s) & (time_s < end_s)
    return silent


def speaks(clip: CorpusClip) -> np.ndarray:
    time_s = np.arange(len(clip.poses) - 1) / FPS
    spans = clip.utterance.listening
    return ~np.any([(time_s > s.start_s) & (time_s < s.end_s) for s in spans], axis=0)


def test_arms_and_jaw_are_still_in_silence(listeners):
    ratios = []
    for clip in listeners:
        local = matrices(clip.poses.astype(np.float64).reshape(-1, 55, 3))
        silent, spoken = is_silent(clip), speaks(clip)
        arms = speed_deg_s(local[:, ARMS]).sum(axis=1)
        jaw = speed_deg_s(local[:, JOINT_INDEX["jaw"]])
        _, _, positions = kinematics(clip)
        lying = np.flatnonzero(silent)
        height = positions[lying][:, [20, 21], 1] - positions[lying][:, [9], 1]
        assert np.median(height) < -0.12, "both hands come down"
        ratios.append(arms[silent].mean() / arms[spoken].mean())
        assert jaw[silent].mean() < 0.08 * jaw[spoken].mean()
        assert (
            np.degrees(clip.poses.reshape(-1, 55, 3)[1:][silent][:, JOINT_INDEX["jaw"], 0]).max()
            < 1.5
        )
    assert np.mean(ratios) < 0.25
