"""Videos, read back by another library than the one that wrote them."""

from pathlib import Path

import av
import numpy as np
import pytest
from scipy.io import wavfile

from renderer.video.encoder import VideoError, VideoWriter, probe_video, run_ffmpeg

SIZE = (96, 64)
SAMPLE_RATE = 16_000


def write_wav(path: Path, waveform: np.ndarray) -> Path:
    wavfile.write(path, SAMPLE_RATE, (32_000 * np.clip(waveform, -1, 1)).astype("<i2"))
    return path


def tone(duration_s: float) -> np.ndarray:
    return 0.3 * np.sin(2 * np.pi * 220 * np.arange(int(duration_s * SAMPLE_RATE)) / SAMPLE_RATE)


def write_video(
    out: Path, levels: np.ndarray, speech_wav: Path | None = None, size=SIZE, tint=(1, 1, 1)
) -> Path:
    """One plain frame for each brightness in ``levels`` (0 to 255)."""
    with VideoWriter(out, *size, len(levels), speech_wav) as video:
        for level in levels:
            frame = np.full((size[1], size[0], 3), level) * np.asarray(tint)
            video.write(frame.astype(np.uint8))
    return out


def decoded_frames(path: Path) -> np.ndarray:
    with av.open(str(path)) as file:
        return np.stack([frame.to_ndarray(format="rgb24") for frame in file.decode(video=0)])


def decoded_sound(path: Path) -> tuple[np.ndarray, int]:
    """Samples as a player plays them: what the edit list cuts off is cut off."""
    with av.open(str(path)) as file:
        stream = file.streams.audio[0]
        blocks, rate = [], stream.rate
        for frame in file.decode(stream):
            block = frame.to_ndarray()[0]
            start = round(float(frame.pts * frame.time_base) * rate)
            blocks.append(block[max(0, -start) :])
        return np.concatenate(blocks), rate


@pytest.mark.parametrize(("num_frames", "sound_s"), [(7, None), (1, 4.0), (45, 0.1), (45, 4.0)])
def test_frames_rate_format_and_sound(tmp_path, num_frames, sound_s):
    wav = None if sound_s is None else write_wav(tmp_path / "s.wav", tone(sound_s))
    path = write_video(tmp_path / "v.mp4", np.full(num_frames, 120), wav)
    with av.open(str(path)) as file:
        video = file.streams.video[0]
        assert video.frames == num_frames
        assert video.average_rate == 30
        assert video.codec_context.name == "h264"
        assert video.codec_context.pix_fmt == "yuv420p"
        assert (video.width, video.height) == SIZE
        assert float(video.duration * video.time_base) == pytest.approx(num_frames / 30, abs=1e-3)
        assert len(file.streams.audio) == (0 if sound_s is None else 1)
        if sound_s is not None:
            audio = file.streams.audio[0]
            assert audio.codec_context.name == "aac"
            duration_s = float(audio.duration * audio.time_base)
            assert duration_s == pytest.approx(num_frames / 30, abs=1 / 30)
    assert len(decoded_frames(path)) == num_frames
    assert list(tmp_path.glob(".*")) == []
    facts = probe_video(path)
    assert (facts.width, facts.height, facts.num_frames) == (*SIZE, num_frames)
    data = path.read_bytes()
    assert 0 < data.find(b"moov") < data.find(b"mdat"), "a browser reads the index first"


