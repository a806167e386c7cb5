"""What forms are given becomes the requests and plans of a command line, or a sentence."""

import os
import zipfile
from pathlib import Path
from typing import Any

import gradio as gr
import pytest

from app import text
from app.config import AppConfig
from app.errors import RunError
from app.page.parts.catalogue import Catalogue, default_systems
from app.page.parts.form_values import Fields, parse_form_values
from app.page.tabs.motion import build_form, copy_as_upload, request_from_form, save_form_values
from app.page.tabs.motion_run import RunProgress
from app.page.tabs.own_motion import (
    MAX_NAME,
    build_own_motion_form,
    display_names,
    has_clip_archives,
    own_motion_request,
)
from app.page.tabs.runner import Services
from app.page.tabs.study import STUDY_PRESETS, build_study_tab, collect_files, study_plan_toml
from app.run.callbacks import StageProgress
from app.run.display import Display
from app.run.generated_motions import row_names
from app.run.requests.requests import DiagnoseRequest, GenerateRequest
from app.study.design.plan import StudyPlan, read_study_plan
from model.plan.style import StyleChange
from model.systems.globaldiff.config import PRIORFLOW, SYSTEMS
from model.systems.planned.config import PLANNED
from tests.app import fakes
from tests.app.requests import generate_request

FORM: dict[str, Any] = {
    "speech": "/speech.wav",
    "systems": ["globaldiff/global", "globaldiff/local"],
    "speaker": "scott",
    "seed": 3,
    "samples": 2,
    "steps": "7",
    "sampler": "heun",
    "post_filter": True,
    "reference": "/reference.npz",
    "joint": "left_index",
    "start_frame": 12,
    "figure_panels": ["a", "b"],
    "figure_frames": "80, 0,40",
    "figure_width": "85mm",
    "transcript": "/said.txt",
    "words": True,
    "has_video": False,
}
CONFIG = AppConfig(weights=Path("/weights"))


@pytest.fixture(scope="module")
def services(tmp_path_factory: pytest.TempPathFactory) -> Services:
    return fakes.made_services(tmp_path_factory.mktemp("page"))


@pytest.fixture(scope="module")
def form(services: Services) -> Fields:
    with gr.Blocks():
        return build_form(services).fields


@pytest.fixture(scope="module")
def own_form(services: Services) -> Fields:
    with gr.Blocks():
        return build_own_motion_form(services).fields


@pytest.fixture(scope="module")
def study_form(services: Services) -> Fields:
    with gr.Blocks():
        return build_study_tab(services)


def told(form: Fields, asked: type = GenerateRequest, **sent: Any) -> dict[str, Any]:
    """As the page has it, but for what was sent."""
    return parse_form_values(
        asked, form, [sent.get(name, part.value) for name, part in form.items()]
    )


def read(form: Fields, catalogue: Catalogue = fakes.CATALOGUE, **changes: Any) -> GenerateRequest:
    return request_from_form(told(form, **FORM | changes), Path("/job"), catalogue, CONFIG)


def test_every_field_of_the_form_reaches_the_run(form):
    request = read(form)
    assert request == generate_request(
        speech=Path("/speech.wav"),
        out=Path("/job/results"),
        weights=Path("/weights"),
        systems=("globaldiff/local", "globaldiff/global"),  # in the catalogue's order
        speaker="scott",
        seed=3,
        samples=2,
        steps=7,
        sampler="heun",
        post_filter="savgol",
        reference=Path("/reference.npz"),
        transcript=Path("/said.txt"),
        word_source="recognise",
        tracked_point="left_index",
        start_frame=12,
        figure_panels=("a", "b"),
        figure_frames=(0, 40, 80),
        figure_width="85mm",
        figure_formats=("png",),
        close_ups=("face", "hands"),
        picture_height_px=640,
        display=Display(has_trail=True),
        has_video=False,
    )
    assert tuple(row_names(request, request.sampling.systems)) == (
        *("globaldiff/local", "globaldiff/local.s2"),
        *("globaldiff/global", "globaldiff/global.s2"),
        "reference",
    )
    assert [read(form, guidance=value).sampling.guidance for value in ("", 1.0, 2.5)] == [
        None,
        1.0,
        2.5,
    ]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"speech": None}, "no speech yet"),
        ({"systems": []}, "Select at least one system"),
        ({"seed": -1}, "Seed must be a whole number from 0 to 2147483647; got -1"),
        ({"seed": 2**31}, "got 2147483648"),
        ({"samples": 0}, "from 1 to 8; got 0"),
        ({"samples": 7}, "2 systems with 7 samples each give 15 bodies"),
        ({"steps": "many"}, "must be a whole number, or one per system"),
        ({"start_frame": -1}, "got -1"),
        ({"figure_frames": "0,x"}, "'0,x' is not a list of 1 to 7 frames"),
        ({"guidance": 11.0}, "0 to 10; got 11"),
        ({"sampler": ["euler"]}, "The field `sampler` cannot be"),
        ({"joint": ["right_middle"]}, "The field `joint` cannot be"),
        ({"guidance": "much"}, "The field `guidance.float` cannot be"),
        ({"samples": float("nan")}, "The field `samples` cannot be"),
        ({"speaker": "a" * 5001}, "The field `speaker` cannot be"),
    ],
)
def test_a_form_that_cannot_be_done_gives_a_sentence(form, changes, words):
    with pytest.raises(RunError, match=words):
        read(form, **changes)


