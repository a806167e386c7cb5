"""Several videos in one, beside and over each other, read back."""

from pathlib import Path
from typing import get_args

import av
import numpy as np
import pytest

from processes.job import Cancelled
from renderer.scene.camera_setup import Panel
from renderer.video.compose import (
    FLICKER_FRAMES,
    OverlayMode,
    SuperposedPair,
    compose_videos,
    draw_label_band,
    fit_grid,
    label_band_height,
    split_into_rows,
)
from renderer.video.encoder import VideoError
from tests.renderer.video.test_encoder import (
    SIZE,
    decoded_frames,
    processes_that_mention,
    tone,
    write_video,
    write_wav,
)

TINTS = ((1, 0.2, 0.2), (0.2, 1, 0.2), (0.2, 0.2, 1), (1, 1, 0.2), (0.2, 1, 1), (1, 0.2, 1))


@pytest.mark.parametrize("count", [1, 3])
def test_videos_run_in_lock_step_under_their_labels(tmp_path, count):
    levels = np.linspace(40, 220, 12)
    videos = [
        write_video(tmp_path / f"{i}.mp4", levels, tint=TINTS[i], size=(128, 96))
        for i in range(count)
    ]
    wav = write_wav(tmp_path / "s.wav", tone(1.0))
    shares: list[float] = []
    out = tmp_path / "all.mp4"
    compose_videos(videos, [f"name/{i}" for i in range(count)], out, wav, on_progress=shares.append)
    frames = decoded_frames(out).astype(float)
    band = label_band_height(96)
    assert frames.shape == (12, 96 + band, 128 * count, 3)
    for i in range(count):
        picture = frames[:, band + 8 : -8, 128 * i + 8 : 128 * (i + 1) - 8].mean(axis=(1, 2))
        np.testing.assert_allclose(picture, levels[:, None] * TINTS[i], atol=14)
        label = frames[:, : band - 2, 128 * i : 128 * (i + 1)]
        assert label.max() > 240 and label.min() < 110
    with av.open(str(out)) as file:
        audio = file.streams.audio[0]
        assert float(audio.duration * audio.time_base) == pytest.approx(12 / 30, abs=1 / 30)
    assert shares == sorted(shares) and shares[-1] == 1.0


@pytest.mark.parametrize(
    ("count", "width", "height"),
    [(3, 512, 512), (5, 640, 1280), (5, 640, 640), (2, 1080, 1080), (4, 1920, 300)],
)
def test_a_comparison_fits_a_screen_with_pictures_as_large_as_can_be(count, width, height):
    grid = fit_grid(count, width, height)
    assert [i for row in grid.rows for i in row] == list(range(count))
    assert (
        grid.width <= 1920
        and len(grid.rows) * (grid.picture_height + grid.label_band_height_px) <= 1080
    )
    others = [fit_grid(count, width, height, columns) for columns in range(1, count + 1)]
    assert grid.picture_width == max(other.picture_width for other in others) <= width
    rows = split_into_rows(count, width)
    assert [i for row in rows for i in row] == list(range(count))
    assert len(rows[0]) == 1 or len(rows[0]) * width <= 1920


def test_rows_stand_below_one_another_each_under_its_labels(tmp_path, monkeypatch):
    monkeypatch.setattr("renderer.video.compose.MAX_WIDTH_PX", 400)
    monkeypatch.setattr("renderer.video.compose.MAX_HEIGHT_PX", 10_000)
    levels, size = np.linspace(40, 220, 4), (126, 96)
    videos = [
        write_video(tmp_path / f"{i}.mp4", levels, tint=TINTS[i], size=size) for i in range(5)
    ]
    out = tmp_path / "all.mp4"
    compose_videos(videos, [f"name {i}" for i in range(5)], out)
    frames = decoded_frames(out).astype(float)
    band = label_band_height(96)
    assert frames.shape == (4, 2 * (96 + band), 3 * 126, 3)
    places = [(0, 0), (0, 126), (0, 252), (1, 62), (1, 188)]  # the short row in the middle
    for tint, (row, left) in zip(TINTS, places, strict=False):
        top = row * (96 + band) + band
        picture = frames[:, top + 8 : top + 88, left + 8 : left + 118].mean(axis=(1, 2))
        np.testing.assert_allclose(picture, levels[:, None] * tint, atol=14)
        label = frames[:, top - band : top - 2, left : left + 126]
        assert label.max() > 240 and label.min() < 110
    assert frames[:, -50:, :50].min() > 240, "beside the short row nothing is drawn"
    monkeypatch.setattr("renderer.video.compose.MAX_WIDTH_PX", 128)
    monkeypatch.setattr("renderer.video.compose.MAX_HEIGHT_PX", 100)
    compose_videos(videos[:2], ["a", "b"], out)
    frames = decoded_frames(out).astype(float)
    height = 2 * int(64 / 126 * 96 / 2)
    band = label_band_height(min(64, height))
    assert frames.shape == (4, height + band, 128, 3), "made smaller"
    for i in range(2):
        picture = frames[:, band + 8 : -8, 64 * i + 8 : 64 * (i + 1) - 8].mean(axis=(1, 2))
        np.testing.assert_allclose(picture, levels[:, None] * TINTS[i], atol=14)


