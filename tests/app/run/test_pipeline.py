"""Runs from speech to files: what they leave, tell, record, refuse, and what stops them."""

import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from shutil import copytree

import av
import numpy as np
import pytest
from PIL import Image

from app.errors import Cancelled, RunError, message_for_user
from app.findings.metric_table import JERK
from app.run.bodies import alignment_to_origin
from app.run.callbacks import FolderUpdated, RunCallbacks, RunEvent, StageProgress
from app.run.frame_packets import HEADER, frames_message
from app.run.models import get_system, warm_up_in_steps
from app.run.output.run_folder import RunRecord, read_run
from app.run.pipeline import redraw_figure6, run
from app.run.requests.convert import replace_fields
from app.run.requests.parts import FIGURE_PANELS, LiveRecording
from app.run.requests.requests import AnyRun, Figure6Request
from app.run.tasks import RunResult
from model.motion.motion import load_motion, save_motion
from model.plan.files import read_plan_file, write_plan_file
from model.plan.plan import GesturePlan
from model.speech.audio import write_wav
from model.storage.checkpoint import load_weights, save_weights
from model.systems.registry import list_systems
from renderer.draw import probe
from tests.app.requests import generate_request
from tests.helpers import smooth_motion_example
from tests.model.made import made_waveform
from tests.model.plan.made import phase
from tests.renderer.drawn import children_that_draw
from tests.waiting import wait_for

Asks = Callable[..., AnyRun]
LOCAL, WORLD = "globaldiff/local", "globaldiff/global"
SHORT, LONG = 16, 113
"""Frames: half a second and a little, and two windows with a rest."""
WITHOUT_VIDEO = {
    *("globaldiff-global.npz", "diagnostics.json", "diagnostics.csv", "provenance.json"),
    *("run.json", "speech.wav", "timeline.json"),
}
Told = list[RunEvent | RunRecord]
"""With what the folder said in place of the news that it says more."""


def noted(told: Told) -> Callable[[RunEvent], None]:
    return lambda event: told.append(
        read_run(event.folder) if isinstance(event, FolderUpdated) else event
    )


def names_in(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir() if path.is_file()}


def poses(result: RunResult, name: str) -> np.ndarray:
    return load_motion(result.out / f"{name.replace('/', '-')}.npz").poses


def options_of(result: RunResult) -> dict:
    return json.loads((result.out / "provenance.json").read_text())["options"]


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("short")
    write_wav(folder / "speech.wav", made_waveform(round(16_000 * SHORT / 30)))
    save_motion(smooth_motion_example(SHORT + 9), folder / "reference.npz")
    return folder / "speech.wav"


Whole = tuple[RunResult, Told]


@pytest.fixture(scope="module")
def whole(short: Path, weights: Path) -> Whole:
    """One run with everything, and all that it told."""
    events: Told = []
    request = generate_request(
        speech=short, out=short.with_name("out"), weights=weights, systems=(WORLD,), steps=1,
        seed=5, post_filter="savgol", tracked_point="left_elbow", start_frame=5, has_video=True,
        reference=short.with_name("reference.npz"), picture_height_px=256,
    )  # fmt: skip
    return run(request, RunCallbacks(noted(events))), events


@pytest.mark.gl
def test_a_whole_run_leaves_every_file_with_exactly_the_frames_of_the_speech(whole: Whole) -> None:
    result, _ = whole
    videos = {"globaldiff-global.mp4", "reference.mp4"}
    kinds = ("png", "svg", "pdf", "txt")
    figures = {f"{name}.{kind}" for name in ("figure6", "jitter") for kind in kinds}
    assert names_in(result.out) == WITHOUT_VIDEO | figures | videos | {"comparison.mp4"}
    told = read_run(result.out)
    assert names_in(result.out) == {name for name in told.files if "/" not in name} | {"run.json"}
    assert told.state == "done" and all((result.out / name).is_file() for name in told.all_files)
    assert [row.files["video"] for row in told.rows] == ["globaldiff-global.mp4", "reference.mp4"]
    assert [row.name for row in told.rows] == [WORLD, "reference"]
    for name in (*videos, "comparison.mp4"):
        with av.open(str(result.out / name)) as video:
            assert sum(1 for _ in video.decode(video=0)) == SHORT, name
            assert len(video.streams.audio) == 1
            assert abs(float(video.duration / av.time_base) - SHORT / 30) < 1 / 30
    with av.open(str(result.out / "comparison.mp4")) as video:
        assert video.streams.video[0].width == 2 * 192
    assert any(f"the reference was cut to {SHORT}" in note for note in result.notes)


