"""Every file that a stranger may bring is read, or refused in a sentence."""

import io
import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import imageio_ffmpeg
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.io import wavfile

from app.run.bodies import body_motion
from app.run.frame_packets import camera_framing_poses
from app.study.design.key import read_key, write_key
from app.study.design.plan import read_study_plan
from app.study.statistics.answers import collect_answers
from app.study.statistics.screening import screen
from model.formats.read import read_with_raw_errors
from model.motion.motion import load_motion, save_motion
from model.plan.annotation_files import format_textgrid
from model.plan.files import ENDINGS, markers_csv, read_plan_file, write_plan_file
from model.plan.tiers import plan_to_tiers
from model.speech.audio import load_speech
from model.speech.transcript import read_textgrid_transcript, read_words_file
from renderer.body.body import load_body
from renderer.body.lod import character_lod_faces
from renderer.files.character_glb import character_glb_bytes
from renderer.files.exports import write_bvh
from renderer.files.glb import glb_bytes, join_glb_chunks
from renderer.files.vrma import vrma_bytes
from tests.app.study.made import made_files, made_key
from tests.fuzz.clock import is_done_or_refused, run_by_the_clock
from tests.fuzz.damage import damaged, damaged_lines, wild_npz, with_wild_values
from tests.helpers import smooth_motion_example
from tests.model.formats.made import in_form
from tests.model.formats.made_conventions import convention_text
from tests.model.made import made_waveform
from tests.model.plan.made import made_plan
from tests.model.speech.test_transcript import FILES
from tests.renderer.body.made_character import character, nearest_vertices, parse

PLAN = b"""title = "People who talk"
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
[[systems]]
name = "theirs"
[systems.motion]
one = "one.npz\""""
WILD_LINES = [
    *(b"length_s = " + b"9" * 400, b"[" * 5000, b"a" + b".a" * 50_000 + b" = 1"),
    *(b"x = " + b"[" * 4000 + b"]" * 4000, b"seed = " + b"7" * 5000, b"participants = nan"),
    *(b"length_s = inf", b'name = "\\u001b[31m"', b"views = [[]]", b"protocol = []"),
]
TEXTGRID = b"""File type = "ooTextFile"
Object class = "TextGrid"
item [1]:
 class = "IntervalTier"
 name = "words"
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
 intervals [1]:
 xmin = 0.25
 xmax = 0.5
 text = "stroke beat"
"""
PRAAT = (
    format_textgrid(plan_to_tiers(made_plan(), for_praat=True), 6.0)
    .replace("gaze", "words")
    .encode()
)
DEEP = (b"[" * 100_000, b'{"answers": ' * 50_000, b"[" * 50_000 + b"]" * 50_000)
Read = Callable[[Path], object]


def check_reads(content: st.SearchStrategy[bytes], path: Path, *reads: Read) -> None:
    """Whatever is drawn is read from the path, or refused without a word of where that is."""

    @given(content)
    def check(content: bytes) -> None:
        path.write_bytes(content)
        for read in reads:
            is_done_or_refused(lambda read=read: read(path), str(path.parent))

    run_by_the_clock(check)


def read_motion(path: Path) -> object:
    """Read without what makes a sentence of a reader's own errors, so that these are found."""
    return read_with_raw_errors(path, {})


def as_json(document: Any) -> bytes:
    return json.dumps(document).encode("utf-8", "surrogatepass")


def read_within(path: Path) -> None:
    read_words_file(path).within(1.0)


def test_npz(tmp_path: Path) -> None:
    save_motion(smooth_motion_example(4), tmp_path / "whole.npz")
    whole = (tmp_path / "whole.npz").read_bytes()
    arrays = wild_npz(dict(np.load(tmp_path / "whole.npz")))
    check_reads(damaged(whole) | arrays, tmp_path / "it.npz", read_motion, load_motion)


@pytest.mark.parametrize("form", ["axis-angle", "6d", "quaternion-wxyz", "matrix"])
def test_parameters_in_npz(form: str, tmp_path: Path) -> None:
    motion = smooth_motion_example(4)
    rows = in_form(motion.poses.reshape(4, 55, 3).astype(np.float64), form)
    arrays = {
        "global_orient": rows[:, 0],
        "body_pose": rows[:, 1:22],
        "jaw_pose": rows[:1, 22],
        "left_hand_pose": rows[:, 25:40],
        "transl": motion.trans,
        "expression": motion.expressions[:, :10],
        "betas": np.zeros((1, 10)),
        "fps": np.array(25.0),
        "missing": np.array([1, 0, 1, 1]),
    }
    check_reads(wild_npz(arrays), tmp_path / "it.npz", read_motion)


