"""Real files through the real ffmpeg: every kind of upload, good and bad."""

import hashlib
import subprocess
import tracemalloc
import wave
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest
from scipy.io import wavfile

from conventions.rates import SAMPLE_RATE
from model.speech import audio
from model.speech.audio import SpeechError, SpeechLimits, load_speech, write_wav
from model.storage.files import WriteError
from tests.helpers import beat2_folder


def tone(duration_s: float, rate: int = SAMPLE_RATE, hertz: float = 440.0) -> np.ndarray:
    return (0.5 * np.sin(2 * np.pi * hertz * np.arange(round(duration_s * rate)) / rate)).astype(
        np.float32
    )


def encode(source: Path, target: Path, *options: str) -> Path:
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-i", str(source), *options]
    subprocess.run([*command, str(target)], check=True)
    return target


def assert_refused(path: Path, *words: str, limits: SpeechLimits | None = None) -> None:
    with pytest.raises(SpeechError) as caught:
        load_speech(path, limits or SpeechLimits())
    sentence = str(caught.value)
    assert path.name in sentence
    assert sentence.endswith(".") and "\n" not in sentence
    for word in words:
        assert word in sentence


@pytest.fixture
def tone_file(tmp_path: Path) -> Path:
    path = tmp_path / "tone.wav"
    wavfile.write(path, 44100, tone(3.0, 44100))
    return path


@pytest.mark.parametrize("dtype", ["<i2", "<i4", "<f4", "<f8", "u1"])
def test_wav_of_every_sample_type(tmp_path, dtype):
    expected = tone(1.0)
    if dtype == "u1":
        samples = np.round(expected * 127 + 128)
    else:
        samples = expected * {"<i2": 32767, "<i4": 2147483000}.get(dtype, 1)
    wavfile.write(tmp_path / "a.wav", SAMPLE_RATE, samples.astype(dtype))
    speech = load_speech(tmp_path / "a.wav")
    assert speech.waveform.dtype == np.float32
    assert speech.waveform.shape == (SAMPLE_RATE,)
    np.testing.assert_allclose(speech.waveform, expected, atol=0.01 if dtype == "u1" else 1e-4)
    assert speech.notes == ()
    assert speech.duration_s == 1.0
    assert speech.num_frames == 30
    assert speech.sha256 == hashlib.sha256((tmp_path / "a.wav").read_bytes()).hexdigest()


@pytest.mark.parametrize(
    ("suffix", "options"),
    [
        ("flac", ()), ("ogg", ("-c:a", "libvorbis")), ("opus", ()), ("mp3", ()), ("m4a", ()),
        ("webm", ()), ("aiff", ()), ("mka", ()), ("aac", ()),
    ],
)  # fmt: skip
def test_other_formats_keep_length_and_pitch(tmp_path, tone_file, suffix, options):
    speech = load_speech(encode(tone_file, tmp_path / f"a.{suffix}", *options))
    # A bare AAC stream cannot say how much padding it has (one to two blocks of 1024 samples).
    assert abs(speech.duration_s - 3.0) < (0.08 if suffix == "aac" else 0.01)
    spectrum = np.abs(np.fft.rfft(speech.waveform[: 2 * SAMPLE_RATE]))
    assert abs(spectrum.argmax() / 2 - 440) <= 0.5
    assert any("44,100 Hz" in note or "48,000 Hz" in note for note in speech.notes)


def test_a_microphone_recording_without_stated_length(tmp_path, tone_file):
    """Browsers stream WebM: its header says nothing about the length."""
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-i", str(tone_file)]
    piped = subprocess.run([*command, "-f", "webm", "-"], check=True, capture_output=True).stdout
    (tmp_path / "mic.webm").write_bytes(piped)
    speech = load_speech(tmp_path / "mic.webm")
    assert abs(speech.duration_s - 3.0) < 0.01
    assert not any("states" in note for note in speech.notes)


def test_resampling_is_in_time_and_has_no_delay(tmp_path):
    """A click at 1.000 s in a 44.1 kHz file is a click at 1.000 s here."""
    click = np.zeros(2 * 44100, dtype=np.float32)
    click[44100] = 0.9
    wavfile.write(tmp_path / "a.wav", 44100, click)
    speech = load_speech(tmp_path / "a.wav")
    assert abs(int(np.abs(speech.waveform).argmax()) - SAMPLE_RATE) <= 1
    assert abs(len(speech.waveform) - 2 * SAMPLE_RATE) <= 1


def test_the_sound_track_of_a_video(tmp_path, tone_file):
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-f", "lavfi", "-i", "testsrc=d=3"]
    subprocess.run([*command, "-i", str(tone_file), str(tmp_path / "a.mp4")], check=True)
    assert abs(load_speech(tmp_path / "a.mp4").duration_s - 3.0) < 0.05
    subprocess.run([*command, str(tmp_path / "mute.mp4")], check=True)
    assert_refused(tmp_path / "mute.mp4", "not a sound file")