@pytest.mark.gl
def test_a_whole_run_tells_how_far_it_is_and_of_numbers_before_pictures(whole: Whole) -> None:
    result, events = whole
    for stage in ("speech", "motion", "numbers", "video", "comparison", "figure"):
        fractions = [
            e.fraction for e in events if isinstance(e, StageProgress) and e.stage == stage
        ]
        assert fractions == sorted(fractions) and fractions[-1] == 1.0, stage
    told = [event for event in events if isinstance(event, RunRecord)]
    has = [
        (
            all("motion" in row.files for row in each.rows) and bool(each.rows),
            each.timeline is not None,
            bool(each.metrics),
            any(name.endswith(".png") for name in each.files),
            each.state == "done",
        )
        for each in told
    ]
    assert has == sorted(has), "motion, time line, numbers, pictures, end"
    assert told[-1].metrics[WORLD]["raw"][JERK] == pytest.approx(
        result.diagnostics.systems[WORLD].raw.point.tip_jerk_m_s3
    )
    growing = [row.available for each in told for row in each.rows if row.available is not None]
    assert {there.num_ready for there in growing} == {SHORT}, "filtered as a whole only"


@pytest.mark.gl
def test_a_whole_run_records_what_made_it_and_follows_the_point_that_was_asked_for(
    whole: Whole,
) -> None:
    result, _ = whole
    record, options = json.loads((result.out / "provenance.json").read_text()), options_of(result)
    assert (options["seed"], options["post_filter"], options["speaker"]) == (5, "savgol", "ann")
    assert options["live"] is None and options["reference"] == "reference.npz"
    assert record["speech"]["frames"] == SHORT and len(record["speech"]["sha256"]) == 64
    assert set(record["weights"]) == {WORLD}
    assert len(record["weights"][WORLD]["sha256"]) == 64
    diagnostics = json.loads((result.out / "diagnostics.json").read_text())
    assert diagnostics == result.diagnostics.as_json()
    assert "beat_align" in diagnostics["systems"][WORLD]["raw"]
    assert result.diagnostics.tracked_point == "left_elbow"
    with Image.open(result.out / "figure6.png") as picture:
        assert picture.info["Description"].startswith(f"Left elbow, frames 5 to {SHORT - 1}")
    with Image.open(result.out / "jitter.png") as picture:
        assert "Left elbow jerk in m/s³: global " in picture.info["Description"]


@pytest.mark.gl
def test_figure_6_of_a_finished_run_is_drawn_again_from_its_folder(
    whole: Whole, tmp_path: Path
) -> None:
    run_folder = whole[0].out
    same = Figure6Request(run=run_folder, out=tmp_path / "figure6", body=None)
    same = replace_fields(same, start_frame=5, figure_formats=("png",))
    picture, caption = redraw_figure6(same)
    assert caption.read_text() == (run_folder / "figure6.txt").read_text()
    narrow = replace_fields(same, figure_panels=("a",), figure_width="85mm")
    picture, caption = redraw_figure6(narrow)
    with Image.open(picture) as drawn:
        assert drawn.width == 1003, "85 mm at 300 dpi"
    assert "jerk of each joint" not in caption.read_text()
    with pytest.raises(RunError, match=f"must be from 0 to {SHORT - 1}; got {SHORT}"):
        redraw_figure6(replace_fields(same, figure_frames=(SHORT,)))


