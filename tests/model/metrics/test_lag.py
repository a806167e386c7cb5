"""Is the motion in step with its speech? Made faces that follow made sound, and recordings."""

from dataclasses import replace

import numpy as np
import pytest

from conventions.rates import FPS, SAMPLE_RATE
from model.faults.glitches import speech_lag_or_drift
from model.metrics.lag import find_lag, speech_bands_by_frame
from model.motion.motion import Motion, load_motion, remove_lag
from model.speech.audio import load_speech
from tests.helpers import beat2_folder, smooth_motion_example
from tests.model.faults.test_faults import SKELETON

SECONDS = 30


@pytest.fixture(scope="module")
def sound() -> np.ndarray:
    """Syllables of two colours at random times."""
    rng = np.random.default_rng(3)
    waveform = 1e-3 * rng.normal(size=SECONDS * SAMPLE_RATE)
    at = 0.2
    while at < SECONDS - 0.5:
        span = slice(round(at * SAMPLE_RATE), round((at + rng.uniform(0.08, 0.2)) * SAMPLE_RATE))
        time = np.arange(span.stop - span.start) / SAMPLE_RATE
        hertz = rng.choice([180.0, 420.0, 900.0, 2400.0])
        waveform[span] += rng.uniform(0.1, 0.4) * np.sign(np.sin(2 * np.pi * hertz * time))
        at += rng.uniform(0.15, 0.6)
    return waveform.astype(np.float32)


def speaking(sound: np.ndarray, seed: int = 0, share: float = 0.6) -> Motion:
    """A face that follows the sound's level through a random mixture, with as much of its own."""
    rng = np.random.default_rng(seed)
    motion = smooth_motion_example(SECONDS * FPS, seed)
    level = speech_bands_by_frame(sound).mean(axis=1)
    level = (level - level.mean()) / level.std()
    own = rng.normal(size=(len(level), 4))
    kernel = np.hanning(9) / np.hanning(9).sum()
    own = np.stack([np.convolve(each, kernel, "same") for each in own.T], 1)
    own /= own.std(axis=0)
    mixed = np.hstack([share * level[:, None], (1 - share) * own]) @ rng.normal(size=(5, 20))
    face = np.zeros_like(motion.expressions)
    face[:, 10:30] = 0.2 * mixed
    poses = motion.poses.copy()
    poses[:, 66:69] = 0
    return replace(motion, expressions=face.astype(np.float32), poses=poses)


def moved(motion: Motion, frames: int) -> Motion:
    """As many frames later, its first or last pose held."""
    places = np.arange(motion.num_frames) - frames
    return motion.part(np.clip(places, 0, motion.num_frames - 1))


def stretched(motion: Motion, times: float) -> Motion:
    places = np.arange(round(motion.num_frames * times)) / times
    low = np.clip(places.astype(int), 0, motion.num_frames - 2)
    part = (places - low)[:, None]
    mixed = {
        name: ((1 - part) * values[low] + part * values[low + 1]).astype(np.float32)
        for name in ("poses", "expressions", "trans")
        for values in [getattr(motion, name)]
    }
    return replace(motion, **mixed)


@pytest.mark.parametrize("frames", [-30, -12, 0, 1, 23, 75])
def test_a_lag_is_found_to_half_a_frame_with_its_sign(sound, frames):
    lag = find_lag(moved(speaking(sound), frames), speech_bands_by_frame(sound))
    assert lag.lag_source == "face"
    assert lag.lag_s == pytest.approx(frames / FPS, abs=0.5 / FPS)
    assert lag.lag_low_s <= lag.lag_s <= lag.lag_high_s < lag.lag_low_s + 0.1
    assert lag.lag_drift_s == 0.0


def test_a_lag_between_two_frames_is_told_between_them(sound):
    motion = speaking(sound)
    first, second = (moved(motion, frames).expressions for frames in (12, 13))
    lag = find_lag(replace(motion, expressions=(first + second) / 2), speech_bands_by_frame(sound))
    assert lag.lag_s == pytest.approx(12.5 / FPS, abs=0.2 / FPS)


@pytest.mark.parametrize("times", [0.98, 1.01, 1.05])
def test_a_lag_that_grows_is_told_from_one_that_does_not(sound, times):
    motion = stretched(speaking(sound), times)
    lag = find_lag(motion, speech_bands_by_frame(sound))
    seconds = min(motion.duration_s, SECONDS)
    grows = (1 - 1 / times) * seconds
    assert lag.lag_drift_s == pytest.approx(grows, abs=0.12)
    assert lag.lag_s == pytest.approx(grows / 2, abs=0.06)


