"""What a study is made of: generated motion, equal videos, and files for other tools."""

import csv
import subprocess
import zlib
from dataclasses import replace
from pathlib import Path

import av
import numpy as np
import pytest

from app.errors import RunError
from app.study.design.blinding import make_key
from app.study.design.key import StudyKey
from app.study.design.plan import Clip, Condition, StudyPlan, read_study_plan
from app.study.design.trials import Design, make_design
from app.study.make import media
from app.study.make.bundle import genea_tables
from app.study.make.motions import ClipInputs, make_clip_motions, read_all_clip_inputs
from model.generation.windows import GenerateOptions, generate_motion
from model.plan.editing import GestureKey, add_gesture, delete_gesture
from model.plan.files import read_plan_file, write_plan_file
from model.plan.plan import GesturePlan
from model.sampling.samplers import noise_seed_of_clip
from model.speech.audio import Speech, write_wav
from model.systems.planned.config import PLANNED
from model.systems.registry import load_system
from renderer.video.encoder import ffmpeg_path
from tests.app.study.made_study import CLIPS, SYSTEMS, ffmpeg, write_plan
from tests.conftest import MadeOnce
from tests.model.made import made_waveform

FRAMES = 45


def encoded(drawn: list[Path], folder: Path, track: Path | None = None) -> list[Path]:
    """Videos as a study has them, of equal length in every way."""
    folder.mkdir()
    streams = [folder / f"{source.stem}.h264" for source in drawn]
    for source, stream in zip(drawn, streams, strict=True):
        media.encode_video_stream(source, stream, 128)
    media.equalise_frame_bytes(streams)
    videos = [stream.with_suffix(".mp4") for stream in streams]
    for stream, video in zip(streams, videos, strict=True):
        media.mux_mp4(stream, track, video)
    media.pad_to_equal_bytes(videos)
    return videos


