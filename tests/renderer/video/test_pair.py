"""Two videos over each other, read back."""

from pathlib import Path

import numpy as np
import pytest

from renderer.scene.panels import Panel
from renderer.video.compose import band_height
from renderer.video.encoder import VideoError
from renderer.video.pair import FLICKER_FRAMES, OVERLAYS, Overlay, PairLayout, compose_pair
from tests.renderer.video.test_encoder import decoded_frames, tone, write_video, write_wav

WIDTH, HEIGHT, SIDE = 128, 96, 32
BODY = Panel("front", SIDE, 0, WIDTH - 2 * SIDE, HEIGHT)
HAND = Panel("left_hand", WIDTH - SIDE, 0, SIDE, HEIGHT)
LAYOUT = PairLayout(WIDTH, HEIGHT, BODY, (HAND,), edge=20)
LIGHT, DARK = 200, 60


def laid(tmp_path: Path, overlay: Overlay, layout: PairLayout = LAYOUT) -> np.ndarray:
    """Frames under the band: the first light and without its right side, the second dark."""
    first = write_video(tmp_path / "a.mp4", np.full(40, LIGHT), size=(WIDTH - SIDE, HEIGHT))
    second = write_video(tmp_path / "b.mp4", np.full(31, DARK), size=(WIDTH, HEIGHT))
    speech = write_wav(tmp_path / "speech.wav", tone(2.0))
    out = tmp_path / "pair.mp4"
    compose_pair([first, second], ["one", "two"], overlay, layout, out, speech)
    frames = decoded_frames(out).astype(int)
    band = band_height(WIDTH // 2)
    assert frames.shape == (40, HEIGHT + band, WIDTH, 3), "as long as the longer"
    names = frames[0, : band - 2].min(axis=(0, 2)) < 120
    assert names[: WIDTH // 2].any() and names[WIDTH // 2 :].any(), "each has its name above"
    return frames[:, band:]


def colour(frames: np.ndarray, frame: int, column: int) -> np.ndarray:
    return frames[frame, 20:-20, column - 3 : column + 3].mean(axis=(0, 1))


@pytest.mark.parametrize("overlay", OVERLAYS)
def test_close_ups_stand_on_their_own_side_of_what_is_laid_over(tmp_path, overlay):
    frames = laid(tmp_path, overlay)
    for frame in (0, 20, 39):
        assert colour(frames, frame, SIDE // 2) == pytest.approx([LIGHT] * 3, abs=6)
        assert colour(frames, frame, WIDTH - SIDE // 2) == pytest.approx([DARK] * 3, abs=6)
        if overlay == "ghost":  # the second alone is dark: in its own ink, #0072b2
            dark = DARK / 255
            inked = [255 * (ink + (1 - ink) * dark) for ink in (0, 0x72 / 255, 0xB2 / 255)]
            assert colour(frames, frame, WIDTH // 2) == pytest.approx(inked, abs=10)
    if overlay == "wipe":  # which ends where it was put
        assert colour(frames, 5, SIDE + 20 - 6) == pytest.approx([LIGHT] * 3, abs=8)
        assert colour(frames, 5, SIDE + 20 + 6) == pytest.approx([DARK] * 3, abs=8)
        assert frames[5, 30:-30, SIDE + 20 : SIDE + 22].mean() > 215, "with a line between them"
    if overlay == "flicker":  # turns of half a second
        seen = [colour(frames, frame, WIDTH // 2)[0] > 130 for frame in range(40)]
        assert seen == [frame // FLICKER_FRAMES % 2 == 0 for frame in range(40)]


def test_two_that_agree_are_dark_in_both_inks_of_a_ghost(tmp_path):
    videos = [write_video(tmp_path / f"{i}.mp4", np.full(4, 140), size=(64, 64)) for i in (0, 1)]
    body = Panel("front", 0, 0, 64, 64)
    compose_pair(videos, ["a", "b"], "ghost", PairLayout(64, 64, body), tmp_path / "out.mp4")
    frames = decoded_frames(tmp_path / "out.mp4").astype(int)[:, band_height(32) :]
    light = 140
    both = [light, 0x5E + (1 - 0x5E / 255) * light, light]  # what either ink leaves least of
    assert colour(frames, 2, 32) == pytest.approx(both, abs=8)


def test_a_picture_that_does_not_fit_is_refused(tmp_path):
    large = write_video(tmp_path / "a.mp4", np.arange(3), size=(256, 256))
    with pytest.raises(VideoError, match="larger than the picture"):
        compose_pair([large, large], ["a", "b"], "wipe", LAYOUT, tmp_path / "out.mp4")
    assert not (tmp_path / "out.mp4").exists()