def test_nothing_is_told_of_another_speech_of_no_movement_and_of_a_short_clip(sound):
    heard = speech_bands_by_frame(sound)
    motion = speaking(sound)
    still = replace(motion, expressions=np.zeros_like(motion.expressions))
    cut = slice(0, 11 * FPS)
    for other, beside in (
        (motion, heard[::-1]),
        (still, heard),
        (still.part(np.zeros(900, int)), heard),
        (motion, np.zeros_like(heard)),
        (motion.part(cut), heard[cut]),
    ):
        lag = find_lag(other, beside)
        assert not lag.is_detected and np.isnan([lag.lag_s, lag.lag_low_s, lag.lag_drift_s]).all()


def test_arms_that_follow_the_sound_give_ground_where_there_is_no_face(sound):
    motion = speaking(sound)
    level = speech_bands_by_frame(sound).mean(axis=1)
    fast = np.clip(level - level.min(), 0, None) / np.ptp(level)
    poses = motion.poses.copy()
    for joint, sign in ((16, 1), (17, -1), (18, 1), (19, -1)):
        poses[:, 3 * joint : 3 * joint + 3] = 0
        poses[:, 3 * joint] = sign * np.cumsum(fast * np.sign(np.sin(np.arange(900) / 40))) / 30
    still = replace(motion, expressions=np.zeros_like(motion.expressions), poses=poses)
    lag = find_lag(moved(still, 14), speech_bands_by_frame(sound))
    assert lag.lag_source == "body"
    assert lag.lag_s == pytest.approx(14 / FPS, abs=2 / FPS)


def test_a_motion_is_moved_to_where_its_speech_is(sound):
    motion = speaking(sound)
    late, early = moved(motion, 12), moved(motion, -12)
    np.testing.assert_array_equal(remove_lag(late, 0.4).poses, motion.poses[:-12])
    held = remove_lag(early, -0.4)
    np.testing.assert_array_equal(held.poses[12 : 12 + 888], motion.poses[12:])
    assert (held.poses[:12] == motion.poses[12]).all() and held.num_frames == 912
    assert remove_lag(motion, 0.0).num_frames == motion.num_frames
    with pytest.raises(ValueError, match=r"shorter than the motion \(30.0 s\); got -40 s"):
        remove_lag(motion, -40.0)


def test_it_is_a_finding_that_says_how_to_put_it_right(sound):
    from model.diagnostics import analyse_raw

    def told(motion: Motion) -> list:
        return list(
            speech_lag_or_drift(
                analyse_raw(motion, SKELETON, speech_log_mel=speech_bands_by_frame(sound))
            )
        )

    motion = speaking(sound)
    assert told(motion) == [] and told(moved(motion, 3)) == []
    (late,) = told(moved(motion, 12))
    assert late.sentence.startswith("The face moves 0.40 s late relative to the speech (95 %")
    assert "the import setting lag=0.40 (" in late.sentence
    assert late.limit_ratio == pytest.approx(3, abs=0.1)
    (early,) = told(moved(motion, -12))
    assert "0.40 s early" in early.sentence and "lag=-0.40" in early.sentence
    (drifts,) = told(stretched(motion, 1.05))
    assert "The face drifts relative to the speech" in drifts.sentence
    rate = float(drifts.sentence.split("as if ")[1].split()[0])
    assert rate == pytest.approx(31.5, abs=0.15)


@pytest.mark.beat2
@pytest.mark.parametrize("name", ["2_scott_0_1_1", "2_scott_0_2_2"])
def test_recorded_clips_are_placed_to_a_tenth_of_a_second(name):
    """Whole and from pieces of 30 s; `test_lag_figures` has all that docs/formats.md tells."""
    motion = load_motion(beat2_folder() / "smplxflame_30" / f"{name}.npz")
    heard = speech_bands_by_frame(load_speech(beat2_folder() / "wave16k" / f"{name}.wav").waveform)
    length = min(motion.num_frames, len(heard))
    for piece, frames in ((slice(0, length), -30), (slice(300, 1200), 13), (slice(600, 1500), 0)):
        places = np.clip(np.arange(piece.start, piece.stop) - frames, 0, length - 1)
        lag = find_lag(motion.part(places), heard[piece])
        assert lag.is_detected and lag.lag_drift_s == 0.0
        assert lag.lag_s == pytest.approx(frames / FPS, abs=0.1)