def test_steps_go_to_the_systems_that_have_them(form):
    assert read(form).sampling.steps == 7
    assert read(form, steps="global=5").sampling.steps == {"globaldiff/global": 5}, (
        "as the form calls it"
    )


def test_what_fills_the_form_in_again_is_all_but_files_that_a_run_does_not_show(form, tmp_path):
    speech = tmp_path / "three reasons.wav"
    speech.write_bytes(b"RIFF")
    job = tmp_path / "job"
    job.mkdir()
    sent = {name: part.value for name, part in form.items()} | FORM
    sent["speech"] = str(speech)
    kept = save_form_values(form, list(sent.values()), job)
    again = Path(kept.pop("speech"))
    assert again.name == speech.name and job in again.parents and again.read_bytes() == b"RIFF"
    files = ("speech", "reference", "transcript", "plan")
    assert kept == {name: value for name, value in sent.items() if name not in files}


def test_several_clips_are_one_run_over_the_folder_that_they_are_laid_in(form, tmp_path):
    alone = dict.fromkeys(("reference", "transcript", "plan"))
    speeches = [tmp_path / f"{name}.wav" for name in "abc"]
    for path in speeches:
        path.write_text(path.stem)
    first, *others = map(str, speeches)
    asked = read(form, **alone, speech=first, clips=others, has_video=True)
    assert asked.speech.path == Path("/job/form") and not asked.output.has_video
    assert read(form, **alone, speech=None, clips=others[:1]).speech.path == speeches[1]
    sent = {name: part.value for name, part in form.items()}
    kept = save_form_values(
        form, list((sent | {"speech": first, "clips": others}).values()), tmp_path
    )
    assert kept["speech"] is None and [Path(path).stem for path in kept["clips"]] == list("abc")
    assert [path.read_text() for path in sorted((tmp_path / "form").iterdir())] == list("abc")
    for changes, words in (
        ({"clips": [first]}, "Two clips are called 'a'"),
        ({"clips": ["/up/b.aiff"]}, r"b\.aiff is not a supported audio file\. Supported: \.wav,"),
        ({"clips": others, "plan": "/plan.json"}, "belongs to a single clip"),
        ({"clips": [f"{number}.wav" for number in range(10)]}, "at most 10 clips; 11 were given"),
    ):
        with pytest.raises(RunError, match=words):
            read(form, **{**alone, "speech": first, **changes})
    line = RunProgress().updated_html([StageProgress("speech", 0.5, clips_text="2 clips")])
    assert f"2 clips: {text.STAGE_NAMES['speech']}" in line


def test_what_a_form_offers_and_says_of_the_run(tmp_path):
    first = [PRIORFLOW, "globaldiff/local", "globaldiff/global"]
    assert default_systems(list(SYSTEMS)) == first and default_systems(first[:2]) == first[:2]
    assert default_systems(["a", "globaldiff/global", "b", "c"]) == ["a", "globaldiff/global", "b"]
    path = tmp_path / "example.wav"
    path.write_bytes(b"sound")
    os.utime(path, (0, 0))
    for _ in range(2):  # an example is as new as an upload, however old its file
        copy = copy_as_upload(path, tmp_path / "cache")
        assert copy.read_bytes() == b"sound" and copy.stat().st_mtime > 10**9
        os.utime(copy, (0, 0))
    assert [each.name for each in copy.parent.iterdir()] == ["example.wav"]
    line = RunProgress()
    assert text.STARTING_SYSTEMS in line.updated_html([])
    told = line.updated_html(
        [StageProgress("speech", 1.0), StageProgress("motion", 0.5, "globaldiff/local")]
    )
    assert text.STAGE_NAMES["motion"] in told and "50 %" in told


