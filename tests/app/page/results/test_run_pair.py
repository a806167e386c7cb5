"""Two runs beside each other: one sentence on settings, one table, one player."""

import base64
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from app import text
from app.page.player.player import NOTHING, Showing, Writers
from app.page.results.kept_runs import EndedRun, KeptRuns, address_of
from app.page.results.run_pair import (
    RunPair,
    jerk_line,
    joined,
    pair_table,
    pairs_of,
    told_settings,
    told_speech,
)
from app.page.results.settings import NONE
from app.page.routes.media import MediaAddresses
from app.run.requests.request import Artefact
from model.motion.motion import save_motion
from tests.app.fakes import made_motion
from tests.app.page.results.made_run import ended_run, keep, numbers

LAYOUT = {"aspect": 1.0, "body": [0, 1]}
Run = Any


@pytest.fixture
def run(tmp_path: Path) -> Run:
    """An ended run of a test's own, whose settings are the usual ones but for those named."""

    def make(settings: dict[str, str] | None = None, **changes: Any) -> EndedRun:
        usual = {"speech": "speech", "systems": "local", "seed": "0", "steps": "usual"}
        return ended_run(tmp_path, settings={**usual, **(settings or {})}, **changes)

    return make


def showing(
    folder: Path, jerk: dict[str, float], duration_s: float = 2.0, words: list | None = None
) -> Showing:
    """Of rows with a motion and a video each, and a time line in which each jerks once."""
    folder.mkdir()

    def write_timeline(paths: Any) -> Path:
        line = {"duration_s": duration_s, "fps": 30, "peaks": [1], "onsets_s": []}
        line |= {"words": words or [], "point": "Right middle fingertip"}
        line["curves"] = {name: {"raw": {}} for name in jerk}
        line["worst"] = [
            {"start_s": 0.5, "end_s": 1.5, "name": name, "jerk_m_s3": value}
            for name, value in jerk.items()
        ]
        path = folder / "timeline.json"
        path.write_text(json.dumps(line))
        return path

    write = Writers(lambda paths: folder / "speech.wav", write_timeline)
    made = Showing(list(jerk), list(jerk), LAYOUT, write, folder, MediaAddresses(), "")
    save_motion(made_motion(8), folder / "a.npz")
    for name in jerk:
        made.take(Artefact("motion", name, folder / "a.npz"))
        made.take(Artefact("video", name, folder / "a.mp4"))
    return made


def test_the_settings_that_differ_are_told_in_one_sentence(run: Run) -> None:
    a, b = run({"seed": "3", "steps": "10"}), run({"seed": "7", "steps": "25"})
    assert told_settings(a, b) == "Seed 3 against 7; steps 10 against 25."
    assert told_settings(a, a) == text.PAIR_SAME_SETTINGS
    own = replace(run(), settings={"motions": "mine", "words": "said.txt"})
    told = f"{text.PAIR_BROUGHT.format(run='B')} Words none against said.txt."
    assert told_settings(run({"words": "none"}), own) == told
    other = run({"speech": "another"})
    assert told_settings(run(), other) == text.PAIR_SAME_SETTINGS  # told apart from the settings


def test_what_the_speech_means_is_said(run: Run) -> None:
    assert told_speech(run(), run({"seed": "1"}), True) == text.PAIR_ONLY_SEED
    assert "play together" in told_speech(run(), run({"steps": "9"}), True)
    told = told_speech(run(), run({"speech": "another"}), False)
    assert "speech against another" in told and "choose whose sound plays" in told


@pytest.mark.parametrize(
    ("a", "b", "pairs"),
    [
        (["x", "y"], ["y", "x"], [("x", "x"), ("y", "y")]),
        (["x"], ["y"], [("x", "y")]),  # the same speech, another system
        (["x", "y"], ["x", "z"], [("x", "x"), ("y", "z")]),
        (["x"], ["y", "z"], [("x", ""), ("", "y"), ("", "z")]),
    ],
)
def test_equal_names_stand_beside_each_other(a: list, b: list, pairs: list) -> None:
    assert pairs_of(a, b) == pairs


def test_the_table_has_both_and_their_difference(run: Run) -> None:
    a = run(diagnostics=numbers(104.0, **{"globaldiff/local": 120.0, "globaldiff/full": 90.0}))
    b = run(diagnostics=numbers(104.0, **{"globaldiff/local": 100.0}))
    table = pair_table(a, b)
    heads = re.findall(r"<th scope=\"col\"[^>]*>([^<]*)</th>", table)
    minus = text.PAIR_DIFFERENCE
    assert heads == ["Measure", "reference", "local (A)", "local (B)", minus, "full (A)"]
    (jerk,) = re.findall('<tr data-measure="Jerk".*?</tr>', table)
    values = re.findall('class="raw[^"]*">([^<]*)<', jerk)
    assert values == ["104", "120", "100", "\N{MINUS SIGN}20", "90"]
    assert 'data-raw="-20.0"' in jerk
    near = ["near" in cell for cell in re.findall("<td.*?</td>", jerk)]
    assert near == [False, False, True, False, False]
    assert "<button" not in jerk  # columns keep their places


