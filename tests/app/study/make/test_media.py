"""Videos differ in what they show and in nothing that can be measured."""

import subprocess
import zlib
from pathlib import Path

import av
import numpy as np
import pytest

from app.errors import RunError
from app.study.make import media
from app.study.make.mp4 import fill_alike, frames_of, num_picture_bytes, read_mp4
from renderer.video.encoder import ffmpeg_path
from tests.app.study.made_study import ffmpeg
from tests.model.made import made_waveform

FRAMES = 45


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A still picture and one full of motion, without loss."""
    folder = tmp_path_factory.mktemp("drawn")
    sources = {
        "calm": "color=gray:s=128x128:r=30",
        "wild": "testsrc2=s=128x128:r=30,noise=alls=60:allf=t",
    }
    for name, source in sources.items():
        ffmpeg(
            *("-f", "lavfi", "-i", source, "-frames:v", str(FRAMES), "-c:v", "libx264"),
            *("-crf", "0", "-pix_fmt", "yuv420p", str(folder / f"{name}.mp4")),
        )
    return {name: folder / f"{name}.mp4" for name in sources}


def make(drawn: dict[str, Path], folder: Path, track: Path | None = None) -> list[Path]:
    folder.mkdir(exist_ok=True)
    streams = [folder / f"{name}.h264" for name in drawn]
    for source, stream in zip(drawn.values(), streams, strict=True):
        media.encode_picture(source, stream, 128)
    fill_alike(streams)
    videos = [stream.with_suffix(".mp4") for stream in streams]
    for stream, video in zip(streams, videos, strict=True):
        media.join(stream, track, video)
    media.pad_alike(videos)
    return videos


def test_calm_and_wild_motion_give_equal_files(drawn: dict[str, Path], tmp_path: Path) -> None:
    track = tmp_path / "speech.m4a"
    media.encode_speech(made_waveform(16_000 * FRAMES // 30), track, "clip")
    calm, wild = (read_mp4(video) for video in make(drawn, tmp_path / "a", track))
    assert calm.num_bytes == wild.num_bytes
    assert calm.tracks == wild.tracks  # packet by packet
    assert [track.handler for track in calm.tracks] == ["vide", "soun"]
    assert calm.tracks[0].num_samples == FRAMES
    assert calm.tracks[0].duration == FRAMES / 30


def test_the_same_pictures_give_the_same_bytes(drawn: dict[str, Path], tmp_path: Path) -> None:
    first, second = make(drawn, tmp_path / "a"), make(drawn, tmp_path / "b")
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in second]


def test_filled_videos_show_every_frame_as_it_was(drawn: dict[str, Path], tmp_path: Path) -> None:
    for source, made in zip(drawn.values(), make(drawn, tmp_path / "a"), strict=True):
        with av.open(str(source)) as before, av.open(str(made)) as after:
            wanted = [frame.to_ndarray(format="gray") for frame in before.decode(video=0)]
            shown = [frame.to_ndarray(format="gray") for frame in after.decode(video=0)]
            assert len(shown) == len(wanted) == FRAMES
            times = [packet.pts for packet in av.open(str(made)).demux(video=0) if packet.size]
        assert len(set(np.diff(times))) == 1
        if source.stem == "calm":
            apart = np.subtract(shown, wanted, dtype=float)
            assert abs(apart.mean()) < 0.2 and apart.std() < 3  # the grain


def test_nothing_is_written_beside_the_pictures(drawn: dict[str, Path], tmp_path: Path) -> None:
    for video in make(drawn, tmp_path / "a"):
        file = read_mp4(video)
        assert not {"udta", "meta", "uuid"} & set(file.boxes)
        assert not file.has_times
        assert b"x264" not in video.read_bytes()
        assert media.sound_digest(video) is None


@pytest.mark.parametrize("gain", [0.01, 0.3, 3.0])
def test_speech_has_the_loudness_of_r128_whatever_it_had(tmp_path: Path, gain: float) -> None:
    track = tmp_path / "speech.m4a"
    waveform = np.clip(gain * made_waveform(48_000), -1, 1).astype(np.float32)
    media.encode_speech(waveform, track, "clip")
    assert media.measure_loudness(track) == pytest.approx(media.TARGET_LUFS, abs=0.5)
    samples = subprocess.run(
        [ffmpeg_path(), "-v", "error", "-i", str(track), "-f", "f32le", "-"],
        capture_output=True,
        check=True,
    ).stdout
    assert np.abs(np.frombuffer(samples, "<f4")).max() <= 1.0


def test_a_silent_excerpt_gives_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="The excerpt of clip 'one' is silent"):
        media.encode_speech(np.zeros(16_000, np.float32), tmp_path / "speech.m4a", "one")


def test_calm_and_wild_motion_cannot_be_told_by_what_fills_them_up(
    drawn: dict[str, Path], tmp_path: Path
) -> None:
    videos = make(drawn, tmp_path / "a")
    streams = [media.picture_stream(video) for video in videos]
    calm, wild = (num_picture_bytes(stream) for stream in streams)
    assert abs(calm - wild) < 0.03 * wild  # of 45 small pictures
    assert calm > 0.5 * len(streams[0])
    packed = [len(zlib.compress(stream)) for stream in streams]
    assert max(packed) - min(packed) < 64
    for stream in streams:
        kinds = [[unit[0] & 31 for unit in units] for units in frames_of(stream)]
        assert all(frame[-3:-1] == [6, 6] and 12 not in frame for frame in kinds)


@pytest.mark.parametrize("sizes", [(300, 300), (300, 301), (255, 547), (300, 299, 3000)])
def test_frames_are_filled_to_any_size(tmp_path: Path, sizes: tuple[int, ...]) -> None:
    """Of two pictures each, the one larger in the first stream, the other in the last."""
    paths = [tmp_path / f"{i}" for i in range(len(sizes))]
    for path, size in zip(paths, sizes, strict=True):
        units = [b"\x67" + b"s" * 9, b"\x65" + b"x" * size, b"\x41" + b"y" * (5000 - size)]
        path.write_bytes(b"".join(b"\x00\x00\x00\x01" + unit for unit in units))
    own = [num_picture_bytes(path.read_bytes()) for path in paths]
    fill_alike(paths)
    frames = [frames_of(path.read_bytes()) for path in paths]
    found = {tuple(sum(4 + len(unit) for unit in units) for units in each) for each in frames}
    assert len(found) == 1
    assert [num_picture_bytes(path.read_bytes()) for path in paths] == own


@pytest.mark.parametrize("sizes", [(100, 100), (100, 101), (100, 107), (100, 108), (90, 100, 97)])
def test_padding_reaches_any_size(tmp_path: Path, sizes: tuple[int, ...]) -> None:
    paths = [tmp_path / f"{i}" for i in range(len(sizes))]
    for path, size in zip(paths, sizes, strict=True):
        path.write_bytes(b"x" * size)
    media.pad_alike(paths)
    assert len({path.stat().st_size for path in paths}) == 1
    assert all(
        path.read_bytes().startswith(b"x" * size) for path, size in zip(paths, sizes, strict=True)
    )


def test_a_file_that_is_no_video_gives_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "a.mp4").write_bytes(b"not a video, but long enough to look at")
    with pytest.raises(RunError, match=r"a\.mp4 is no whole mp4 file"):
        read_mp4(tmp_path / "a.mp4")