MOTIONS = [f"{letter}.npz" for letter in "abcdefghijklmnopqrstuvwxy"]


def own(form: Fields, *motions: str, **changes: Any) -> DiagnoseRequest:
    return own_motion_request(
        told(form, DiagnoseRequest, motions=list(motions), **changes), Path("job"), CONFIG
    )


def test_the_form_of_own_motion_becomes_the_ask(own_form):
    given = "/up/1/a.npz", "/up/2/a.npz", "/up/r.npz", "/up/said.txt"
    files = own(own_form, *given, recorded="r", start_frame=30.0)
    assert files.motions.names == ("a", "a (2)")
    assert files.motions.motions == (Path("/up/1/a.npz"), Path("/up/2/a.npz"))
    assert (files.imports.reference, files.speech.path) == (Path("/up/r.npz"), None)
    assert files.speech.transcript == Path("/up/said.txt")
    assert (files.figures.start_frame, files.tracked_point, files.output.out) == (
        30,
        "right_middle",
        Path("job/results"),
    )
    assert files.output.has_video and files.motions.generation_window_frames is None
    names = display_names(["x" * 100, "x" * 90, "b"])
    assert names == ("x" * MAX_NAME, "x" * MAX_NAME + " (2)", "b")
    assert own(own_form, *MOTIONS[:8], shown=["b", "h"], recorded="h").motions.visible == ("b",)
    assert own(own_form, *MOTIONS[:3], shown=["b"]).motions.visible == (), "all of them fit"


def test_what_is_said_of_files_reaches_runs_and_sets_but_not_of_files_that_are_gone(own_form):
    said = {"told": "*.bvh:up=z,a:rate=25,gone:up=x,units=cm", "channel": "right"}
    asked = own(own_form, "/up/a.npz", "/up/s.wav", **said)
    assert asked.speech.path == Path("/up/s.wav")
    assert [each[0] for each in asked.imports.import_overrides.entries] == ["a", ""]
    assert asked.speech.channel == 1
    sets = own(own_form, "/up/a.tar.gz", **said)
    assert has_clip_archives(sets.motions.motions) and not has_clip_archives(asked.motions.motions)
    assert sets.motions.names == ("a",) and sets.speech.channel == 1
    assert len(sets.imports.import_overrides.entries) == 4


@pytest.mark.parametrize(
    ("motions", "changes", "words"),
    [
        (["s.wav", "said.txt"], {}, "at least one motion"),
        (["a.npz", "s.wav", "t.mp3"], {}, "Only one speech file can be used; 2"),
        (["a.npz"], {"recorded": "b"}, "The reference 'b' is no longer among the files"),
        (MOTIONS, {}, "At most 24 files are measured at once; 25"),
        (MOTIONS[:8], {"shown": [*"abcdefg"]}, "At most 6 motions can be shown"),
        (MOTIONS[:8], {"shown": [*"abcdefg"], "recorded": "h"}, "At most 5 motions"),
        (MOTIONS[:1], {"start_frame": -1}, "from 0 to 1000000; got -1"),
        (MOTIONS[:1], {"start_frame": 1.5}, "from 0 to 1000000; got 1.5"),
        (MOTIONS[:1], {"window": 0.5}, r"Window length \(frames\) must be a whole number"),
        ([f"{n}.zip" for n in range(7)], {}, "At most 6 motions"),
    ],
)
def test_own_motion_that_cannot_be_measured_gives_a_sentence(own_form, motions, changes, words):
    with pytest.raises(RunError, match=words):
        own(own_form, *motions, **changes)


def test_a_zip_of_sounds_goes_beside_zips_only(own_form, tmp_path):
    path = tmp_path / "set.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a.wav", b"")
    with pytest.raises(RunError, match="Zips of clips cannot be mixed"):
        own(own_form, "a.npz", str(path))
    assert own(own_form, "a.zip", str(path)).speech.path == path