@pytest.mark.parametrize("ending", ["npy", "bvh"])
def test_other_motion(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"it.{ending}"
    if ending == "npy":
        np.save(path, np.zeros((3, 165), np.float32))
        wild = damaged(path.read_bytes())
    else:
        write_bvh(load_body(), body_motion(smooth_motion_example(3)), path)
        theirs = convention_text("CMU").encode()
        wild = damaged(path.read_bytes()) | damaged_lines(path.read_bytes()) | damaged_lines(theirs)
    check_reads(wild, path, read_motion)


@pytest.mark.parametrize("kind", ["mixamo", "vrm", "vrm0"])
def test_characters(kind: str, tmp_path: Path) -> None:
    open_body = load_body()
    whole = character(open_body.submesh(*nearest_vertices(open_body)), kind)
    document, binary = parse(whole)
    wild = with_wild_values(document).map(lambda changed: join_glb_chunks(changed, binary))

    def read_and_write(path: Path) -> None:
        body = load_body(path)
        motion = camera_framing_poses(body)
        (vertices,) = body.posed_vertices(motion)
        assert np.isfinite(vertices).all()
        glb_bytes(body, motion, character_lod_faces(body))
        character_glb_bytes(body, motion)
        vrma_bytes(body, motion)

    check_reads(wild | damaged(whole), tmp_path / "it.vrm", read_and_write)


def float_wav(samples: np.ndarray) -> bytes:
    file = io.BytesIO()
    wavfile.write(file, 16_000, samples.astype(np.float32))
    return file.getvalue()


def test_sounds(tmp_path: Path) -> None:
    wav = tmp_path / "whole.wav"
    wav.write_bytes(float_wav(made_waveform(12_000)))
    sounds = [wav.read_bytes()]
    for ending in ("mp3", "flac", "ogg", "m4a"):
        other = tmp_path / f"whole.{ending}"
        ffmpeg = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-y", "-i", str(wav), str(other)]
        subprocess.run(ffmpeg, check=True)
        sounds.append(other.read_bytes())
    floats = st.lists(st.floats(width=32), min_size=1, max_size=5).map(
        lambda values: float_wav(np.tile(np.asarray(values, np.float32), 9_000 // len(values)))
    )
    broken = st.sampled_from(sounds).flatmap(damaged)
    check_reads(broken | floats, tmp_path / "it.wav", load_speech)


@pytest.mark.parametrize("ending", ENDINGS)
def test_plans_of_gestures(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"it{ending}"
    write_plan_file(made_plan(), path)
    whole = path.read_bytes()
    content = damaged(whole)
    if ending == ".json":
        content |= with_wild_values(json.loads(whole)).map(as_json)

    def read_and_write(path: Path) -> None:
        plan = read_plan_file(path).plan
        markers_csv(plan)
        for ending in ENDINGS:
            write_plan_file(plan, tmp_path / f"again{ending}")

    check_reads(content, path, read_and_write)


@pytest.mark.parametrize("name", ["genea.tsv", "kaldi.ctm", "words.vtt", "whisper.json"])
def test_transcripts(name: str, tmp_path: Path) -> None:
    content = damaged(FILES[name].encode())
    if name.endswith(".json"):
        content |= with_wild_values(json.loads(FILES[name])).map(as_json)
    check_reads(content, tmp_path / f"it{Path(name).suffix}", read_within)


@pytest.mark.parametrize("whole", [TEXTGRID, PRAAT], ids=["bare", "with counts"])
def test_textgrids(whole: bytes, tmp_path: Path) -> None:
    check_reads(damaged(whole), tmp_path / "it.TextGrid", read_textgrid_transcript, read_within)


def test_plans_of_studies(tmp_path: Path) -> None:
    lines = PLAN.splitlines()

    @st.composite
    def plans(draw: st.DrawFn) -> bytes:
        changed = list(lines)
        for _ in range(draw(st.integers(0, 2))):
            at = draw(st.integers(0, len(lines) - 1))
            changed[at] = draw(st.sampled_from([*WILD_LINES, *lines]))
        text = b"\n".join(changed)
        return draw(damaged(text)) if draw(st.booleans()) else text

    check_reads(plans(), tmp_path / "plan.toml", read_study_plan)


@pytest.mark.parametrize("protocol", ["pairwise", "rating"])
def test_answers_and_keys(protocol: str, tmp_path: Path) -> None:
    key, path = made_key(protocol), tmp_path / "whole.json"
    write_key(key, path)
    whole_key = json.loads(path.read_bytes())
    answers = made_files(key, 1)[0]
    whole = tmp_path / "answers.json"
    whole.write_text(json.dumps(answers))

    def wild(document: Any) -> st.SearchStrategy[bytes]:
        text = json.dumps(document).encode()
        wild = with_wild_values(document)
        return wild.map(as_json) | damaged(text) | st.sampled_from(DEEP)

    def read_answers(path: Path) -> None:
        found = collect_answers([path], key)
        assert all(line.isprintable() and len(line) < 9000 for line in found.left_out_sentences)
        screen(found.participants, key)

    def read_both(path: Path) -> None:
        changed = read_key(path)
        screen(collect_answers([whole], changed).participants, changed)

    check_reads(wild(answers), tmp_path / "it.json", read_answers)
    check_reads(wild(whole_key), tmp_path / "it.json", read_both)
