"""Every file that a stranger may bring is read, or refused in a sentence."""

import io
import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.errors import visitor_sentence
from app.run.body_motion import body_motion
from app.study.design.key import Key, read_key, write_key
from app.study.design.plan import read_plan
from app.study.statistics.answers import collect
from app.study.statistics.screening import screen
from model.formats.read import read_any_motion
from model.motion.motion import load_motion, save_motion
from model.plan.files import ENDINGS, read_plan_file, write_plan_file
from model.speech.audio import load_speech
from model.speech.transcript import read_transcript
from renderer.body.body import load_body
from renderer.files.bvh import write_bvh
from tests.app.study.made import made_files, made_key
from tests.fuzz.clock import run_by_the_clock, within_time
from tests.fuzz.damage import damaged, wild_npz, with_wild_values
from tests.helpers import smooth_motion_example
from tests.model.made import made_waveform
from tests.model.plan.made import made_plan

PLAN = """
title = "People who talk"
protocol = "pairwise"
participants = 4
length_s = 2.5
views = ["front", "side"]
[[clips]]
name = "one"
speech = "one.wav"
start_s = 0.5
[[systems]]
name = "globaldiff/full"
seed = 3
steps = 4
[[systems]]
name = "theirs"
[systems.motion]
one = "one.npz"
"""
TEXTGRID = """File type = "ooTextFile"
Object class = "TextGrid"

xmin = 0
xmax = 2
tiers? <exists>
size = 2
item []:
    item [1]:
        class = "IntervalTier"
        name = "words"
        xmin = 0
        xmax = 2
        intervals: size = 2
        intervals [1]:
            xmin = 0
            xmax = 1.2
            text = "hello"
        intervals [2]:
            xmin = 1.2
            xmax = 2
            text = "there"
    item [2]:
        class = "IntervalTier"
        name = "gesture_left"
        xmin = 0
        xmax = 2
        intervals: size = 1
        intervals [1]:
            xmin = 0.25
            xmax = 0.5
            text = "stroke beat"
"""


def is_read_or_refused(read: Callable[[Path], object], path: Path, content: bytes) -> None:
    """Whether reading goes well or ends in one sentence that a person may be shown."""
    path.write_bytes(content)

    def work() -> None:
        try:
            read(path)
        except Exception as error:
            sentence = visitor_sentence(error)
            assert "inside the program" not in sentence, repr(error)
            assert sentence.isprintable() and len(sentence) < 2000, repr(sentence)
            assert str(path.parent) not in sentence, sentence

    within_time(work)


