"""A run as a file and as a page of its own: what it holds, that it opens, what is refused."""

import json
import re
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fastapi import FastAPI
from starlette.testclient import TestClient

from app.errors import RunError
from app.notebook import show
from app.page.alone import DOOR, WEB, Scene, _needed, player_alone, run_page_routes
from app.page.player.player import Showing, own_writers, picture_layout
from app.page.results.kept_runs import KeptRuns
from app.page.results.run_file import (
    TOLD,
    file_name,
    is_saved_run,
    open_run,
    run_file_routes,
    save_run,
)
from app.page.routes.media import MediaAddresses
from app.run.diagnose import DiagnoseRequest
from app.run.requests.request import Artefact
from conventions.names import REFERENCE_NAME
from model.motion.motion import load_motion, save_motion
from model.plan.plan import GesturePlan, HandPhase
from model.speech.audio import Speech, load_speech, write_wav
from model.speech.transcript import Accent, GestureTier, Interval, Transcript, Word
from tests.app.page.results.made_run import ended_run, keep, numbers
from tests.helpers import smooth_motion_example
from tests.model.made import made_waveform

NAMES = ("globaldiff/local", "globaldiff/global", REFERENCE_NAME)
SAID = Transcript(
    (Word(0.2, 0.5, "<b>hello"),),
    (GestureTier("gesture_left", (Interval(0.3, 0.6, "stroke beat"),)),),
    "aligned",
    (Interval(0.2, 0.3, "HH"),),
    (Accent(0.4, 1.5),),
)
REST = HandPhase(0.0, 2.0, "rest", (0.2, -0.2, 0.2))


@pytest.fixture
def showing(tmp_path: Path) -> Showing:
    """Of two systems and a reference; the first performed a plan."""
    folder = tmp_path / "job"
    folder.mkdir()
    speech = tmp_path / "speech.wav"
    write_wav(speech, made_waveform(32_000))
    made = Showing(
        *(NAMES, NAMES, picture_layout("front", 512, ("hands",), "knees")),
        own_writers(DiagnoseRequest((), folder, speech=speech), folder),
        *(folder, MediaAddresses(), ""),
    )
    plan = folder / "local.plan.json"
    GesturePlan(2.0, (REST,), (REST,)).write(plan)
    made.take(Artefact("plan", NAMES[0], plan))
    for seed, name in enumerate(NAMES):
        path = folder / f"{seed}.npz"
        save_motion(smooth_motion_example(60, seed), path)
        made.take(Artefact("motion", name, path))
    made.timeline()
    made.tell_words(SAID)
    return made


def saved(showing: Showing, tmp_path: Path, **changes: Any) -> Path:
    diagnostics = numbers(120.0, **{name: 100.0 for name in NAMES[:2]})
    values = {"showing": showing, "speech_sha256": "ab12", "diagnostics": diagnostics, **changes}
    return save_run(
        ended_run(tmp_path, "speech: local, global; seed 0", **values), tmp_path / "x.zip"
    )


def test_what_was_saved_is_opened(showing, tmp_path):
    path = saved(showing, tmp_path)
    assert is_saved_run(path)
    opened = open_run(path, tmp_path / "opened")
    assert list(opened.motions) == list(NAMES) and list(opened.plans) == [NAMES[0]]
    for seed, name in enumerate(NAMES):
        motion = load_motion(opened.motions[name])
        np.testing.assert_array_equal(motion.poses, smooth_motion_example(60, seed).poses)
    assert opened.plans[NAMES[0]].read_bytes() == (tmp_path / "job/local.plan.json").read_bytes()
    assert opened.speech is not None and load_speech(opened.speech).num_frames == 60
    told = opened.told
    assert (told.title, told.speech_sha256) == ("speech: local, global; seed 0", "ab12")
    assert told.settings == {"speech": "speech", "systems": "local", "seed": "0"}
    assert told.said == SAID
    with zipfile.ZipFile(path) as archive:
        assert b"100.0" not in archive.read(TOLD), "numbers are measured anew"
    write_wav(showing.sound(), np.zeros(32_000, np.float32))
    opened = open_run(saved(showing, tmp_path), tmp_path / "silent")
    assert opened.speech is None and not opened.told.has_speech, "silence is not saved"


