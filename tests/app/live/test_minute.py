import numpy as np
import pytest

from app.errors import RunError
from app.live.minute import KEPT_FRAMES, LastMinute
from tests.helpers import smooth_motion_example

MOTION = smooth_motion_example(4000)


def spoken(seconds: float, piece: int = 13) -> LastMinute:
    """Sound whose samples count, a second ahead of frames that count."""
    minute = LastMinute()
    frames = round(30 * seconds)
    sound = np.arange(round(16_000 * (seconds + 1)), dtype=np.float32)
    for first in range(0, len(sound), 640):
        minute.add_sound(sound[first : first + 640])
        known = int((first - 16_000) / 16_000 * 30)
        while minute._next_frame + piece <= min(known, frames):
            start = minute._next_frame
            minute.add_motion(MOTION.part(slice(start, start + piece)))
    return minute


@pytest.mark.parametrize("seconds", [5.0, 59.9, 61.3, 100.0])
def test_what_is_kept_is_the_last_minute_with_its_own_sound(seconds: float) -> None:
    minute = spoken(seconds)
    end = minute._next_frame
    kept = minute.kept()
    first = max(0, end - KEPT_FRAMES)
    assert kept.first_frame == first and kept.motion.num_frames == end - first
    np.testing.assert_array_equal(kept.motion.poses, MOTION.poses[first:end])
    start = round(first * 16_000 / 30)
    assert kept.waveform[0] == start
    assert len(kept.waveform) == round((end - first) * 16_000 / 30)
    np.testing.assert_array_equal(np.diff(kept.waveform), 1)
    assert (kept.motion.trans[0, [0, 2]] == 0).all()


def test_it_holds_no_more_than_a_minute_and_a_little() -> None:
    minute = spoken(100)
    frames = sum(piece.num_frames for piece in minute._pieces)
    samples = sum(len(piece) for piece in minute._sound)
    assert frames < KEPT_FRAMES + 26
    assert samples < 16_000 * 63


def test_too_little_is_told() -> None:
    with pytest.raises(RunError, match="speak for at least 2 s"):
        spoken(1.5).kept()
    with pytest.raises(RunError, match="no live motion"):
        LastMinute().kept()