def test_a_shorter_video_holds_its_last_frame(tmp_path):
    long = write_video(tmp_path / "a.mp4", np.linspace(20, 200, 12))
    short = write_video(tmp_path / "b.mp4", np.linspace(20, 200, 12)[:5])
    compose_videos([long, short], ["a", "b"], tmp_path / "all.mp4")
    right = decoded_frames(tmp_path / "all.mp4")[:, 40:, SIZE[0] + 8 :].mean(axis=(1, 2, 3))
    assert len(right) == 12
    np.testing.assert_allclose(right[5:], right[4], atol=3)
    assert right[4] > right[3] + 5


def test_labels_stay_within_their_picture():
    band = draw_label_band(["short", "a label that is far too long for its picture " * 3], 200, 200)
    assert band.shape == (label_band_height(200), 400, 3)
    dark = (band.astype(int).sum(axis=2) < 380).any(axis=0)
    assert dark[:200].any() and dark[200:].any()
    assert not dark[196:203].any() and not dark[-3:].any()
    one, several = (draw_label_band([text], 300, 400) for text in ("a b c", "a\n b\r\n\tc"))
    np.testing.assert_array_equal(one, several)
    assert draw_label_band(["\n"], 300, 400).min() == 255


def test_what_cannot_be_composed_is_refused_and_composing_can_be_cancelled(tmp_path):
    a = write_video(tmp_path / "a.mp4", np.arange(3))
    b = write_video(tmp_path / "b.mp4", np.arange(3), size=(64, 64))
    out = tmp_path / "all.mp4"
    with pytest.raises(VideoError, match=r"b.mp4 has 64 x 64 pixels and a.mp4 has 96 x 64"):
        compose_videos([a, b], ["a", "b"], out)
    with pytest.raises(Cancelled):
        compose_videos([a, a], ["a", "b"], out, should_cancel=lambda: True)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.mp4", "b.mp4"]
    assert processes_that_mention(tmp_path) == []


WIDTH, HEIGHT, SIDE = 128, 96, 32
BODY = Panel("front", SIDE, 0, WIDTH - 2 * SIDE, HEIGHT)
HAND = Panel("left_hand", WIDTH - SIDE, 0, SIDE, HEIGHT)
LIGHT, DARK = 200, 60


def pair_of(overlay: OverlayMode) -> SuperposedPair:
    return SuperposedPair(overlay, WIDTH, HEIGHT, BODY, (HAND,), wipe_position_px=20)


def laid(tmp_path: Path, overlay: OverlayMode) -> np.ndarray:
    """Frames under the band: the first light and without its right side, the second dark."""
    first = write_video(tmp_path / "a.mp4", np.full(40, LIGHT), size=(WIDTH - SIDE, HEIGHT))
    second = write_video(tmp_path / "b.mp4", np.full(31, DARK), size=(WIDTH, HEIGHT))
    speech = write_wav(tmp_path / "speech.wav", tone(2.0))
    out = tmp_path / "pair.mp4"
    compose_videos([first, second], ["one", "two"], out, speech, pair=pair_of(overlay))
    frames = decoded_frames(out).astype(int)
    band = label_band_height(WIDTH // 2)
    assert frames.shape == (40, HEIGHT + band, WIDTH, 3), "as long as the longer"
    names = frames[0, : band - 2].min(axis=(0, 2)) < 120
    assert names[: WIDTH // 2].any() and names[WIDTH // 2 :].any(), "each has its name above"
    return frames[:, band:]


def colour(frames: np.ndarray, frame: int, column: int) -> np.ndarray:
    return frames[frame, 20:-20, column - 3 : column + 3].mean(axis=(0, 1))


@pytest.mark.parametrize("overlay", get_args(OverlayMode))
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
    pair = SuperposedPair("ghost", 64, 64, Panel("front", 0, 0, 64, 64))
    compose_videos(videos, ["a", "b"], tmp_path / "out.mp4", pair=pair)
    frames = decoded_frames(tmp_path / "out.mp4").astype(int)[:, label_band_height(32) :]
    light = 140
    both = [light, 0x5E + (1 - 0x5E / 255) * light, light]  # what either ink leaves least of
    assert colour(frames, 2, 32) == pytest.approx(both, abs=8)


def test_a_picture_that_does_not_fit_is_refused(tmp_path):
    large = write_video(tmp_path / "a.mp4", np.arange(3), size=(256, 256))
    with pytest.raises(VideoError, match="fit in the overlay"):
        compose_videos([large, large], ["a", "b"], tmp_path / "out.mp4", pair=pair_of("wipe"))
    assert not (tmp_path / "out.mp4").exists()