@pytest.fixture(scope="module")
def motion(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("motion") / "motion.npz"
    save_motion(smooth_motion_example(4), path)
    return path


def test_npz_with_wild_arrays(motion: Path, tmp_path: Path) -> None:
    arrays = dict(np.load(motion))

    @given(wild_npz(arrays))
    def check(content: bytes) -> None:
        is_read_or_refused(read_any_motion, tmp_path / "it.npz", content)
        is_read_or_refused(load_motion, tmp_path / "it.npz", content)

    run_by_the_clock(check)


def test_damaged_npz(motion: Path, tmp_path: Path) -> None:
    whole = motion.read_bytes()

    @given(damaged(whole))
    def check(content: bytes) -> None:
        is_read_or_refused(read_any_motion, tmp_path / "it.npz", content)

    run_by_the_clock(check)


def test_damaged_npy_and_bvh(tmp_path: Path) -> None:
    poses = io.BytesIO()
    np.save(poses, np.zeros((3, 165), np.float32))
    bvh = tmp_path / "whole.bvh"
    write_bvh(load_body(), body_motion(smooth_motion_example(3)), bvh)
    text = bvh.read_bytes()

    @given(st.one_of(damaged(poses.getvalue()).map(lambda it: (".npy", it)),
                     damaged(text).map(lambda it: (".bvh", it))))  # fmt: skip
    def check(found: tuple[str, bytes]) -> None:
        is_read_or_refused(read_any_motion, tmp_path / f"it{found[0]}", found[1])

    run_by_the_clock(check)


def float_wav(samples: np.ndarray) -> bytes:
    """Python's wave module writes integers only."""
    data = samples.astype("<f4").tobytes()
    header = b"RIFF" + (36 + len(data)).to_bytes(4, "little") + b"WAVEfmt "
    header += (16).to_bytes(4, "little") + (3).to_bytes(2, "little") + (1).to_bytes(2, "little")
    header += (16_000).to_bytes(4, "little") + (64_000).to_bytes(4, "little")
    header += (4).to_bytes(2, "little") + (32).to_bytes(2, "little")
    return header + b"data" + len(data).to_bytes(4, "little") + data


def test_damaged_sounds(tmp_path: Path) -> None:
    wav = tmp_path / "whole.wav"
    wav.write_bytes(float_wav(made_waveform(12_000)))
    sounds = [wav.read_bytes()]
    for ending in ("mp3", "flac", "ogg", "m4a"):
        other = tmp_path / f"whole.{ending}"
        ffmpeg = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-y", "-i", str(wav), str(other)]
        subprocess.run(ffmpeg, check=True)
        sounds.append(other.read_bytes())

    @given(st.sampled_from(sounds).flatmap(damaged))
    def check(content: bytes) -> None:
        is_read_or_refused(load_speech, tmp_path / "it.wav", content)

    run_by_the_clock(check)


def test_floats_of_any_size_as_sound(tmp_path: Path) -> None:
    @given(st.lists(st.floats(width=32), min_size=1, max_size=5))
    def check(values: list[float]) -> None:
        samples = np.tile(np.asarray(values, np.float32), 9_000 // len(values))
        is_read_or_refused(load_speech, tmp_path / "it.wav", float_wav(samples))

    run_by_the_clock(check)


@pytest.mark.parametrize("ending", ENDINGS)
def test_damaged_plans_of_gestures(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"it{ending}"
    write_plan_file(made_plan(), path)
    whole = path.read_bytes()

    @given(damaged(whole))
    def check(content: bytes) -> None:
        is_read_or_refused(read_plan_file, path, content)

    run_by_the_clock(check)


def test_damaged_plans(tmp_path: Path) -> None:
    tokens = [
        b"length_s = " + b"9" * 400, b"[" * 5000, b"a" + b".a" * 50_000 + b" = 1",
        b"x = " + b"[" * 4000 + b"]" * 4000, b"seed = " + b"7" * 5000, b"participants = nan",
        b"length_s = inf", b'name = "\\u001b[31m"', b"views = [[]]", b"protocol = []",
    ]  # fmt: skip
    lines = PLAN.encode().splitlines()

    @st.composite
    def plans(draw: st.DrawFn) -> bytes:
        changed = list(lines)
        for _ in range(draw(st.integers(0, 2))):
            at = draw(st.integers(0, len(lines) - 1))
            changed[at] = draw(st.sampled_from([*tokens, *lines]))
        text = b"\n".join(changed)
        return draw(damaged(text)) if draw(st.booleans()) else text

    @given(plans())
    def check(content: bytes) -> None:
        is_read_or_refused(read_plan, tmp_path / "plan.toml", content)

    run_by_the_clock(check)


DEEP = (b"[" * 100_000, b'{"answers": ' * 50_000, b"[" * 50_000 + b"]" * 50_000)


def as_json(document: object) -> bytes:
    return json.dumps(document).encode("utf-8", "surrogatepass")


@pytest.mark.parametrize("protocol", ["pairwise", "rating"])
def test_wild_answers_and_keys(protocol: str, tmp_path: Path) -> None:
    key = made_key(protocol)
    path = tmp_path / "whole.json"
    write_key(key, path)
    whole_key = json.loads(path.read_bytes())
    answers = made_files(key, 1)[0]
    (tmp_path / "answers").mkdir()

    def read_answers(path: Path) -> None:
        found = collect([path], key)
        assert all(line.isprintable() and len(line) < 9000 for line in found.left_out)
        screen(found.participants, key)

    def read_both(path: Path) -> None:
        changed: Key = read_key(path)
        other = tmp_path / "answers" / "whole.json"
        other.write_text(json.dumps(answers))
        screen(collect([other], changed).participants, changed)

    @given(
        st.one_of(
            with_wild_values(answers).map(lambda it: (read_answers, as_json(it))),
            damaged(as_json(answers)).map(lambda it: (read_answers, it)),
            with_wild_values(whole_key).map(lambda it: (read_both, as_json(it))),
            damaged(as_json(whole_key)).map(lambda it: (read_both, it)),
            st.tuples(st.sampled_from([read_answers, read_both]), st.sampled_from(DEEP)),
        )
    )
    def check(found: tuple[Callable[[Path], object], bytes]) -> None:
        read, content = found
        is_read_or_refused(read, tmp_path / "it.json", content)

    run_by_the_clock(check)


def test_damaged_transcripts(tmp_path: Path) -> None:
    @given(damaged(TEXTGRID.encode()))
    def check(content: bytes) -> None:
        is_read_or_refused(read_transcript, tmp_path / "it.TextGrid", content)

    run_by_the_clock(check)