@pytest.mark.beat2
def test_real_speech_has_the_frames_of_its_length():
    speech = load_speech(beat2_folder() / "wave16k" / "2_scott_0_103_103.wav")
    assert speech.num_frames == 1710
    assert speech.notes == ()


def test_eight_channels_at_96_khz_are_mixed_with_a_note(tmp_path):
    wavfile.write(tmp_path / "a.wav", 96000, np.repeat(tone(1.0, 96000)[:, None], 8, axis=1))
    speech = load_speech(tmp_path / "a.wav")
    np.testing.assert_allclose(speech.waveform[100:-100], tone(1.0)[100:-100], atol=2e-3)
    assert "The file has 8 channels; they were mixed to one." in speech.notes


def test_memory_does_not_hold_all_channels(tmp_path):
    source = "aevalsrc='" + "|".join(["0.3*sin(900*t)"] * 8) + "':s=96000:d=40"
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-f", "lavfi", "-i", source]
    subprocess.run([*command, str(tmp_path / "a.wav")], check=True)
    assert (tmp_path / "a.wav").stat().st_size > 60e6
    tracemalloc.start()
    try:
        speech = load_speech(tmp_path / "a.wav")
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert abs(speech.duration_s - 40) < 0.01
    assert peak < 4 * speech.waveform.nbytes + 8e6  # 40 s at 16 kHz are 2.6 MB


def test_channels_that_cancel_do_not_vanish(tmp_path):
    left = tone(1.0)
    wavfile.write(tmp_path / "a.wav", SAMPLE_RATE, np.stack([0.8 * left, -left], axis=1))
    speech = load_speech(tmp_path / "a.wav")
    np.testing.assert_allclose(speech.waveform, -left, atol=1e-4)
    assert any("channel 2" in note and "vanish" in note for note in speech.notes)


def test_speech_on_one_of_two_channels_is_heard(tmp_path):
    left = tone(1.0)
    wavfile.write(tmp_path / "a.wav", SAMPLE_RATE, np.stack([left, np.zeros_like(left)], axis=1))
    np.testing.assert_allclose(load_speech(tmp_path / "a.wav").waveform, 0.5 * left, atol=1e-4)


def test_floats_beyond_full_scale_are_scaled_with_a_note(tmp_path):
    wavfile.write(tmp_path / "a.wav", SAMPLE_RATE, 40000 * tone(1.0))
    speech = load_speech(tmp_path / "a.wav")
    assert abs(np.abs(speech.waveform).max() - 1) < 1e-6
    assert any("times full scale" in note for note in speech.notes)


def test_the_largest_floats_are_scaled_too(tmp_path):
    wavfile.write(tmp_path / "loud.wav", SAMPLE_RATE, np.full((16_000, 2), 3e38, np.float32))
    speech = load_speech(tmp_path / "loud.wav")
    assert np.abs(speech.waveform).max() == pytest.approx(1.0)
    assert any("3e+38 times full scale" in note for note in speech.notes)


def test_missing_file_folder_and_empty_file(tmp_path):
    assert_refused(tmp_path / "none.wav", "does not exist")
    assert_refused(tmp_path, "is a folder")
    (tmp_path / "a.wav").touch()
    assert_refused(tmp_path / "a.wav", "empty (0 bytes)")


def test_no_samples(tmp_path):
    wavfile.write(tmp_path / "a.wav", SAMPLE_RATE, np.zeros(0, dtype=np.int16))
    assert_refused(tmp_path / "a.wav", "0 samples")


def test_too_short(tmp_path):
    wavfile.write(tmp_path / "a.wav", SAMPLE_RATE, tone(0.2))
    assert_refused(tmp_path / "a.wav", "is 0.2 s long; at least 0.5 s are needed")
    wavfile.write(tmp_path / "b.wav", SAMPLE_RATE, tone(0.5))
    assert load_speech(tmp_path / "b.wav").num_frames == 15


@pytest.mark.parametrize("level", [0.0, 3e-5])
def test_silence(tmp_path, level):
    noise = level * np.sign(np.random.default_rng(0).standard_normal(SAMPLE_RATE))
    wavfile.write(tmp_path / "a.wav", SAMPLE_RATE, noise.astype(np.float32))
    assert_refused(tmp_path / "a.wav", "is silent", "zero" if level == 0 else "-90 dB")


@pytest.mark.parametrize(
    "content",
    [
        b"this is just text\n" * 500,
        b"\x89PNG\r\n\x1a\n" + bytes(2000),
        b"%PDF-1.7\n" + bytes(range(256)) * 40,
    ],
)
@pytest.mark.parametrize("suffix", ["wav", "mp3"])
def test_what_is_no_sound(tmp_path, content, suffix):
    (tmp_path / f"a.{suffix}").write_bytes(content)
    assert_refused(tmp_path / f"a.{suffix}", "not a sound file")


