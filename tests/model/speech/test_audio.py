"""Real files through the real ffmpeg: every kind of upload, good and bad."""

import hashlib
import re
import subprocess
import tracemalloc
import wave
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest
from scipy.io import wavfile

from app.errors import RunError
from app.run.requests.parts import parse_channel
from conventions.rates import SAMPLE_RATE
from model.speech import audio
from model.speech.audio import SpeechError, SpeechReadOptions, load_speech, write_wav
from model.storage.files import WriteError
from tests.helpers import beat2_folder


def tone(duration_s: float, rate: int = SAMPLE_RATE, hertz: float = 440.0) -> np.ndarray:
    time_s = np.arange(round(duration_s * rate)) / rate
    return (0.5 * np.sin(2 * np.pi * hertz * time_s)).astype(np.float32)


def hertz_of(waveform: np.ndarray) -> int:
    power = np.abs(np.fft.rfft(waveform[: 2 * SAMPLE_RATE]))
    return int(power.argmax() / 2)


def ffmpeg(*arguments: str | Path) -> bytes:
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", *map(str, arguments)]
    return subprocess.run(command, check=True, capture_output=True).stdout


def written(
    folder: Path, samples: np.ndarray, rate: int = SAMPLE_RATE, name: str = "a.wav"
) -> Path:
    wavfile.write(folder / name, rate, samples)
    return folder / name


def encode(source: Path, target: Path, *options: str) -> Path:
    ffmpeg("-i", source, *options, target)
    return target


def assert_refused(path: Path, *words: str, options: SpeechReadOptions | None = None) -> None:
    with pytest.raises(SpeechError) as caught:
        load_speech(path, options or SpeechReadOptions())
    sentence = str(caught.value)
    assert path.name in sentence and sentence.endswith(".") and "\n" not in sentence
    for word in words:
        assert word in sentence


@pytest.fixture(scope="module")
def tone_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("tone"), tone(3.0, 44100), 44100)


@pytest.mark.parametrize(
    ("dtype", "scale", "offset"),
    [("<i2", 32767, 0), ("<i4", 2147483000, 0), ("<f4", 1, 0), ("<f8", 1, 0), ("u1", 127, 128)],
)
def test_wav_of_every_sample_type(tmp_path, dtype, scale, offset):
    samples = tone(1.0) * np.float64(scale) + offset
    path = written(tmp_path, (np.round(samples) if offset else samples).astype(dtype))
    speech = load_speech(path)
    assert speech.waveform.dtype == np.float32 and speech.waveform.shape == (SAMPLE_RATE,)
    np.testing.assert_allclose(speech.waveform, tone(1.0), atol=0.01 if dtype == "u1" else 1e-4)
    assert (speech.notes, speech.duration_s, speech.num_motion_frames) == ((), 1.0, 30)
    assert speech.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.parametrize(
    ("suffix", "options"),
    [
        ("flac", ()), ("ogg", ("-c:a", "libvorbis")), ("opus", ()), ("mp3", ()), ("m4a", ()),
        ("webm", ()), ("aiff", ()), ("mka", ()), ("aac", ()),
    ],
)  # fmt: skip
def test_other_formats_keep_length_and_pitch(tmp_path, tone_file, suffix, options):
    ffmpeg("-i", tone_file, *options, tmp_path / f"a.{suffix}")
    speech = load_speech(tmp_path / f"a.{suffix}")
    # A bare AAC stream cannot say how much padding it has (one to two blocks of 1024 samples).
    assert abs(speech.duration_s - 3.0) < (0.08 if suffix == "aac" else 0.01)
    assert hertz_of(speech.waveform) == 440
    assert any("44,100 Hz" in note or "48,000 Hz" in note for note in speech.notes)


def test_a_microphone_recording_without_stated_length_and_the_sound_of_a_video(tmp_path, tone_file):
    """Browsers stream WebM: its header says nothing about the length."""
    (tmp_path / "mic.webm").write_bytes(ffmpeg("-i", tone_file, "-f", "webm", "-"))
    speech = load_speech(tmp_path / "mic.webm")
    assert abs(speech.duration_s - 3.0) < 0.01
    assert not any("states" in note for note in speech.notes)
    picture = ("-f", "lavfi", "-i", "testsrc=d=3:s=64x64")
    ffmpeg(*picture, "-i", tone_file, tmp_path / "a.mp4")
    assert abs(load_speech(tmp_path / "a.mp4").duration_s - 3.0) < 0.05
    ffmpeg(*picture, tmp_path / "mute.mp4")
    assert_refused(tmp_path / "mute.mp4", "not a sound file")


