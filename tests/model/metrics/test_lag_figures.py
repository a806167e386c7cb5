"""The figures of lag in docs/formats.md, of every recorded clip there is: ``-s`` prints them."""

import sys
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from conventions.joints import JOINT_INDEX
from conventions.rates import FPS
from model.metrics.lag import find_lag, speech_bands_by_frame
from model.motion.motion import Motion, load_motion
from model.speech.audio import load_speech
from tests.helpers import beat2_folder

pytestmark = [pytest.mark.slow, pytest.mark.beat2]
SHIFTS = tuple(round(0.1 * n * FPS) for n in range(-10, 11))
Clip = tuple[Motion, np.ndarray]


@pytest.fixture(scope="module")
def clips() -> dict[str, Clip]:
    folder = beat2_folder()
    found = {}
    for path in sorted((folder / "smplxflame_30").glob("*.npz")):
        motion = load_motion(path)
        heard = speech_bands_by_frame(load_speech(folder / "wave16k" / f"{path.stem}.wav").waveform)
        length = min(motion.num_frames, len(heard))
        found[path.stem] = motion.part(slice(0, length)), heard[:length]
    return found


def pieces(clip: Clip, seconds: float | None) -> list[tuple[Motion, np.ndarray, int]]:
    """Every second second a piece that lies wholly in the clip, of each shift; or the whole clip,
    less what a shift leaves without a partner."""
    motion, heard = clip
    found = []
    for shift in SHIFTS:
        first, last = max(shift, 0), motion.num_frames + min(shift, 0)
        length = last - first if seconds is None else round(seconds * FPS)
        for at in range(first, last - length + 1, 2 * FPS):
            moved = motion.part(slice(at - shift, at - shift + length))
            found.append((moved, heard[at : at + length], shift))
    return found


def told(title: str, tried: list[tuple[Motion, np.ndarray, int]]) -> tuple[int, int, int]:
    """How many there are, how many are told, and how many of these within a tenth of a second."""
    off = [
        abs(lag.lag_s - shift / FPS)
        for motion, heard, shift in tried
        if (lag := find_lag(motion, heard)).is_detected
    ]
    right = sum(each <= 0.1 for each in off)
    furthest = f", furthest {max(off):.3f} s" if off else ""
    sys.stdout.write(f"{title}: {len(tried)}, told {len(off)}, within .1 s {right}{furthest}\n")
    return len(tried), len(off), right


def test_whole_clips_are_all_within_a_tenth(clips):
    count, known, right = told("whole", [p for clip in clips.values() for p in pieces(clip, None)])
    assert count == known == right


@pytest.mark.parametrize(("seconds", "share"), [(30.0, 0.5), (15.0, 0.3)])
def test_pieces_that_are_told_are_within_a_tenth(clips, seconds, share):
    tried = [p for clip in clips.values() for p in pieces(clip, seconds)]
    count, known, right = told(f"{seconds:g} s", tried[::3])
    assert known >= share * count and right >= 0.9 * known


def test_nothing_is_told_beside_another_speech_or_of_bodies_alone(clips):
    others = [
        (motion.part(slice(at, at + 900)), heard[to : to + 900], 0)
        for (name, (motion, _)), (other, (_, heard)) in product(clips.items(), clips.items())
        if name != other
        for at in range(0, motion.num_frames - 900, 120)
        for to in range(0, len(heard) - 900, 120)
    ]
    _, known, _ = told("another speech", others)
    assert known == 0
    jaw = 3 * JOINT_INDEX["jaw"]
    bodies = []
    for moved, heard, shift in [p for clip in clips.values() for p in pieces(clip, 30.0)][::7]:
        poses = moved.poses.copy()
        poses[:, jaw : jaw + 3] = 0
        still = replace(moved, poses=poses, expressions=np.zeros_like(moved.expressions))
        bodies.append((still, heard, shift))
    _, known, right = told("bodies alone", bodies)
    assert known <= 0.05 * len(bodies) or right >= 0.9 * known
