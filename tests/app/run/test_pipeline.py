import json
import os
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image

from app.errors import CancelledRun, RunError, sentence_of
from app.run import inputs
from app.run.pipeline import generate_all
from app.run.requests.request import Artefact, GenerateRequest, Measured, Progress, Take
from model.motion.motion import load_motion, save_motion
from model.plan.plan import GesturePlan, read_plan
from renderer.draw import probe
from renderer.draw.offscreen import GLError
from tests.helpers import smooth_motion_example
from tests.model.plan.made import phase

Ask = Callable[..., GenerateRequest]


def names_in(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


WITHOUT_VIDEO = {
    *("globaldiff-local.npz", "globaldiff-global.npz", "diagnostics.json", "diagnostics.csv"),
    *("figure6.png", "figure6.svg", "figure6.pdf", "provenance.json"),
    *("jitter.png", "jitter.svg", "jitter.pdf"),
}


@pytest.mark.gl
def test_a_whole_run_leaves_every_file_with_exactly_the_frames_of_the_speech(ask: Ask) -> None:
    reference = smooth_motion_example(50)
    request = ask(has_video=True, has_figures=True, size=256, views=("front", "side"))
    path = request.speech.with_name("reference.npz")
    save_motion(reference, path)
    events = []
    result = generate_all(replace(request, reference=path), events.append)

    videos = {
        f"{name}{view}.mp4"
        for name in ("globaldiff-local", "globaldiff-global", "reference")
        for view in ("", ".side")
    }
    assert names_in(request.out) == WITHOUT_VIDEO | videos | {"comparison.mp4"}
    assert names_in(request.out) == {file.name for file in result.files}
    assert result.names == ("globaldiff/local", "globaldiff/global", "reference")
    assert result.num_frames == 37
    for name in (*videos, "comparison.mp4"):
        with av.open(str(request.out / name)) as video:
            assert sum(1 for _ in video.decode(video=0)) == 37, name
            assert len(video.streams.audio) == 1
            assert abs(float(video.duration / av.time_base) - 37 / 30) < 1 / 30
    with av.open(str(request.out / "comparison.mp4")) as video:
        assert video.streams.video[0].width == 3 * 192

    told = {event.path.name for event in events if isinstance(event, Artefact)}
    assert told == names_in(request.out)
    for stage in ("speech", "motion", "numbers", "video", "comparison", "figure"):
        fractions = [e.fraction for e in events if isinstance(e, Progress) and e.stage == stage]
        assert fractions == sorted(fractions) and fractions[-1] == 1.0, stage
    assert any("the reference was cut to 37" in note for note in result.notes)
    (measured,) = (i for i, event in enumerate(events) if isinstance(event, Measured))
    assert events[measured].diagnostics.as_json() == result.diagnostics.as_json()
    is_file = [isinstance(event, Artefact) and event.kind for event in events]
    assert is_file.index("figure") > measured > len(is_file) - is_file[::-1].index("motion") - 1


def test_a_run_without_video_needs_no_gl_and_records_what_made_it(
    ask: Ask, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(probe, "probe_backend", lambda name: probe._broken(name, "gone"))
    probe.choose_backend.cache_clear()
    request = ask(seed=5, post_filter="savgol", has_figures=True)
    result = generate_all(request)
    assert names_in(request.out) == WITHOUT_VIDEO
    record = json.loads((request.out / "provenance.json").read_text())
    assert record["options"]["seed"] == 5 and record["options"]["post_filter"] == "savgol"
    assert record["options"]["speaker"] == "ann"
    assert record["speech"]["frames"] == 37 and len(record["speech"]["sha256"]) == 64
    assert set(record["weights"]) == {"globaldiff/local", "globaldiff/global"}
    assert len(record["weights"]["globaldiff/local"]["sha256"]) == 64
    diagnostics = json.loads((request.out / "diagnostics.json").read_text())
    assert diagnostics == result.diagnostics.as_json()
    assert "beat_align" in diagnostics["systems"]["globaldiff/local"]["raw"]
    assert set(diagnostics["systems"]) == {"globaldiff/local", "globaldiff/global"}
    probe.choose_backend.cache_clear()


def test_the_filter_changes_the_motion_of_every_system_but_not_the_raw_numbers(ask: Ask) -> None:
    raw = generate_all(ask(out=ask().out / "raw"))
    smooth = generate_all(ask(out=ask().out / "smooth", post_filter="savgol"))
    for name in ("globaldiff-local.npz", "globaldiff-global.npz"):
        jagged = load_motion(raw.out / name).poses
        smoothed = load_motion(smooth.out / name).poses
        assert (
            np.abs(np.diff(smoothed, 3, axis=0)).mean() < np.abs(np.diff(jagged, 3, axis=0)).mean()
        )
    assert raw.diagnostics.as_json() == smooth.diagnostics.as_json()


def test_guidance_changes_the_motion_and_is_recorded(ask: Ask) -> None:
    plain = generate_all(ask(out=ask().out / "plain", systems=("globaldiff/global",)))
    guided = generate_all(
        ask(out=ask().out / "guided", systems=("globaldiff/global",), guidance=3.0)
    )
    poses = [load_motion(r.out / "globaldiff-global.npz").poses for r in (plain, guided)]
    assert np.abs(poses[0] - poses[1]).max() > 1e-3
    record = json.loads((guided.out / "provenance.json").read_text())
    assert record["options"]["guidance"] == {"globaldiff/global": 3.0}


def test_each_system_takes_the_steps_it_was_given_and_the_record_says_so(ask: Ask) -> None:
    local, world = "globaldiff/local", "globaldiff/global"

    def run(name: str, steps: int | dict[str, int]) -> tuple[dict[str, np.ndarray], dict]:
        out = generate_all(ask(out=ask().out / name, steps=steps)).out
        record = json.loads((out / "provenance.json").read_text())
        poses = {
            each: load_motion(out / f"{each.replace('/', '-')}.npz").poses
            for each in (local, world)
        }
        return poses, record["options"]["steps"]

    both, recorded = run("both", 2)
    assert recorded == {local: 2, world: 2}
    mixed, recorded = run("mixed", {world: 2})
    assert recorded == {local: 10, world: 2}
    np.testing.assert_array_equal(mixed[world], both[world])
    assert np.abs(mixed[local] - both[local]).max() > 1e-3


def test_joint_and_start_reach_numbers_and_figures(ask: Ask) -> None:
    asked = {"systems": ("globaldiff/global",), "has_figures": True}
    run = generate_all(ask(joint="left_elbow", start_frame=30, **asked))
    assert run.diagnostics.point == "left_elbow"
    with Image.open(run.out / "figure6.png") as picture:
        caption = picture.info["Description"]
    assert caption.startswith("Left elbow, frames 30 to 36")
    with Image.open(run.out / "jitter.png") as picture:
        assert "globaldiff/global has a left elbow jerk of" in picture.info["Description"]


def test_samples_are_named_and_the_first_does_not_depend_on_how_many_there_are(ask: Ask) -> None:
    one = generate_all(ask(out=ask().out / "one", systems=("globaldiff/global",)))
    two = generate_all(ask(out=ask().out / "two", systems=("globaldiff/global",), samples=2))
    assert two.names == ("globaldiff/global", "globaldiff/global.s2")
    first = load_motion(one.out / "globaldiff-global.npz").poses
    again = load_motion(two.out / "globaldiff-global.npz").poses
    second = load_motion(two.out / "globaldiff-global.s2.npz").poses
    np.testing.assert_allclose(first, again, atol=1e-4)
    assert np.abs(first - second).max() > 0.01


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"systems": ("globaldiff/none",)}, "no system 'globaldiff/none'; available: globaldiff"),
        ({"speaker": "nobody"}, "no speaker 'nobody'; choose one of ann, bob"),
        ({"views": ("top",)}, "no view 'top'"),
        ({"views": ()}, "No view"),
        ({"sampler": "magic"}, "no sampler 'magic'"),
        ({"post_filter": "blur"}, "no post-filter 'blur'"),
        ({"samples": 0}, "1 to 8; got 0"),
        ({"face_steps": 0}, "Face steps must be 1 to 1000; got 0"),
        ({"face_steps": 4}, "None of these systems takes steps for the face alone"),
        ({"steps": 0}, "1 to 1000; got 0"),
        (
            {"steps": {"globaldiff/local": 1, "globaldiff/global": 1001}},
            "Steps of globaldiff/global must be 1 to 1000; got 1001",
        ),
        (
            {"steps": {"globaldiff/full": 5}},
            "'globaldiff/full', which is none of the systems of this run; these are globaldiff/",
        ),
        ({"guidance": 11.0}, "0 to 10; got 11"),
        ({"guidance": float("nan")}, "0 to 10; got nan"),
        ({"seed": -1}, "got -1"),
        ({"joint": "nose"}, "no point 'nose' to follow; choose a fingertip"),
        ({"start_frame": 37}, "start at frame 0 to 36; got 37"),
        ({"start_frame": -1}, "start at frame 0 to 36; got -1"),
        ({"size": 254, "has_video": True}, "254 pixels; pictures have 256 to 1080"),
        ({"size": 333, "has_video": True}, "333 pixels"),
        ({"weights": Path("/nowhere")}, "No trained systems were found in /nowhere"),
        ({"speech": Path("/nowhere/speech.wav")}, "speech.wav does not exist"),
        ({"reference": Path("/nowhere/m.npz")}, "m.npz does not exist"),
        ({"body": Path("/nowhere/body.npz")}, "body.npz"),
    ],
)
def test_what_cannot_be_is_refused_with_a_sentence_and_leaves_nothing(
    ask: Ask, changes: dict, words: str
) -> None:
    request = ask(**changes)
    with pytest.raises(Exception, match=words) as caught:
        generate_all(request)
    assert sentence_of(caught.value) == str(caught.value)
    assert not request.out.exists()