def test_resampling_is_in_time_and_has_no_delay(tmp_path):
    """A click at 1.000 s in a 44.1 kHz file is a click at 1.000 s here."""
    click = np.zeros(2 * 44100, dtype=np.float32)
    click[44100] = 0.9
    speech = load_speech(written(tmp_path, click, 44100))
    assert abs(int(np.abs(speech.waveform).argmax()) - SAMPLE_RATE) <= 1
    assert abs(len(speech.waveform) - 2 * SAMPLE_RATE) <= 1


@pytest.mark.beat2
def test_real_speech_has_the_frames_of_its_length():
    speech = load_speech(beat2_folder() / "wave16k" / "2_scott_0_103_103.wav")
    assert speech.num_motion_frames == 1710 and speech.notes == ()


def test_channels_are_mixed_and_such_as_cancel_do_not_vanish(tmp_path):
    eight = np.repeat(tone(1.0, 96000)[:, None], 8, axis=1)
    speech = load_speech(written(tmp_path, eight, 96000))
    np.testing.assert_allclose(speech.waveform[100:-100], tone(1.0)[100:-100], atol=2e-3)
    assert "The file has 8 channels; they were mixed to one." in speech.notes
    left = tone(1.0)
    speech = load_speech(written(tmp_path, np.stack([0.8 * left, -left], axis=1)))
    np.testing.assert_allclose(speech.waveform, -left, atol=1e-4)
    assert any("channel 2" in note and "cancel" in note for note in speech.notes)
    speech = load_speech(written(tmp_path, np.stack([left, np.zeros_like(left)], axis=1)))
    np.testing.assert_allclose(speech.waveform, 0.5 * left, atol=1e-4)


def test_memory_holds_neither_all_channels_nor_what_is_beyond_the_limit(tmp_path):
    """10 s at 16 kHz are 0.64 MB, and 10 s of eight channels 30 MB."""
    path = written(tmp_path, np.full((10 * 96_000, 8), 1000, np.int16), 96_000)
    for options in (SpeechReadOptions(), SpeechReadOptions(max_s=2)):
        tracemalloc.start()
        try:
            if options.max_s > 10:
                assert abs(load_speech(path, options).duration_s - 10) < 0.01
            else:
                assert_refused(path, "longer than the limit of 2 seconds", options=options)
            peak = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
        assert peak < 4 * 640_000 + 8e6


def test_floats_beyond_full_scale_are_scaled_with_a_note(tmp_path):
    for samples, says in (
        (40000 * tone(1.0), "times full scale"),
        (np.full((16_000, 2), 3e38, np.float32), "3e+38 times full scale"),
    ):
        speech = load_speech(written(tmp_path, samples))
        assert np.abs(speech.waveform).max() == pytest.approx(1.0)
        assert any(says in note for note in speech.notes)


def test_missing_empty_short_and_silent_files_are_refused(tmp_path):
    assert_refused(tmp_path / "none.wav", "does not exist")
    assert_refused(tmp_path, "is a folder")
    (tmp_path / "a.wav").touch()
    assert_refused(tmp_path / "a.wav", "empty (0 bytes)")
    assert_refused(written(tmp_path, np.zeros(0, dtype=np.int16)), "0 samples")
    assert_refused(written(tmp_path, tone(0.2)), "is 0.2 s long; at least 0.5 s are needed")
    assert load_speech(written(tmp_path, tone(0.5))).num_motion_frames == 15
    noise = np.sign(np.random.default_rng(0).standard_normal(SAMPLE_RATE)).astype(np.float32)
    assert_refused(written(tmp_path, 0 * noise), "is silent", "zero")
    assert_refused(written(tmp_path, np.float32(3e-5) * noise), "is silent", "-90 dB")