def test_colours_order_and_rows_survive(tmp_path):
    path = tmp_path / "v.mp4"
    colors = [(200, 40, 40), (40, 190, 60), (50, 60, 200), (228, 230, 234)]
    with VideoWriter(path, *SIZE, 5, crf=8) as video:
        for color in colors:
            video.write(np.tile(np.array(color, np.uint8), (SIZE[1], SIZE[0], 1)))
        frame = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
        frame[: SIZE[1] // 2] = 220
        video.write(frame)
    *frames, halves = decoded_frames(path).astype(int)
    np.testing.assert_allclose(np.mean(frames, axis=(1, 2)), colors, atol=4)
    assert halves[5].mean() > 200 and halves[-5].mean() < 20, "the upper row first"


def test_flashes_and_claps_coincide_for_a_minute(tmp_path):
    num_frames, flashes = 1800, (0, 903, 1799)
    levels = np.isin(np.arange(num_frames), flashes) * 255
    waveform = np.zeros(num_frames * SAMPLE_RATE // 30)
    for frame in flashes:
        start = round(frame / 30 * SAMPLE_RATE)
        waveform[start : start + 80] = 0.9 * (-1.0) ** np.arange(80)
    wav = write_wav(tmp_path / "s.wav", waveform)
    seen = decoded_frames(write_video(tmp_path / "v.mp4", levels, wav)).mean(axis=(1, 2, 3))
    sound, rate = decoded_sound(tmp_path / "v.mp4")
    assert np.flatnonzero(seen > 128).tolist() == list(flashes)
    for frame in flashes:
        first = max(0, round((frame - 10) / 30 * rate))
        heard = first + int(np.abs(sound[first : round((frame + 10) / 30 * rate)]).argmax())
        assert abs(heard / rate - frame / 30) < 1 / 30


def test_sound_with_a_gap_in_its_time_stamps_stays_in_time(tmp_path):
    clap = np.zeros(2 * SAMPLE_RATE)
    clap[SAMPLE_RATE : SAMPLE_RATE + 80] = 0.9
    wav, gap = write_wav(tmp_path / "s.wav", clap), tmp_path / "gap.mka"
    run_ffmpeg("-i", str(wav), "-af", "asetpts=PTS+1.5/TB*gte(T\\,.5)", str(gap))
    write_video(tmp_path / "v.mp4", np.zeros(120), gap)
    sound, rate = decoded_sound(tmp_path / "v.mp4")
    assert abs(np.abs(sound).argmax() / rate - 2.5) < 0.05 and abs(len(sound) / rate - 4) < 0.1


def test_an_exception_leaves_an_older_file_and_no_process(tmp_path):
    path = write_video(tmp_path / "v.mp4", np.arange(3))
    before = path.read_bytes()
    with pytest.raises(KeyboardInterrupt), VideoWriter(path, *SIZE, 90) as video:
        video.write(np.zeros((SIZE[1], SIZE[0], 3), np.uint8))
        raise KeyboardInterrupt
    assert [(each, each.read_bytes()) for each in tmp_path.iterdir()] == [(path, before)]
    assert processes_that_mention(tmp_path) == []


def test_what_cannot_be_written_is_said_and_leaves_no_file(tmp_path):
    with pytest.raises(VideoError, match=r"nowhere is not a folder"):
        write_video(tmp_path / "nowhere" / "v.mp4", np.arange(3))
    with pytest.raises(VideoError, match=r"gone\.wav"):
        write_video(tmp_path / "v.mp4", np.arange(300), tmp_path / "gone.wav")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "v.mp4").mkdir()
    with pytest.raises(VideoError, match=r"v\.mp4 cannot be written"):
        write_video(tmp_path / "v.mp4", [10, 20])
    assert [p.name for p in tmp_path.iterdir()] == ["v.mp4"]
    (tmp_path / "no.mp4").write_text("no video")
    with pytest.raises(VideoError, match=r"no\.mp4 cannot be read as a video"):
        probe_video(tmp_path / "no.mp4")


def test_an_ffmpeg_that_fails_is_quoted(tmp_path, monkeypatch):
    fake = tmp_path / "ffmpeg"
    fake.write_text('#!/bin/sh\necho "No space left on device" >&2\nexit 1\n')
    fake.chmod(0o755)
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(fake))
    with pytest.raises(VideoError, match="its last message: No space left on device"):
        write_video(tmp_path / "v.mp4", np.arange(300))
    assert [path.name for path in tmp_path.iterdir()] == ["ffmpeg"]


def test_a_missing_ffmpeg_is_named(tmp_path, monkeypatch):
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(tmp_path / "gone"))
    with pytest.raises(VideoError, match=r"gone is not an ffmpeg.*unset IMAGEIO_FFMPEG_EXE"):
        write_video(tmp_path / "v.mp4", np.arange(3))
    with pytest.raises(VideoError, match="is not an ffmpeg"):
        probe_video(tmp_path / "v.mp4")
    assert list(tmp_path.iterdir()) == []


def processes_that_mention(folder: Path) -> list[str]:
    """Command lines of running processes that name the folder."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            command = (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
        except OSError:  # it has just ended
            continue
        if str(folder) in command and "pytest" not in command:
            found.append(command)
    return found