def test_a_file_that_is_no_body_is_refused(ask: Ask, tmp_path: Path) -> None:
    body = tmp_path / "body.npz"
    np.savez(body, v_template=np.zeros((3, 3)))
    request = ask(body=body)
    with pytest.raises(ValueError, match=r"body\.npz") as caught:
        generate_all(request)
    assert sentence_of(caught.value) and not request.out.exists()


def test_without_gl_a_run_with_video_says_so_before_it_generates(
    ask: Ask, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(probe, "probe_backend", lambda name: probe._broken(name, "gone"))
    probe.choose_backend.cache_clear()
    request = ask(has_video=True)
    stages = []
    with pytest.raises(GLError, match="Neither OpenGL nor numba works"):
        generate_all(request, stages.append)
    assert not request.out.exists()
    assert not any(isinstance(e, Progress) and e.stage == "motion" for e in stages)
    probe.choose_backend.cache_clear()


def test_too_small_a_disk_is_refused_before_anything_is_generated(
    ask: Ask, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(folder: Path, needed_bytes: int) -> None:
        assert needed_bytes > 10e6
        raise RunError("too small")

    monkeypatch.setattr(inputs, "require_free_space", refuse)
    with pytest.raises(RunError, match="too small"):
        generate_all(ask())


@pytest.fixture
def tiny_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 256 KB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(folder)]
    if os.geteuid() != 0 or subprocess.run(command, check=False, capture_output=True).returncode:
        pytest.skip("mounting a small disk needs root")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def test_a_disk_that_fills_up_while_writing_gives_a_sentence_and_leaves_nothing(
    ask: Ask, tiny_disk: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(inputs, "require_free_space", lambda folder, needed_bytes: None)
    with pytest.raises(Exception, match=f"{tiny_disk}.* full") as caught:
        generate_all(ask(out=tiny_disk / "out"))
    assert sentence_of(caught.value) == str(caught.value)
    assert names_in(tiny_disk) == set()


@pytest.mark.gl
def test_cancelling_ends_the_children_and_leaves_nothing(ask: Ask) -> None:
    request = ask(has_video=True, size=512)
    is_drawing = threading.Event()

    def watch(event) -> None:
        if isinstance(event, Progress) and event.stage == "video" and event.fraction > 0:
            is_drawing.set()

    with pytest.raises(CancelledRun):
        generate_all(request, watch, is_drawing.is_set)
    assert is_drawing.is_set()
    assert not request.out.exists()
    time.sleep(0.1)
    found = subprocess.run(
        ["ps", "--ppid", str(os.getpid()), "-o", "args="],
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    assert "renderer.video.worker_child" not in found


def test_cancelling_before_the_first_window_stops_generation(ask: Ask) -> None:
    request = ask()
    with pytest.raises(CancelledRun):
        generate_all(request, should_cancel=lambda: True)
    assert not request.out.exists()


def test_cancel_is_heard_while_motions_are_measured(ask: Ask) -> None:
    request = ask()
    shares: list[float] = []

    def watch(event) -> None:
        if isinstance(event, Progress) and event.stage == "numbers":
            shares.append(event.fraction)

    with pytest.raises(CancelledRun):
        generate_all(request, watch, lambda: len(set(shares)) > 1)
    assert 0.0 < max(shares) < 1.0
    assert not request.out.exists()


def test_a_live_take_is_kept_as_it_was_seen_and_said_to_be_live(ask: Ask, tmp_path: Path) -> None:
    seen = smooth_motion_example(37, seed=4)
    path = tmp_path / "live.npz"
    save_motion(seen, path)
    take = Take(path, {"frames_heard_ahead": 10, "speech_level": "running"})
    result = generate_all(ask(systems=("globaldiff/global",), take=take))
    assert result.names == ("globaldiff/global",) and result.num_frames == 37
    kept = load_motion(result.out / "globaldiff-global.npz")
    np.testing.assert_array_equal(kept.poses, seen.poses)
    np.testing.assert_array_equal(kept.expressions, seen.expressions)
    record = json.loads((result.out / "provenance.json").read_text())
    assert record["options"]["live"] == take.facts
    assert any("made while the speech was spoken" in note for note in result.notes)
    assert not (result.out / "globaldiff-global.plan.json").exists()
    plan = GesturePlan(37 / 30, right=(phase(0.0, 1.0, "stroke", kind="you"),))
    plan.write(tmp_path / "live.plan.json")
    events: list[Artefact] = []
    planned = generate_all(
        ask(
            systems=("globaldiff/global",),
            take=replace(take, plan=tmp_path / "live.plan.json"),
            out=tmp_path / "planned",
        ),
        lambda event: events.append(event) if isinstance(event, Artefact) else None,
    )
    kinds = [event.kind for event in events if event.kind in ("plan", "motion")]
    assert kinds == ["plan", "motion"], "no other plan is sought in the motion"
    left = read_plan(planned.out / "globaldiff-global.plan.json")
    assert left.right[0].kind == "you" and planned.out / "globaldiff-global.plan.json" in set(
        planned.files
    )
    generated = generate_all(ask(systems=("globaldiff/global",), out=tmp_path / "other"))
    record = json.loads((generated.out / "provenance.json").read_text())
    assert record["options"]["live"] is None


@pytest.mark.gl
def test_figure_6_has_poses_where_no_video_is_drawn(ask: Callable[..., GenerateRequest]) -> None:
    bare = generate_all(ask(has_figures=True))
    told: list[Artefact] = []
    request = ask(out=bare.out.with_name("posed"), has_poses=True, has_figures=True)
    result = generate_all(request, lambda e: told.append(e) if isinstance(e, Artefact) else None)
    assert [path.name for path in result.files] == [path.name for path in bare.files]
    assert not any(each.kind in ("video", "poster", "comparison") for each in told)
    sizes = [(run.out / "figure6.png").stat().st_size for run in (bare, result)]
    assert sizes[1] > 1.3 * sizes[0], "the poses are in it"