NO_SOUND = [
    "this is just text\n" * 500,
    "\x89PNG\r\n\x1a\n" + "\0" * 2000,
    "%PDF-1.7\n" + "".join(map(chr, range(256))) * 40,
    "#EXTM3U\n#EXT-X-TARGETDURATION:3\n#EXTINF:3,\n{target}\n#EXT-X-ENDLIST\n",
    "ffconcat version 1.0\nfile '{target}'\n",
    "v=0\no=- 0 0 IN IP4 127.0.0.1\ns=x\nc=IN IP4 127.0.0.1\nt=0 0\nm=audio 9 RTP/AVP 0\n",
]


def test_what_is_no_sound_is_refused_and_playlists_open_no_other_file(tmp_path, tone_file):
    target = tmp_path / "target.ts"
    ffmpeg("-i", tone_file, "-c:a", "aac", target)
    for content in NO_SOUND:
        for suffix in ("wav", "mp3", "m3u8"):
            path = tmp_path / f"a.{suffix}"
            path.write_bytes(content.replace("{target}", str(target)).encode("latin-1"))
            assert_refused(path, "not a sound file")


def test_truncated_mp3_says_how_much_was_read(tmp_path, tone_file):
    ffmpeg("-i", tone_file, tmp_path / "a.mp3")
    whole = (tmp_path / "a.mp3").read_bytes()
    (tmp_path / "cut.mp3").write_bytes(whole[: len(whole) // 2])
    speech = load_speech(tmp_path / "cut.mp3")
    assert 1.2 < speech.duration_s < 1.7
    only = f"Only {speech.duration_s:.1f} s could be read of the 3.0 s"
    assert any(note.startswith(only) for note in speech.notes)
    (tmp_path / "stub.mp3").write_bytes(whole[:3000])
    assert_refused(tmp_path / "stub.mp3", "at least 0.5 s")


@pytest.mark.parametrize(("rate", "bad"), [(SAMPLE_RATE, np.nan), (48000, np.inf)])
def test_samples_that_are_not_finite_say_where(tmp_path, rate, bad):
    samples = tone(2.0, rate)
    samples[rate : rate + 5] = bad
    assert_refused(written(tmp_path, samples, rate), "not finite", "1.00 s" if rate < 48000 else "")


def test_limits_can_be_set(tmp_path):
    path = written(tmp_path, tone(2.0))
    assert SpeechReadOptions().max_s == 600
    assert_refused(
        path,
        "longer than the limit of 1 seconds",
        "--max-minutes",
        options=SpeechReadOptions(max_s=1),
    )
    assert_refused(path, "at least 3 s", options=SpeechReadOptions(min_s=3))
    assert_refused(path, "at most 0 MiB", options=SpeechReadOptions(max_bytes=100))
    assert load_speech(path, SpeechReadOptions(max_s=2)).duration_s == 2.0


def test_a_decoder_that_hangs_is_killed(tmp_path, monkeypatch):
    """A real child that never ends stands in for ffmpeg."""
    stub = tmp_path / "ffmpeg"
    stub.write_text("#!/bin/sh\nexec sleep 600\n")
    stub.chmod(0o755)
    monkeypatch.setattr(audio, "_TIMEOUT_S", 0.2)
    monkeypatch.setattr(audio.imageio_ffmpeg, "get_ffmpeg_exe", lambda: str(stub))
    assert_refused(written(tmp_path, tone(1.0)), "took longer than 0.2 s")


def test_odd_names_are_only_names(tmp_path):
    for name in ("-i.wav", "a b'\".wav", "concat:x.wav", "%d.wav", "http:x.wav", "ü\n.wav"):
        wavfile.write(tmp_path / name, SAMPLE_RATE, tone(0.6))
        assert load_speech(tmp_path / name).num_motion_frames == 18
    (tmp_path / "\n.wav").write_bytes(b"text")
    with pytest.raises(SpeechError, match=r"^\?\.wav is not a sound file"):
        load_speech(tmp_path / "\n.wav")


def test_written_wav_is_16_bit_mono_and_reads_back(tmp_path):
    waveform = tone(1.0) * np.float32(1.9)  # peaks at 0.95
    write_wav(tmp_path / "a.wav", waveform)
    with wave.open(str(tmp_path / "a.wav")) as wav:
        assert (wav.getnchannels(), wav.getsampwidth(), wav.getframerate()) == (1, 2, SAMPLE_RATE)
    np.testing.assert_allclose(load_speech(tmp_path / "a.wav").waveform, waveform, atol=1e-4)
    write_wav(tmp_path / "a.wav", 4 * waveform)  # clipped, not wrapped
    assert load_speech(tmp_path / "a.wav").waveform.max() == pytest.approx(1.0, abs=1e-3)
    assert [path.name for path in tmp_path.iterdir()] == ["a.wav"]
    with pytest.raises(WriteError, match="does not exist"):
        write_wav(tmp_path / "none" / "a.wav", waveform)


PICTURES = ("-f", "lavfi", "-i", "color=size=64x64:rate=25:duration=6")


@pytest.fixture
def dialogue(tmp_path: Path) -> Path:
    """440 Hz on the left, 880 on the right."""
    sides = np.stack([tone(3.0), tone(3.0, hertz=880.0)], axis=1)
    return written(tmp_path, sides, name="dialogue.wav")


def test_one_side_of_a_dialogue_is_heard_alone(dialogue):
    for written, wanted in (("left", 440), ("right", 880), ("2", 880)):
        speech = load_speech(dialogue, SpeechReadOptions(channel=parse_channel(written)))
        assert hertz_of(speech.waveform) == wanted
        assert np.abs(speech.waveform).max() == pytest.approx(0.5, abs=0.01)  # not halved
        (note,) = speech.notes
        assert f"Only channel {1 + (wanted == 880)} of" in note
    assert_refused(dialogue, "2 channels", "channel 3", options=SpeechReadOptions(channel=2))
    for written in ("middle", "0", "-1", "65"):
        with pytest.raises(RunError, match="left, right, or a number"):
            parse_channel(written)


def test_the_first_track_that_is_not_silent_is_heard(tmp_path, dialogue):
    written(tmp_path, np.zeros(3 * SAMPLE_RATE, np.float32), name="silent.wav")
    written(tmp_path, tone(3.0), name="tone.wav")

    def film(name: str, *inputs: str) -> Path:
        more = [part for path in inputs for part in ("-i", str(tmp_path / path))]
        maps = [part for n in range(len(inputs) + 1) for part in ("-map", f"{n}:a")]
        return encode(tmp_path / "silent.wav", tmp_path / name, *more, *maps, "-c:a", "aac")

    speech = load_speech(film("two.mkv", "tone.wav"))
    assert hertz_of(speech.waveform) == 440
    assert speech.notes[0] == "Sound track 2 of 2, the first that is not silent, was used."
    third = load_speech(
        film("three.mp4", "silent.wav", "dialogue.wav"), SpeechReadOptions(channel=1)
    )
    assert hertz_of(third.waveform) == 880 and "track 3" in third.notes[0]
    assert_refused(film("none.mkv", "silent.wav"), "silent")


@pytest.mark.parametrize(
    ("name", "options"),
    [("a.mts", ("-c:v", "mpeg2video", "-c:a", "ac3")), ("a.mpg", ("-c:v", "mpeg2video")),
     ("a.mp4", ("-c:a", "aac")), ("a.mkv", ("-c:a", "aac"))],
)  # fmt: skip
def test_a_video_longer_than_its_sound_is_not_damaged(name, options, tmp_path):
    sound = written(tmp_path, tone(3.0, 32000), 32000)
    speech = load_speech(encode(sound, tmp_path / name, *PICTURES, *options))
    assert hertz_of(speech.waveform) == 440 and speech.duration_s == pytest.approx(3.0, abs=0.1)
    assert not any("damaged" in note for note in speech.notes)


def test_a_length_that_is_only_estimated_is_not_held_against_the_sound(tmp_path):
    late = np.concatenate([np.zeros(5 * SAMPLE_RATE, np.float32), tone(1.0)])
    options = "-c:a", "aac", "-b:a", "32k"
    speech = load_speech(encode(written(tmp_path, late), tmp_path / "late.aac", *options))
    assert speech.duration_s == pytest.approx(6.0, abs=0.1) and speech.notes == ()


def test_a_cut_video_is_still_told(tmp_path):
    options = (*PICTURES, "-c:a", "aac", "-movflags", "faststart")
    whole = encode(written(tmp_path, tone(6.0)), tmp_path / "whole.mp4", *options)
    cut = tmp_path / "cut.mp4"
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size * 3 // 4])
    (note,) = (note for note in load_speech(cut).notes if "damaged" in note)
    assert "6.0 s that the file states" in note


LATE = ("-f", "lavfi", "-i", "color=d=4:s=64x64", "-itsoffset", "1.5")
GAP = ("-af", "asetpts=PTS+1.5/TB*gte(T\\,1)")


@pytest.mark.parametrize("ending", ["mp4", "mkv", "ts"])
def test_sound_that_starts_later_than_the_picture_stays_in_time_with_it(
    ending: str, tmp_path: Path
) -> None:
    click = np.zeros(2 * SAMPLE_RATE, dtype=np.float32)
    click[SAMPLE_RATE] = 0.9
    path = tmp_path / f"late.{ending}"
    ffmpeg(*LATE, "-i", written(tmp_path, click), *("-ar", "48000"), path)
    speech = load_speech(path)
    assert abs(np.abs(speech.waveform).argmax() / SAMPLE_RATE - 2.5) < 0.03
    (note,) = (note for note in speech.notes if "silence" in note)
    assert re.match(r"The sound starts 1.[45] s after the start of the file", note)
    assert not any("damaged" in note for note in speech.notes)


@pytest.mark.parametrize("ending", ["mp4", "mka"])
def test_a_gap_in_time_stamps_is_silence_and_told_with_its_place(
    ending: str, tmp_path: Path
) -> None:
    source = written(tmp_path, tone(2.0))
    speech = load_speech(encode(source, tmp_path / f"gap.{ending}", *GAP))
    assert abs(speech.duration_s - 3.5) < 0.1
    level = np.abs(speech.waveform)
    silent, loud = slice(round(1.2 * SAMPLE_RATE), round(2.3 * SAMPLE_RATE)), 3 * SAMPLE_RATE
    assert level[silent].max() < 0.01 and level[loud : loud + 1000].max() > 0.3
    (note,) = (note for note in speech.notes if "gap" in note)
    assert re.match(
        r"According to the file's time stamps, the sound has a gap of 1\.[45] s at 1\.[01] s", note
    )
    assert not any("damaged" in note for note in speech.notes)


def test_sound_whose_time_stamps_overlap_is_kept_whole(tmp_path: Path) -> None:
    overlap = ("-af", "asetpts=PTS-0.5/TB*gte(T\\,1)", "-c:a", "pcm_s16le")
    path = tmp_path / "overlap.mka"
    ffmpeg("-i", written(tmp_path, tone(2.0)), *overlap, path)
    speech = load_speech(path)
    assert abs(speech.duration_s - 2.0) < 0.01
    (note,) = (note for note in speech.notes if "overlap" in note)
    assert "0.5 s" in note


def test_silence_that_is_longer_than_the_limit_is_refused_before_it_is_made(tmp_path: Path) -> None:
    day = ("-af", "asetpts=PTS+86400/TB*gte(T\\,1)", "-c:a", "flac")
    path = encode(written(tmp_path, tone(2.0)), tmp_path / "day.mka", *day)
    assert_refused(path, "longer than the limit of 10 minutes")


@pytest.mark.parametrize(
    ("ending", "codec"),
    [("sph", ""), ("voc", "pcm_u8"), ("tta", "tta"), ("ac3", "ac3"), ("eac3", "eac3")],
)
def test_formats_of_old_corpora_and_videos(ending: str, codec: str, tmp_path: Path) -> None:
    path = tmp_path / f"a.{ending}"
    if codec:
        encode(written(tmp_path, tone(2.0)), path, "-c:a", codec)
    else:  # ffmpeg writes no SPHERE: a header of 1,024 bytes, then samples
        head = (
            "NIST_1A\n   1024\nsample_count -i 32000\nsample_n_bytes -i 2\nchannel_count -i 1\n"
            "sample_byte_format -s2 01\nsample_rate -i 16000\nsample_coding -s3 pcm\nend_head\n"
        )
        samples = (32767 * tone(2.0)).astype("<i2").tobytes()
        path.write_bytes(head.encode().ljust(1024) + samples)
    speech = load_speech(path)
    assert abs(speech.duration_s - 2.0) < 0.1 and abs(hertz_of(speech.waveform) - 440) < 5