STUDY: dict[str, Any] = {
    "title": 'A "title" with\nlines',
    "protocol": "ranking",
    "speeches": ["/cache/1/one.wav", "/cache/2/two.wav"],
    "systems": ["globaldiff/local"],
    "motions": ["/cache/3/theirs--one.npz", "/cache/4/theirs--two.npz"],
    "length_s": 8,
    "participants": 12,
    "seed": 3,
    "views": ["front", "side"],
}


def planned(form: Fields, folder: Path, **changes: Any) -> StudyPlan:
    path = folder / "plan.toml"
    path.write_text(study_plan_toml(told(form, StudyPlan, **STUDY | changes)), "utf-8")
    return read_study_plan(path)


def test_the_form_of_a_study_becomes_a_plan(study_form, tmp_path):
    plan = planned(study_form, tmp_path)
    assert plan.title == STUDY["title"]
    assert (plan.protocol, plan.participants, plan.seed) == ("ranking", 12, 3)
    assert (plan.video_s, plan.views) == (8.0, ("front", "side"))
    assert [clip.speech for clip in plan.clips] == [tmp_path / "one.wav", tmp_path / "two.wav"]
    assert plan.conditions[1].motion == {
        "one": tmp_path / "theirs--one.npz",
        "two": tmp_path / "theirs--two.npz",
    }
    link = "https://app.prolific.com/submissions/complete?cc=C0DE"
    told = {"return_to": f" {link} ", "contact": "a@lab.example", "consent": "Yes?\nNo?"}
    told["panel_ids"] = "PROLIFIC_PID, STUDY_ID"
    plan = planned(study_form, tmp_path, **told)
    assert (plan.return_to, plan.contact, plan.consent) == (link, "a@lab.example", "Yes?\nNo?")
    assert plan.panel_id_names == ("PROLIFIC_PID", "STUDY_ID")
    bare = planned(study_form, tmp_path, title=" ", seed=None)
    assert (bare.seed, bare.post_to, bare.return_to) == (0, None, None)
    evil = planned(study_form, tmp_path, title='x"\nface = "moving"\ny = "')
    assert evil.face == "still", "a text cannot become settings"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"speeches": None}, "There is no speech yet"),
        ({"length_s": None}, "Enter the length of the videos"),
        ({"motions": ["/cache/one.npz"]}, "must be named <system>--<clip>.npz"),
        ({"length_s": 300}, "40 minutes of video; this page renders at most 30"),
        ({"length_s": 135, "changed": ["smaller", "larger"]}, "36 minutes of video"),
        ({"speeches": [f"/cache/{i}.wav" for i in range(61)]}, "At most 60 files"),
        (
            {"changed": ["slower"]},
            "Unknown modification 'slower'; choose from strokes on other words",
        ),
    ],
)
def test_a_study_that_cannot_be_made_gives_a_sentence(study_form, changes, words):
    with pytest.raises(RunError, match=words):
        study_plan_toml(told(study_form, StudyPlan, **STUDY | changes))


@pytest.mark.parametrize("question", STUDY_PRESETS)
def test_changes_of_gestures_become_systems(study_form, tmp_path, question):
    protocol, changed = STUDY_PRESETS[question]
    asked = {"protocol": protocol, "systems": [PLANNED], "motions": None, "changed": changed}
    plan = planned(study_form, tmp_path, **asked)
    assert plan.protocol == protocol and plan.has_sound
    names = [each.name for each in plan.conditions]
    assert names == [PLANNED, *(f"{PLANNED} {name}" for name in changed)]
    assert {each.system for each in plan.conditions} == {PLANNED}
    styles = [each.style for each in plan.conditions]
    assert styles[0] is None and all(each not in (None, StyleChange()) for each in styles[1:])


def test_uploads_are_put_beside_the_plan(tmp_path):
    uploads = [tmp_path / str(number) / "one.wav" for number in range(2)]
    for upload in uploads:
        upload.parent.mkdir()
        upload.write_bytes(b"sound")
    out = tmp_path / "out"
    out.mkdir()
    collect_files([uploads[0]], out)
    assert (out / "one.wav").read_bytes() == b"sound"
    with pytest.raises(RunError, match=r"Two uploads have the name one\.wav"):
        collect_files([uploads[1]], out)