@pytest.fixture
def without_gl(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(probe, "probe_backend", lambda name, **_: probe._broken(name, "gone"))
    probe.choose_backend.cache_clear()
    yield
    probe.choose_backend.cache_clear()


@pytest.mark.gl
def test_a_run_without_video_needs_no_gl_and_the_filter_changes_motion_but_no_number(
    ask: Asks, whole: Whole, short: Path, without_gl: None
) -> None:
    smooth, _ = whole
    asked = {
        "seed": 5,
        "tracked_point": "left_elbow",
        "reference": short.with_name("reference.npz"),
    }
    raw = run(ask(speech=short, systems=(WORLD,), **asked))
    assert names_in(raw.out) == WITHOUT_VIDEO
    assert raw.diagnostics.as_json() == smooth.diagnostics.as_json()
    jagged, filtered = (np.diff(poses(run, WORLD), 3, axis=0) for run in (raw, smooth))
    assert np.abs(filtered).mean() < 0.9 * np.abs(jagged).mean()


def test_without_gl_a_run_with_video_leaves_all_but_pictures_and_says_so(
    ask: Asks, without_gl: None
) -> None:
    made = run(ask(systems=(WORLD,), has_video=True, has_figures=True))
    figures = {
        f"{name}.{end}" for name in ("figure6", "jitter") for end in ("png", "svg", "pdf", "txt")
    }
    assert figures <= names_in(made.out)
    assert not any(name.endswith("mp4") for name in names_in(made.out))
    (told,) = [note for note in made.notes if "OpenGL" in note]
    assert told.startswith("Videos and snapshots are left out.") and "apt-get install" in told


def test_steps_guidance_and_samples_are_those_asked_for_and_recorded(
    ask: Asks, short: Path
) -> None:
    """The first of several samples is the one that there is alone."""

    def made(name: str, **asked) -> RunResult:
        return run(ask(speech=short, out=ask().output.out / name, **asked))

    both = made("both", steps=2)
    assert options_of(both)["steps"] == {LOCAL: 2, WORLD: 2}
    mixed = made("mixed", steps={WORLD: 2}, samples=2)
    assert options_of(mixed)["steps"] == {LOCAL: 10, WORLD: 2}
    names = [row.name for row in read_run(mixed.out).rows]
    assert names == [LOCAL, f"{LOCAL}.s2", WORLD, f"{WORLD}.s2"]
    np.testing.assert_allclose(poses(mixed, WORLD), poses(both, WORLD), atol=1e-4)
    assert np.abs(poses(mixed, LOCAL) - poses(both, LOCAL)).max() > 1e-3
    assert np.abs(poses(mixed, WORLD) - poses(mixed, f"{WORLD}.s2")).max() > 0.01
    guided = made("guided", steps=2, systems=(WORLD,), guidance=3.0)
    assert options_of(guided)["guidance"] == {WORLD: 3.0}
    assert np.abs(poses(guided, WORLD) - poses(both, WORLD)).max() > 1e-3


def test_what_cannot_be_is_refused_with_a_sentence_and_leaves_nothing(
    ask: Asks, short: Path
) -> None:
    for changes, words in [
        ({"systems": ("globaldiff/none",)}, "no system 'globaldiff/none'; available: globaldiff"),
        ({"speaker": "nobody"}, "no speaker 'nobody'; choose one of ann, bob"),
        ({"views": ("top",)}, "no view 'top'"),
        ({"views": ()}, "No view"),
        ({"sampler": "magic"}, "no sampler 'magic'"),
        ({"post_filter": "blur"}, "no post-filter 'blur'"),
        ({"word_source": "guess"}, "no word source 'guess'; choose one of recognise, none"),
        ({"samples": 0}, "1 to 8; got 0"),
        ({"steps": 0}, "1 to 1000; got 0"),
        ({"steps": {LOCAL: 1, WORLD: 1001}}, f"steps of {WORLD} must be from 1 to 1000; got 1001"),
        ({"steps": {"globaldiff/full": 5}}, "globaldiff/full, which is not part of"),
        ({"guidance": 11.0}, "0 to 10; got 11"),
        ({"guidance": float("nan")}, "0 to 10; got nan"),
        ({"seed": -1}, "got -1"),
        ({"tracked_point": "nose"}, "no point 'nose' to track; choose a fingertip"),
        (
            {"start_frame": SHORT},
            f"start frame of Figure 6 must be from 0 to {SHORT - 1}; got {SHORT}",
        ),
        ({"start_frame": -1}, f"start frame of Figure 6 must be from 0 to {SHORT - 1}; got -1"),
        (
            {"picture_height_px": 254, "has_video": True},
            "an even number of pixels from 256 to 1080; got 254",
        ),
        (
            {"picture_height_px": 333, "has_video": True},
            "an even number of pixels from 256 to 1080; got 333",
        ),
        ({"weights": Path("/nowhere")}, "No trained systems were found in /nowhere"),
        ({"speech": Path("/nowhere/speech.wav")}, "speech.wav does not exist"),
        ({"reference": Path("/nowhere/m.npz")}, "m.npz does not exist"),
        ({"body": Path("/nowhere/body.npz")}, "body.npz"),
    ]:
        request = ask(**{"speech": short, **changes})
        with pytest.raises(Exception, match=words) as caught:
            run(request)
        assert message_for_user(caught.value) == str(caught.value)
        assert not request.output.out.exists()


@pytest.fixture(scope="module")
def long(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("long") / "speech.wav"
    write_wav(path, made_waveform(round(16_000 * LONG / 30)))
    return path


def parts(message: bytes) -> tuple[bytes, ...]:
    """Places, turns and faces of one message."""
    _, count, faces, *_ = HEADER.unpack_from(message)
    edges = np.cumsum([HEADER.size, 12 * count, 440 * count, faces * count])
    assert edges[-1] == len(message)
    return tuple(message[a:b] for a, b in pairwise(edges))


def test_windows_are_told_in_turns_and_hold_the_bytes_of_the_whole(ask: Asks, long: Path) -> None:
    """All systems begin before any goes on, and files come when they are whole."""
    events: Told = []
    result = run(ask(speech=long, samples=2), RunCallbacks(noted(events)))
    grown = [event for event in events if isinstance(event, RunRecord)]
    each = [
        (row.name, end)
        for record in grown
        for row in record.rows
        for end in (
            row.available and row.available.num_ready,
            "motion" in row.files and "whole",
        )
        if end
    ]
    told = list(dict.fromkeys(each))
    rows = {name: (name, f"{name}.s2") for name in (LOCAL, WORLD)}
    windows = [(row, end) for end in (52, 104) for name in rows for row in rows[name]]
    ends = [(row, end) for name in rows for end in (LONG, "whole") for row in rows[name]]
    assert told == windows + ends
    for row in grown[-1].rows:
        content = (result.out / row.files["frames"]).read_bytes()
        assert row.available is not None and len(content) == row.available.num_bytes
        messages = []
        while content:
            first, count, faces, *_ = HEADER.unpack_from(content)
            assert first == 52 * len(messages)
            size = HEADER.size + (12 + 440 + faces) * count
            messages.append(parts(content[:size]))
            content = content[size:]
        motion = load_motion(result.out / row.files["motion"])
        each = zip(*messages, strict=True)
        assert tuple(map(b"".join, each)) == parts(frames_message(0, motion)), "to the bit"
        place = alignment_to_origin(motion)
        assert row.available.root_transform == (place.yaw_rad, *place.translation_m)


def _frames(record: RunRecord, name: str) -> int:
    row = record.row(name)
    return row.available.num_ready if row is not None and row.available is not None else 0


@pytest.mark.parametrize(
    "is_time",
    [
        lambda events: True,
        lambda events: any(isinstance(e, RunRecord) and _frames(e, WORLD) == 104 for e in events),
        lambda events: any(
            isinstance(e, StageProgress) and e.stage == "numbers" for e in events[:-1]
        ),
    ],
    ids=["at once", "amid the windows", "amid the numbers"],
)
def test_a_run_that_is_cancelled_leaves_nothing(
    ask: Asks, long: Path, is_time: Callable[[Told], bool], request: pytest.FixtureRequest
) -> None:
    events: Told = []
    asked = ask(speech=long)
    with pytest.raises(Cancelled):
        run(asked, RunCallbacks(noted(events), lambda: is_time(events)))
    assert not asked.output.out.exists()
    is_whole = any(isinstance(e, RunRecord) and "motion" in str(e.rows) for e in events)
    assert is_whole == ("numbers" in request.node.callspec.id)
    shares = [e.fraction for e in events if isinstance(e, StageProgress) and e.stage == "numbers"]
    assert max(shares, default=0.0) < 1.0


@pytest.mark.gl
def test_cancelling_ends_the_children_that_draw(ask: Asks) -> None:
    request, told, seen = ask(has_video=True, picture_height_px=256), [], []

    def should_cancel() -> bool:
        if any(isinstance(e, StageProgress) and e.stage in ("numbers", "video") for e in told):
            seen.extend(children_that_draw())
        return bool(seen)

    with pytest.raises(Cancelled):
        run(request, RunCallbacks(told.append, should_cancel))
    assert seen and not request.output.out.exists()
    wait_for(lambda: not children_that_draw())


def test_a_live_take_is_kept_as_it_was_seen_and_said_to_be_live(ask: Asks, tmp_path: Path) -> None:
    seen = smooth_motion_example(37, seed=4)
    save_motion(seen, tmp_path / "live.npz")
    plan = GesturePlan(37 / 30, right=(phase(0.0, 1.0, "stroke", kind="you"),))
    write_plan_file(plan, tmp_path / "live.plan.json")
    facts = {"frames_heard_ahead": 10, "speech_level": "running"}
    take = LiveRecording(tmp_path / "live.npz", facts, plan=tmp_path / "live.plan.json")
    result = run(ask(systems=(WORLD,), take=take))
    (row,) = read_run(result.out).rows
    assert row.files["plan"] == row.files["input_plan"], "no other is sought"
    kept = load_motion(result.out / "globaldiff-global.npz")
    np.testing.assert_array_equal(kept.poses, seen.poses)
    np.testing.assert_array_equal(kept.expressions, seen.expressions)
    assert options_of(result)["live"] == facts
    assert any("generated live, in windows" in note for note in result.notes)
    left = read_plan_file(result.out / "globaldiff-global.plan.json").plan
    assert left.right[0].kind == "you"
    bare = run(ask(systems=(WORLD,), take=replace(take, plan=None), out=tmp_path / "bare"))
    assert not [*bare.out.glob("*.plan.json")]


@pytest.mark.slow
@pytest.mark.gl
def test_figure_6_has_poses_where_no_video_is_drawn(ask: Asks, short: Path) -> None:
    shown = {"figure_panels": ("b",), "figure_frames": (3, 9), "figure_width": "85mm"}
    asked = ask(speech=short, systems=(WORLD,), has_figures=True, **shown)
    run(asked)
    assert not [path for path in asked.output.out.iterdir() if path.suffix in (".mp4", ".jpg")]
    drawn = (asked.output.out / "figure6.svg").read_text()
    assert drawn.count("<image") == 1 and "Snapshots by frame" in drawn and "time (s)" not in drawn
    assert 'width="240.94' in drawn, "85 mm in points"
    late = replace_fields(asked, figure_frames=(3, SHORT), out=asked.output.out / "late")
    with pytest.raises(RunError, match=f"must be from 0 to {SHORT - 1}; got {SHORT}"):
        run(late)
    column = replace_fields(asked, samples=5, figure_panels=tuple(FIGURE_PANELS), figure_frames=())
    with pytest.raises(RunError, match="motions with the panels a,b,c,d is taller than a page"):
        run(replace_fields(column, out=asked.output.out / "tall"))


def test_reading_stops_after_each_system_so_that_work_can_come_between(weights: Path) -> None:
    names = list_systems(weights)
    assert len(names) > 1
    assert sum(1 for _ in warm_up_in_steps(weights, None)) == 1 + len(names)
    assert all(get_system(name, weights) is get_system(name, weights) for name in names)


def test_weights_trained_anew_are_read_anew_and_no_others(weights: Path, tmp_path: Path) -> None:
    own = copytree(weights, tmp_path / "weights")
    before = get_system(LOCAL, own)
    tensors, card = load_weights(own, LOCAL)
    (own / "log.csv").write_text("step")
    assert get_system(LOCAL, own) is before
    moved = {name: tensor + 1 for name, tensor in tensors.items()}
    save_weights(own, LOCAL, moved, {key: card[key] for key in card if key != "sha256"})
    after = get_system(LOCAL, own)
    assert after.sha256s[LOCAL] == load_weights(own, LOCAL)[1].sha256 != before.sha256s[LOCAL]
    assert get_system(LOCAL, own) is after
