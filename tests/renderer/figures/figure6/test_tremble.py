"""The strips of Figure 6: what is off the slow path, and whether one sees who trembles more."""

import numpy as np
import pytest

from renderer.figures.figure6.figure6 import draw_figure6
from renderer.figures.figure6.spec import MIN_FRAMES, check_figure6, off_the_slow_path
from renderer.figures.files import matplotlib_settings

FPS = 30.0
INSIDE = slice(30, -30)


def wave(hertz: float, metres: float, num_frames: int = 300) -> np.ndarray:
    t = np.arange(num_frames) / FPS
    return metres * np.stack([np.sin(2 * np.pi * hertz * t + k) for k in range(3)], axis=1)


@pytest.mark.parametrize(("hertz", "kept"), [(1.0, 0.0), (2.0, 0.0), (5.0, 0.5), (10.0, 1.0)])
def test_what_is_slow_is_taken_away_and_what_is_fast_stays(hertz, kept):
    """Forwards and backwards, a Butterworth filter halves what lies at its cut-off."""
    off = off_the_slow_path(wave(hertz, 0.01), FPS)[INSIDE]
    assert np.abs(off - kept * 1000 * wave(hertz, 0.01)[INSIDE]).max() < 0.1


def test_a_tremble_on_a_wide_path_is_told_in_millimetres():
    track = wave(0.5, 0.3) + wave(9.0, 0.002)
    rms = np.sqrt(np.square(off_the_slow_path(track, FPS)[INSIDE]).sum(1).mean())
    assert rms == pytest.approx(2.0 * np.sqrt(3 / 2), rel=0.02)


def figure_of(tracks: dict[str, np.ndarray], start_frame: int = 0):
    contents = check_figure6(tracks, {}, (), FPS, start_frame=start_frame)
    with matplotlib_settings():
        return draw_figure6(contents)


def test_each_motion_has_a_strip_on_one_scale_with_its_rms():
    quiet, loud = wave(0.5, 0.3) + wave(9.0, 0.001), wave(0.5, 0.3) + wave(9.0, 0.004)
    figure = figure_of({"quiet": quiet, "loud": loud})
    strips = {a.get_label(): a for a in figure.axes if str(a.get_label()).startswith("tremble")}
    assert list(strips) == ["tremble of quiet", "tremble of loud"]
    reach = {
        name: max(np.abs(np.asarray(line.get_ydata())[INSIDE]).max() for line in axes.lines)
        for name, axes in strips.items()
    }
    assert reach["tremble of loud"] == pytest.approx(4 * reach["tremble of quiet"], rel=0.05)
    assert len({axes.get_ylim() for axes in strips.values()}) == 1
    told = [text.get_text() for text in figure.texts]
    rms = [np.sqrt(np.square(off_the_slow_path(t, FPS)).sum(1).mean()) for t in (quiet, loud)]
    assert [f"{value:.1f} mm rms" in told for value in rms] == [True, True]


def test_the_window_sees_what_lies_before_it():
    """The filter starts at the clip's beginning, so a window has no ringing at its own."""
    track = wave(0.5, 0.3, 600) + wave(9.0, 0.001, 600)
    whole = off_the_slow_path(track, FPS)
    figure = figure_of({"a": track}, start_frame=300)
    strip = next(a for a in figure.axes if a.get_label() == "tremble of a")
    assert np.allclose(np.asarray(strip.lines[0].get_ydata()), whole[300:, 0])
    assert np.allclose(np.asarray(strip.lines[0].get_xdata()), np.arange(300, 600) / FPS)


def test_too_short_a_window_has_none():
    short = {"a": wave(1.0, 0.1, MIN_FRAMES - 1)}
    assert not [a for a in figure_of(short).axes if "tremble" in str(a.get_label())]