def test_references_that_are_not_the_same_stand_apart(run: Run) -> None:
    a, b = (run(diagnostics=numbers(value, x=100.0)) for value in (104.0, 105.0))
    table = pair_table(a, b)
    assert "reference (A)" in table and "reference (B)" in table
    assert 'class="raw near"' not in table


def test_the_jerk_of_both_is_told(run: Run) -> None:
    a = run(diagnostics=numbers(**{"globaldiff/local": 120.0}))
    b = run(diagnostics=numbers(**{"globaldiff/full": 100.0}))
    start = "Right middle fingertip jerk in m/s³:"
    assert jerk_line(a, b) == f"{start} local 120 in A and full 100 in B."
    again = run(diagnostics=numbers(**{"globaldiff/local": 90.0, "gan/5": 80.0}))
    assert jerk_line(a, again) == f"{start} local 120 in A and 90 in B; gan/5 80 in B."


def test_both_are_in_one_player_with_one_time_line(run: Run, tmp_path: Path) -> None:
    a = run(showing=showing(tmp_path / "a", {"f/x": 5.0, "f/y": 9.0}))
    b = run({"seed": "1"}, showing=showing(tmp_path / "b", {"f/x": 7.0}, duration_s=3.0))
    value = joined(a, b)
    assert [row["name"] for row in value["rows"]] == ["f/x (A)", "f/x (B)", "f/y (A)"]
    assert [row["label"] for row in value["rows"]] == ["x (A)", "x (B)", "y (A)"]
    noise = [row["noise"] for row in value["rows"]]
    assert noise[0] == noise[2] != noise[1]  # another seed is other noise
    assert all(row["video"].startswith("media/") for row in value["rows"])
    head, data = value["timeline"].split(",")
    line = json.loads(base64.b64decode(data))
    assert head == "data:application/json;base64" and line["duration_s"] == 3.0
    assert list(line["curves"]) == ["f/x (A)", "f/y (A)", "f/x (B)"]
    assert [each["name"] for each in line["worst"]] == ["f/y (A)"]  # the others overlap it
    assert joined(a, run()) == NOTHING  # nothing was drawn of the other


def line_of(address: str) -> dict[str, Any]:
    return json.loads(base64.b64decode(address.partition(",")[2]))


def test_of_two_speeches_either_can_be_heard_with_its_own_time_line(
    run: Run, tmp_path: Path
) -> None:
    said = [[0.1, 0.4, "hello"]]
    a = run(showing=showing(tmp_path / "a", {"f/x": 5.0}, words=said))
    b = run(
        {"speech": "another"},
        speech_sha256="other",
        showing=showing(tmp_path / "b", {"f/x": 7.0}, duration_s=3.0),
    )
    value = joined(a, b)
    assert [sound["label"] for sound in value["sounds"]] == ["A: speech", "B: another"]
    first, second = value["sounds"]
    assert (value["audio"], value["timeline"]) == (first["audio"], first["timeline"])
    assert first["audio"] != second["audio"]
    lines = [line_of(sound["timeline"]) for sound in value["sounds"]]
    assert [line["duration_s"] for line in lines] == [2.0, 3.0]
    assert [line["words"] for line in lines] == [said, []]  # nobody said it in the other
    assert lines[0]["curves"].keys() == lines[1]["curves"].keys() == {"f/x (A)", "f/x (B)"}


def test_motion_without_speech_moves_under_that_of_the_other_run(run: Run, tmp_path: Path) -> None:
    system = run(showing=showing(tmp_path / "a", {"f/x": 5.0}))
    own = run(
        {"speech": NONE},
        speech_sha256="",
        showing=showing(tmp_path / "b", {"take": 7.0}, duration_s=9.0),
    )
    for first, second in ((system, own), (own, system)):
        value = joined(first, second)
        assert "sounds" not in value
        assert line_of(value["timeline"])["duration_s"] == 2.0
    assert line_of(joined(own, own)["timeline"])["duration_s"] == 9.0  # silence of either will do


def test_the_earlier_is_a_and_only_one_speech_plays_together(run: Run, tmp_path: Path) -> None:
    runs = KeptRuns(3600.0)
    first = keep(runs, tmp_path / "1", "", run())
    second = keep(runs, tmp_path / "2", "", run({"seed": "1"}))
    other = keep(runs, tmp_path / "3", "", run(speech_sha256="other"))
    silent = keep(runs, tmp_path / "4", "", run(speech_sha256=""))
    assert RunPair.of(second, first) == RunPair(first, second)
    assert RunPair(first, second).has_one_speech
    assert not RunPair(first, other).has_one_speech
    assert not RunPair(silent, silent).has_one_speech
    assert address_of(first, second) == f"?run={first.token}&run={second.token}"