def test_anything_else_is_refused_in_a_sentence(showing, tmp_path):
    path = saved(showing, tmp_path)
    with zipfile.ZipFile(path) as archive:
        whole = {name: archive.read(name) for name in archive.namelist()}

    def changed(number: int, told: Any = None, without: str = "") -> Path:
        """Another zip, begun alike."""
        before = json.loads(whole[TOLD])
        content = {**whole, TOLD: json.dumps(before | told if isinstance(told, dict) else told)}
        content.pop(without, None)
        with zipfile.ZipFile(tmp_path / f"{number}.zip", "w") as archive:
            for name, each in content.items():
                archive.writestr(name, each)
        return tmp_path / f"{number}.zip"

    row = {"name": "a", "motion": "motion-0.npz", "plan": None}
    rows = (
        [], [row] * 9, [row, row], [{**row, "name": REFERENCE_NAME}],
        *([{**row, "motion": name}] for name in ("../../secret.npz", "motion-0.npz\n")),
    )  # fmt: skip
    tolds: list[Any] = [
        {"format": 2}, {"joint": "../x"}, {"words": [[0.0, float("nan"), "x"]]},
        {"title": "x" * 1000}, {"html": "<script>"}, [1, 2], *({"rows": each} for each in rows),
    ]  # fmt: skip
    wrong: list[dict[str, Any]] = [{"told": told} for told in tolds]
    wrong += [{"told": {}, "without": name} for name in ("motion-1.npz", "speech.wav")]
    for number, changes in enumerate(wrong):
        other = changed(number, **changes)
        assert is_saved_run(other)
        with pytest.raises(RunError, match=r"holds no run that this page can open"):
            open_run(other, tmp_path / f"opened{number}")
    assert open_run(changed(99, {}), tmp_path / "good").told.said == SAID
    plain = tmp_path / "plain.zip"
    with zipfile.ZipFile(plain, "w") as archive:
        archive.writestr("a.npz", b"x")
    assert not is_saved_run(plain) and not is_saved_run(tmp_path / "none.zip")


def test_whoever_has_the_link_can_save_the_run(showing, tmp_path):
    runs = KeptRuns(3600.0)
    diagnostics = numbers(120.0, **{name: 100.0 for name in NAMES[:2]})
    run = ended_run(tmp_path, "ä/b\nc", showing=showing, speech_sha256="", diagnostics=diagnostics)
    kept = keep(runs, tmp_path / "job", "mine", run)
    app = FastAPI(routes=[*run_file_routes(runs), *run_page_routes(runs)])
    client = TestClient(app)
    (address,) = [part.split('"')[0] for part in runs.html("mine", kept).split('href="')[2:3]]
    answer = client.get(f"/{address}")
    assert answer.status_code == 200
    assert "filename*=utf-8''%C3%A4-b-c.run.zip" in answer.headers["content-disposition"]
    path = tmp_path / "fetched.zip"
    path.write_bytes(answer.content)
    assert list(open_run(path, tmp_path / "again").motions) == list(NAMES)
    assert client.get(f"/media/run/{'x' * 43}").status_code == 404

    page = client.get(f"/{address}/page")
    assert "filename*=utf-8''%C3%A4-b-c.run.html" in page.headers["content-disposition"]
    assert page.headers["content-type"] == "application/octet-stream"
    told = json.loads(page.text.split('id="kept">')[1].split("</script>")[0])
    assert [row["name"] for row in told["value"]["rows"]] == list(NAMES)
    assert told["sound"] and f"plan/{NAMES[0]}" in told["files"]
    assert client.get(f"/media/run/{'x' * 43}/page").status_code == 404
    assert file_name("my speech: a, b; seed 0") == "my speech- a, b- seed 0.run.zip"
    assert file_name("../..") == "run.run.zip"


def test_every_import_of_the_modules_is_of_the_form_that_is_read():
    """Else a module would ask for a file that is not there."""
    for path in _needed(DOOR):
        source = re.sub(r"/\*.*?\*/", "", (WEB / path).read_text(), flags=re.DOTALL)
        imports = re.findall(r"^import\b.*?;", source, re.MULTILINE | re.DOTALL)
        assert all(re.search(r'from "\.{1,2}/[^"]+";$', line) for line in imports), path
        other = r'\bimport\(|^export [{*].* from|^import "'
        assert not re.search(other, source, re.MULTILINE), path


def test_no_name_or_word_ends_the_page_and_what_cannot_be_played_is_refused():
    name = "</script><script>alert(1)</script>"
    scene = Scene({name: smooth_motion_example(40)}, {"words": [[0, 1, name]]}, title="</title><b>")
    html = player_alone(scene)
    assert "alert(1)</script>" not in html and "</title><b>" not in html
    told = html.split('id="kept">')[1].split("</script>")[0]
    assert json.loads(told)["value"]["rows"][0]["name"] == name
    with pytest.raises(RunError, match="no motion"):
        player_alone(Scene({}, {}))


def test_the_same_scene_gives_the_same_file():
    speech, motions = Speech(made_waveform(32_000), ""), {"one": smooth_motion_example(60)}
    assert show(motions, speech).html == show(motions, speech).html