@pytest.mark.parametrize(
    "playlist",
    [
        "#EXTM3U\n#EXT-X-TARGETDURATION:3\n#EXTINF:3,\n{target}\n#EXT-X-ENDLIST\n",
        "ffconcat version 1.0\nfile '{target}'\n",
        "v=0\no=- 0 0 IN IP4 127.0.0.1\ns=x\nc=IN IP4 127.0.0.1\nt=0 0\nm=audio 9 RTP/AVP 0\n",
    ],
)
@pytest.mark.parametrize("suffix", ["wav", "m3u8"])
def test_playlists_open_no_other_file(tmp_path, tone_file, playlist, suffix):
    encode(tone_file, tmp_path / "target.ts", "-c:a", "aac")
    path = tmp_path / f"list.{suffix}"
    path.write_text(playlist.format(target=tmp_path / "target.ts"))
    assert_refused(path, "not a sound file")


def test_truncated_mp3_says_how_much_was_read(tmp_path, tone_file):
    whole = encode(tone_file, tmp_path / "a.mp3").read_bytes()
    (tmp_path / "cut.mp3").write_bytes(whole[: len(whole) // 2])
    speech = load_speech(tmp_path / "cut.mp3")
    assert 1.2 < speech.duration_s < 1.7
    assert any(
        note.startswith(f"Only {speech.duration_s:.1f} s of the 3.0 s") for note in speech.notes
    )
    (tmp_path / "stub.mp3").write_bytes(whole[:3000])
    assert_refused(tmp_path / "stub.mp3", "at least 0.5 s")


def test_nan_samples_say_where(tmp_path):
    samples = tone(2.0)
    samples[SAMPLE_RATE : SAMPLE_RATE + 5] = np.nan
    wavfile.write(tmp_path / "a.wav", SAMPLE_RATE, samples)
    assert_refused(tmp_path / "a.wav", "not finite", "1.00 s")
    samples = tone(2.0, 48000)
    samples[48000] = np.inf
    wavfile.write(tmp_path / "b.wav", 48000, samples)
    assert_refused(tmp_path / "b.wav", "not finite")


def test_half_an_hour_is_refused_without_being_held(tmp_path):
    source = "sine=440:duration=1800:sample_rate=8000"
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-f", "lavfi", "-i", source]
    subprocess.run([*command, str(tmp_path / "a.wav")], check=True)
    assert_refused(tmp_path / "a.wav", "longer than 10 minutes, the limit", "--max-minutes")


def test_limits_can_be_set(tmp_path):
    wavfile.write(tmp_path / "a.wav", SAMPLE_RATE, tone(2.0))
    assert_refused(tmp_path / "a.wav", "longer than 1 seconds", limits=SpeechLimits(max_s=1))
    assert_refused(tmp_path / "a.wav", "at least 3 s", limits=SpeechLimits(min_s=3))
    assert_refused(tmp_path / "a.wav", "at most 0 MiB", limits=SpeechLimits(max_bytes=100))
    assert load_speech(tmp_path / "a.wav", SpeechLimits(max_s=2)).duration_s == 2.0


def test_a_decoder_that_hangs_is_killed(tmp_path, monkeypatch):
    """A real child that never ends stands in for ffmpeg."""
    stub = tmp_path / "ffmpeg"
    stub.write_text("#!/bin/sh\nexec sleep 60\n")
    stub.chmod(0o755)
    monkeypatch.setattr(audio, "_TIMEOUT_S", 0.2)
    monkeypatch.setattr(audio.imageio_ffmpeg, "get_ffmpeg_exe", lambda: str(stub))
    wavfile.write(tmp_path / "a.wav", SAMPLE_RATE, tone(1.0))
    assert_refused(tmp_path / "a.wav", "took longer than 0.2 s")


def test_odd_names_are_only_names(tmp_path):
    for name in ("-i.wav", "a b'\".wav", "concat:x.wav", "%d.wav", "http:x.wav", "ü\n.wav"):
        wavfile.write(tmp_path / name, SAMPLE_RATE, tone(0.6))
        assert load_speech(tmp_path / name).num_frames == 18
    (tmp_path / "\n.wav").write_bytes(b"text")
    with pytest.raises(SpeechError, match=r"^\?\.wav is not a sound file"):
        load_speech(tmp_path / "\n.wav")


def test_written_wav_is_16_bit_mono_and_reads_back(tmp_path):
    waveform = tone(1.0) * np.float32(1.9)  # peaks at 0.95
    write_wav(tmp_path / "a.wav", waveform)
    with wave.open(str(tmp_path / "a.wav")) as wav:
        assert (wav.getnchannels(), wav.getsampwidth(), wav.getframerate()) == (1, 2, SAMPLE_RATE)
    np.testing.assert_allclose(load_speech(tmp_path / "a.wav").waveform, waveform, atol=1e-4)
    assert [path.name for path in tmp_path.iterdir()] == ["a.wav"]
    with pytest.raises(WriteError, match="does not exist"):
        write_wav(tmp_path / "none" / "a.wav", waveform)
