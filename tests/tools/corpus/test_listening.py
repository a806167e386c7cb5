"""While a speaker listens hands rest, the mouth is shut, and eyes and head go on."""

import numpy as np
import pytest

from conventions.joints import JOINT_INDEX
from conventions.rates import FPS
from tools.corpus.clip import Clip, make_clip
from tools.corpus.people.rig import matrices, open_body_rig
from tools.corpus.people.speaker import SPEAKERS
from tools.corpus.words.prosody import LISTENING_S

from .test_clip import kinematics, speed_deg_s

ARMS = [
    JOINT_INDEX[f"{side}_{part}"] for side in ("left", "right") for part in ("shoulder", "elbow")
]
SETTLED_S, WAKES_S = 1.1, 0.6


@pytest.fixture(scope="module")
def listeners(flite: None) -> list[Clip]:
    """A minute and a half of three speakers who rest in different ways."""
    named = {speaker.name: speaker for speaker in SPEAKERS}
    return [
        make_clip(open_body_rig(), named[name], "train", 90.0, [31, named[name].number])
        for name in ("ben", "anna", "pia")
    ]


def is_silent(clip: Clip) -> np.ndarray:
    """Whether the hands must lie, for each step from a frame to the next."""
    time_s = np.arange(len(clip.poses) - 1) / FPS
    silent = np.zeros(len(time_s), dtype=bool)
    for span in clip.utterance.listening:
        start_s = span.start_s + SETTLED_S * (span.start_s > 0)
        end_s = span.end_s - WAKES_S * (span.end_s < clip.utterance.duration_s - 0.1)
        silent |= (time_s > start_s) & (time_s < end_s)
    return silent


def speaks(clip: Clip) -> np.ndarray:
    time_s = np.arange(len(clip.poses) - 1) / FPS
    spans = clip.utterance.listening
    return ~np.any([(time_s > s.start_s) & (time_s < s.end_s) for s in spans], axis=0)


def test_listening_is_long_and_lies_between_words(listeners: list[Clip]) -> None:
    spans = [span for clip in listeners for span in clip.utterance.listening]
    assert len(spans) >= 3
    for span in spans:
        assert LISTENING_S[0] - 0.05 <= span.end_s - span.start_s <= LISTENING_S[1] + 0.3
    for clip in listeners:
        for span in clip.utterance.listening:
            assert not any(
                w.start_s < span.end_s - 0.01 and w.end_s > span.start_s + 0.01
                for w in clip.utterance.words
            )


def test_arms_and_jaw_are_still_in_silence(listeners: list[Clip]) -> None:
    ratios = []
    for clip in listeners:
        local = matrices(clip.poses.astype(np.float64).reshape(-1, 55, 3))
        silent, spoken = is_silent(clip), speaks(clip)
        arms = speed_deg_s(local[:, ARMS]).sum(axis=1)
        jaw = speed_deg_s(local[:, JOINT_INDEX["jaw"]])
        ratios.append(arms[silent].mean() / arms[spoken].mean())
        assert jaw[silent].mean() < 0.08 * jaw[spoken].mean()
        assert (
            np.degrees(clip.poses.reshape(-1, 55, 3)[1:][silent][:, JOINT_INDEX["jaw"], 0]).max()
            < 1.5
        )
    assert np.mean(ratios) < 0.25


def test_both_hands_come_down(listeners: list[Clip]) -> None:
    for clip in listeners:
        _, _, positions = kinematics(clip)
        silent = np.flatnonzero(is_silent(clip))
        height = positions[silent][:, [20, 21], 1] - positions[silent][:, [9], 1]
        assert np.median(height) < -0.12


def test_eyes_blink_and_the_head_nods_while_listening(listeners: list[Clip]) -> None:
    blinks = nods = seconds = 0.0
    for clip in listeners:
        for span in clip.utterance.listening:
            seconds += span.end_s - span.start_s
            blinks += sum(span.start_s < b.time_s < span.end_s for b in clip.events.blinks)
            nods += sum(span.start_s < n.time_s < span.end_s for n in clip.events.nods)
    assert 8 < 60 * blinks / seconds < 35
    assert nods >= 2


def test_blinks_come_about_twenty_times_a_minute_in_any_ten_seconds(listeners: list[Clip]) -> None:
    for clip in listeners:
        times = np.array([blink.time_s for blink in clip.events.blinks])
        assert 15 < 60 * len(times) / clip.utterance.duration_s < 25
        for start_s in np.arange(0, clip.utterance.duration_s - 10, 1.0):
            assert 1 <= ((times >= start_s) & (times < start_s + 10)).sum() <= 6


def test_lids_are_shut_when_a_blink_says_so(listeners: list[Clip]) -> None:
    lid = open_body_rig().expression_names.index("eyeBlinkLeft")
    for clip in listeners:
        for blink in clip.events.blinks:
            frame = round(blink.time_s * FPS)
            assert clip.expressions[frame - 1 : frame + 2, lid].max() > 0.75