def _draw_and_encode(folder: Path) -> None:
    """A still picture and one full of motion, without loss; as videos without and with speech."""
    sources = {
        "calm": "color=gray:s=128x128:r=30",
        "wild": "testsrc2=s=128x128:r=30,noise=alls=60:allf=t",
    }
    for name, source in sources.items():
        ffmpeg(
            *("-f", "lavfi", "-i", source, "-frames:v", str(FRAMES), "-c:v", "libx264"),
            *("-crf", "0", "-pix_fmt", "yuv420p", str(folder / f"{name}.mp4")),
        )
    drawn = sorted(folder.glob("*.mp4"))
    encoded(drawn, folder / "silent")
    media.encode_speech(made_waveform(16_000 * FRAMES // 30), folder / "speech.m4a", "clip")
    encoded(drawn, folder / "spoken", folder / "speech.m4a")


@pytest.fixture(scope="module")
def made(made_once: MadeOnce) -> Path:
    return made_once("calm-and-wild-videos", _draw_and_encode)


def test_calm_and_wild_motion_give_equal_files(made):
    calm, wild = (media.read_mp4(video) for video in sorted((made / "spoken").glob("*.mp4")))
    assert calm.num_bytes == wild.num_bytes
    assert calm.tracks == wild.tracks  # packet by packet
    assert [track.handler for track in calm.tracks] == ["vide", "soun"]
    assert len(calm.tracks[0].sample_sizes) == FRAMES
    assert calm.tracks[0].duration_s == FRAMES / 30


def test_videos_show_every_frame_as_it_was_and_nothing_else_the_same_each_time(made, tmp_path):
    drawn = sorted(made.glob("*.mp4"))
    again = encoded(drawn, tmp_path / "again")
    for source, video in zip(drawn, again, strict=True):
        assert video.read_bytes() == (made / "silent" / video.name).read_bytes()
        with av.open(str(source)) as before, av.open(str(video)) as after:
            wanted = [frame.to_ndarray(format="gray") for frame in before.decode(video=0)]
            shown = [frame.to_ndarray(format="gray") for frame in after.decode(video=0)]
        assert len(shown) == len(wanted) == FRAMES
        with av.open(str(video)) as packed:
            times = [packet.pts for packet in packed.demux(video=0) if packet.size]
        assert len(set(np.diff(times))) == 1
        if source.stem == "calm":
            apart = np.subtract(shown, wanted, dtype=float)
            assert abs(apart.mean()) < 0.2 and apart.std() < 3  # the grain
        file = media.read_mp4(video)
        assert not {"udta", "meta", "uuid"} & set(file.box_types) and not file.has_timestamps
        assert b"x264" not in video.read_bytes() and media.audio_digest(video) is None


def test_speech_has_the_loudness_of_r128_whatever_it_had(tmp_path):
    for gain in [0.01, 3.0]:
        track = tmp_path / "speech.m4a"
        waveform = np.clip(gain * made_waveform(48_000), -1, 1).astype(np.float32)
        media.encode_speech(waveform, track, "clip")
        assert media.measure_loudness(track) == pytest.approx(media.TARGET_LUFS, abs=0.5)
        command = [ffmpeg_path(), "-v", "error", "-i", str(track), "-f", "f32le", "-"]
        samples = subprocess.run(command, capture_output=True, check=True).stdout
        assert np.abs(np.frombuffer(samples, "<f4")).max() <= 1.0
        with pytest.raises(RunError, match="The excerpt of clip 'one' is silent"):
            media.encode_speech(0 * waveform, track, "one")


def test_calm_and_wild_motion_cannot_be_told_by_what_fills_them_up(made):
    streams = [media.video_stream(path) for path in sorted((made / "silent").glob("*.mp4"))]
    calm, wild = (media.num_unpadded_bytes(stream) for stream in streams)
    assert abs(calm - wild) < 0.03 * wild  # of 45 small pictures
    assert calm > 0.5 * len(streams[0])
    packed = [len(zlib.compress(stream)) for stream in streams]
    assert max(packed) - min(packed) < 64
    for stream in streams:
        kinds = [[unit[0] & 31 for unit in units] for units in media.split_into_frames(stream)]
        assert all(frame[-3:-1] == [6, 6] and 12 not in frame for frame in kinds)


def test_frames_are_filled_to_any_size(tmp_path):
    """Of two pictures each, the one larger in the first stream, the other in the last."""
    for sizes in [(300, 300), (300, 301), (255, 547), (300, 299, 3000)]:
        paths = [tmp_path / f"{i}" for i in range(len(sizes))]
        for path, size in zip(paths, sizes, strict=True):
            units = [b"\x67" + b"s" * 9, b"\x65" + b"x" * size, b"\x41" + b"y" * (5000 - size)]
            path.write_bytes(b"".join(b"\x00\x00\x00\x01" + unit for unit in units))
        own = [media.num_unpadded_bytes(path.read_bytes()) for path in paths]
        media.equalise_frame_bytes(paths)
        frames = [media.split_into_frames(path.read_bytes()) for path in paths]
        found = {tuple(sum(4 + len(unit) for unit in units) for units in each) for each in frames}
        assert len(found) == 1
        assert [media.num_unpadded_bytes(path.read_bytes()) for path in paths] == own


def test_padding_reaches_any_size(tmp_path):
    for sizes in [(100, 100), (100, 101), (100, 107), (100, 108), (90, 100, 97)]:
        paths = [tmp_path / f"{i}.mp4" for i in range(len(sizes))]
        for path, size in zip(paths, sizes, strict=True):
            path.write_bytes(b"x" * size)
        media.pad_to_equal_bytes(paths)
        assert len({path.stat().st_size for path in paths}) == 1
        for path, size in zip(paths, sizes, strict=True):
            assert path.read_bytes().startswith(b"x" * size)
        with pytest.raises(RunError, match=r"0\.mp4 is not a complete MP4 file"):
            media.read_mp4(paths[0])


def test_two_clips_move_differently_though_they_hold_the_same_speech(weights):
    """Two clips that shared noise would show the same gestures, matched or not."""
    speech = Speech(made_waveform(16_000 * 70 // 30).astype(np.float32), sha256="")
    systems = tuple(
        Condition(name, system="globaldiff/local", steps=steps)
        for name, steps in (("few", 2), ("more", 3))
    )
    clip = Clip("garden", Path("garden.wav"))
    plan = StudyPlan("t", "pairwise", 2, (clip,), systems)
    source = ClipInputs(clip, 70, speech, {}, {})
    poses = [
        make_clip_motions(plan, each, weights, None, lambda: False)["few"].poses
        for each in (source, source, replace(source, clip=replace(clip, name="park")))
    ]
    assert np.array_equal(poses[0], poses[1])
    assert np.abs(poses[0] - poses[2]).mean() > 0.001


def planned_sources(tmp_path: Path, text: str) -> tuple[StudyPlan, tuple[ClipInputs, ...]]:
    write_wav(tmp_path / "one.wav", made_waveform(16_000 * 4))
    path = tmp_path / "plan.toml"
    path.write_text(
        'title = "t"\nprotocol = "rating"\nparticipants = 2\nlength_s = 3\n[[clips]]\n'
        f'name = "one"\nspeech = "one.wav"\n{text}'
    )
    plan = read_study_plan(path)
    return plan, read_all_clip_inputs(plan)


def condition(name: str, more: str) -> str:
    return f'[[systems]]\nname = "{name}"\nsystem = "{PLANNED}"\nsteps = 1\n{more}\n'


def test_a_condition_performs_the_given_plan_and_its_style(planned_weights, tmp_path):
    (tmp_path / "plans").mkdir()
    file = tmp_path / "plans" / "one.json"
    write_plan_file(add_gesture(GesturePlan(3.0), "offer", 1.5, "right").plan, file)
    given = read_plan_file(file).plan
    by_hand = 'plan = "plans/{clip}.json"'
    none = "style = { times = { gestures_per_min = 0 } }"
    plan, (source,) = planned_sources(
        tmp_path,
        condition("given", by_hand)
        + condition("none of it", f"{by_hand}\n{none}")
        + condition("drawn", "")
        + condition("drawn none", none),
    )
    assert source.plans == {"given": given, "none of it": given}
    assert source.file_sha256s["plan of given"] == source.file_sha256s["plan of none of it"]
    made = make_clip_motions(plan, source, planned_weights, None, lambda: False)
    empty = delete_gesture(given, GestureKey("right", 1.5)).plan
    expected = (
        expected_poses(planned_weights, source, given),
        expected_poses(planned_weights, source, empty),
    )
    np.testing.assert_array_equal(made["given"].poses[:, 3:66], expected[0][:, 3:66])
    np.testing.assert_array_equal(made["none of it"].poses[:, 3:66], expected[1][:, 3:66])
    assert np.abs(made["drawn"].poses - made["drawn none"].poses).max() > 1e-3


def expected_poses(weights: Path, source: ClipInputs, plan: GesturePlan) -> np.ndarray:
    system = load_system(PLANNED, weights)
    options = GenerateOptions(
        next(iter(system.speakers)), seed=noise_seed_of_clip(0, "one"), steps=1, conditions=(plan,)
    )
    assert source.speech is not None
    (motion,) = generate_motion(system, source.speech, options)
    return motion.poses


def test_plans_of_other_lengths_and_none_are_refused_before_anything_is_made(tmp_path):
    text = condition("given", 'plan = "{clip}.json"')
    with pytest.raises(RunError, match="The gesture plan of 'given' for clip 'one' was not found"):
        planned_sources(tmp_path, text)
    write_plan_file(GesturePlan(9.0), tmp_path / "one.json")
    with pytest.raises(RunError, match=r"for clip 'one': The plan lasts 9\.00 s and the speech"):
        planned_sources(tmp_path, text)


def blinded(folder: Path, protocol: str) -> tuple[StudyPlan, Design, StudyKey]:
    plan = read_study_plan(write_plan(folder, SYSTEMS, CLIPS[:2], f'protocol = "{protocol}"'))
    design = make_design(plan)
    return plan, design, make_key(plan, design)


def test_genea_gets_pairs_and_mismatches(tmp_path):
    plan, design, key = blinded(tmp_path, "pairwise")
    (table,) = genea_tables(plan, design, key).values()
    header, *rows = csv.reader(table.splitlines())
    assert header == ["clip_name", "system_1", "system_2"]
    pairs = {frozenset(trial.videos) for trial in key.trials.values() if trial.videos}
    assert {frozenset(row[1:]) for row in rows} == pairs
    plan, design, key = blinded(tmp_path, "matched")
    (table,) = genea_tables(plan, design, key).values()
    header, *rows = csv.reader(table.splitlines())
    assert header == ["clip_name", "system", "mismatch_type", "mismatch_data"]
    assert len(rows) == 6
    for _, right, kind, wrong in rows:
        assert kind == "speech"
        assert key.videos[right].has_own_speech and not key.videos[wrong].has_own_speech
    assert genea_tables(*blinded(tmp_path, "ranking")) == {}
