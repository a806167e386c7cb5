"""A run as a zip and as a page of its own: who gets it, what it holds."""

import json
import re
from pathlib import Path

import pytest
from fastapi import FastAPI
from starlette.testclient import TestClient

from app.errors import RunError
from app.notebook import show
from app.page.html_export import ENTRY_MODULE, WEB, _needed, standalone_html, write_standalone_html
from app.page.results.saved_runs import SavedRuns, download_route, file_name
from app.page.routes.media import OnDemandFiles
from app.run.output.provenance import PROVENANCE, WEIGHTS_ARE_KEY
from app.run.output.run_folder import is_run_zip, locked_record, zip_run_task
from model.speech.audio import Speech
from model.speech.transcript import Transcript, Word
from tests.app.fakes import does
from tests.app.page.results.made_run import keep, made_run
from tests.helpers import smooth_motion_example
from tests.model.made import made_waveform


def test_whoever_has_the_link_can_save_the_run(tmp_path):
    runs = SavedRuns(3600.0)
    kept = keep(runs, tmp_path / "job", "mine", title="ä/b\nc", jerk={"f/x": 9.0})
    made = OnDemandFiles(tmp_path, does)
    forms = ((".zip", zip_run_task, ""), (".html", write_standalone_html, "/page"))
    client = TestClient(FastAPI(routes=[download_route(runs, made, *form) for form in forms]))
    with locked_record(kept.view.folder) as record:
        record.rows[0].files["input_plan"] = "f-x.plan.json"
    address = f"media/run/{kept.token}"
    assert f'href="{address}/page"' in kept.downloads_html(kept.view)
    answer = client.get(f"/{address}")
    assert answer.status_code == 200
    assert "filename*=utf-8''%C3%A4-b-c.zip" in answer.headers["content-disposition"]
    path = tmp_path / "fetched.zip"
    path.write_bytes(answer.content)
    assert is_run_zip(path)
    page = client.get(f"/{address}/page")
    assert "filename*=utf-8''%C3%A4-b-c.html" in page.headers["content-disposition"]
    assert page.headers["content-type"] == "application/octet-stream"
    told = json.loads(page.text.split('id="bundle">')[1].split("</script>")[0])
    (run,) = told["runs"]
    (row,) = run["rows"]
    assert row["name"] == "f/x"
    assert {row["frames"], "timeline.json", run["audio"]} <= told["files"].keys()
    assert not run["running"] and "video" not in row
    assert row["is_planned"], "whose gestures are shown at once, as on the page"
    for ending in ("", "/page"):
        assert client.get(f"/media/run/{'x' * 43}{ending}").status_code == 404
    assert file_name("my speech: a, b; seed 0") == "my speech- a, b- seed 0.zip"
    assert file_name("../..") == "run.zip"


def test_every_import_of_the_modules_is_of_the_form_that_is_read():
    """Else a module would ask for a file that is not there."""
    for path in _needed(ENTRY_MODULE):
        source = re.sub(r"/\*.*?\*/", "", (WEB / path).read_text(), flags=re.DOTALL)
        imports = re.findall(r"^import\b.*?;", source, re.MULTILINE | re.DOTALL)
        assert all(re.search(r'from "\.{1,2}/[^"]+";$', line) for line in imports), path
        other = r'\bimport\(|^export [{*].* from|^import "'
        assert not re.search(other, source, re.MULTILINE), path


def test_no_name_or_word_ends_the_page_and_what_cannot_be_played_is_refused(tmp_path):
    name = "<script>alert(1)<script>"
    said = Transcript((Word(0.0, 1.0, "</script><script>alert(1)</script>"),))
    folder = made_run(tmp_path / "1", "</title><b>", jerk={name: 1.0}, said=said).folder
    html = standalone_html(folder)
    assert "alert(1)<script>" not in html and "</title><b>" not in html
    told = html.split('id="bundle">')[1].split("</script>")[0]
    assert json.loads(told)["runs"][0]["rows"][0]["name"] == name
    with pytest.raises(RunError, match="not a run folder that can be opened"):
        standalone_html(tmp_path)


def test_the_same_motion_gives_the_same_file_and_a_folder_is_shown_as_it_is(tmp_path: Path):
    speech, motions = Speech(made_waveform(32_000), ""), {"one": smooth_motion_example(60)}
    assert show(motions, speech).html == show(motions, speech).html
    folder = made_run(tmp_path / "job", "made elsewhere", jerk={"x/a": 9.0, "x/b": 99.0}).folder
    (folder / PROVENANCE).write_text(json.dumps({WEIGHTS_ARE_KEY: "the authors' own & new"}))
    html = show(folder).html
    assert html == standalone_html(folder)
    head = html.split("<header>")[1].split("</header>")[0]
    assert "<h1>made elsewhere</h1>" in head and "<i></i><b>9.0</b>" in head and "<b>99</b>" in head
    assert "an example" in head and "Weights: the authors&#x27; own &amp; new." in head


def test_a_folder_of_several_clips_is_one_page_with_a_row_for_each(tmp_path: Path):
    for number, clip in enumerate("ab"):
        made_run(tmp_path, jerk={"f/x": 10.0 + 2 * number, "f/y": 20.0}, out=clip)
    html = show(tmp_path).html
    assert (
        html.count("<option>") == 2
        and "<h1>2 clips: " in html
        and "Mean [95 % confidence interval over clips]" in html
    )
    assert "mean over clips with 95 % confidence interval" in html
    dots = '--share:0.550;--low:0.500;--high:0.600"><span>x</span><i></i><b>11</b>'
    assert dots in html and '<th scope="row">b</th><td>12' in html
    told = json.loads(html.split('id="bundle">')[1].split("</script>")[0])
    assert [run["audio"] for run in told["runs"]] == ["a/speech.wav", "b/speech.wav"]
    assert {row["frames"] for run in told["runs"] for row in run["rows"]} <= told["files"].keys()
