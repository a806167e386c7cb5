import numpy as np

from app.page.player.timeline import worst_seconds


def point(num_frames: int, **trembles: float) -> np.ndarray:
    """A point that stands still but trembles from a frame on, ``f60=0.01``, for a second."""
    track = np.zeros((num_frames, 3))
    for name, amount_m in trembles.items():
        start = int(name.removeprefix("f"))
        track[start : start + 30 : 2, 0] = amount_m
    return track


def test_seconds_come_by_how_bad_they_are_whichever_motion_they_are_of():
    found = worst_seconds(
        {"a": point(300, f60=0.01, f200=0.03), "b": point(300, f130=0.02)}, count=3
    )
    assert [second["name"] for second in found] == ["a", "b", "a"]
    for second, start in zip(found, (200, 130, 60), strict=True):
        assert abs(second["start_s"] - start / 30) <= 0.1
        assert second["end_s"] - second["start_s"] == 1.0
    jerks = [second["jerk_m_s3"] for second in found]
    assert jerks == sorted(jerks, reverse=True)
    # 15 Hz of amplitude x: third differences of 4 x, in m / (1/30 s)^3.
    assert abs(jerks[0] - 4 * 0.03 * 30**3) < 0.1 * jerks[0]


def test_no_two_seconds_overlap():
    noise = np.random.default_rng(0).normal(0.0, 0.01, (2, 200, 3))
    found = worst_seconds({"a": noise[0], "b": noise[1]}, count=9)
    starts = sorted(second["start_s"] for second in found)
    assert len(starts) >= 3
    assert np.diff(starts).min() >= 1.0


def test_clips_too_short_for_a_second():
    (found,) = worst_seconds({"a": point(20, f5=0.01)})
    assert (found["start_s"], found["end_s"]) == (0.0, round(20 / 30, 4))
    assert worst_seconds({"a": point(3)}) == []
    assert worst_seconds({}) == []
