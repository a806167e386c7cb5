"""What is shown of runs that have ended: numbers, figures, settings, links; two of them in one."""

import base64
import itertools
import json
import re
import shutil
from collections.abc import Mapping
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import Any

import pytest

from app import text
from app.findings.metric_table import (
    FGD,
    JERK,
    METRICS,
    POWER_ABOVE_5_HZ,
    SEAMS,
    format_three_digits,
    nearest_names,
)
from app.page.parts import markup
from app.page.parts.markup import WORDS, add_tooltips
from app.page.results.result_parts import NO_SENTENCES, figures_html
from app.page.results.run_comparison import RunPair, match_motions, settings_sentence
from app.page.results.run_view import RunView
from app.page.results.saved_runs import SavedRuns, url_of_runs
from app.page.results.tables import jerk_by_clip_html, run_metrics_table, sets_html
from app.run.output.provenance import NONE, differing_settings, settings_summary
from app.run.output.run_folder import RunRecord
from app.run.requests.requests import AnyRun
from app.run.run_writer import open_run_writer
from model.diagnostics import Diagnostics
from model.faults.analysis import Finding
from model.metrics.protocols.table import PROTOCOLS
from model.speech.transcript import Transcript, Word
from tests.app.measured import both
from tests.app.page.results.made_run import keep, made_run, numbers
from tests.app.requests import diagnose_request, generate_request

OTHER = "cd" * 32
EVIL = "<script>alert(1)</script>"


def table(diagnostics: Diagnostics, tmp_path: Path) -> str:
    """As the page shows what the worker has measured."""
    record = RunRecord(kind="imported", tracked_point="right_middle")
    with open_run_writer(tmp_path / "results", record) as run:
        run.record_metrics(diagnostics)
        return run_metrics_table(run.record)


def row(table: str, key: str) -> str:
    (found,) = re.findall(f'<tr data-measure="{key}".*?</tr>', table)
    return found


def test_the_nearest_to_the_reference_is_marked_not_the_lowest(tmp_path):
    measured = numbers(104.0, a=30.0, b=110.0)
    cells = re.findall("<td.*?</td>", row(table(measured, tmp_path), JERK))
    assert ["near" in cell for cell in cells] == [False, False, True]
    assert "104" in cells[0] and 'class="reference"' in cells[0]
    measured.systems["a"] = both(tip_jerk_m_s3=1.0)
    alone = table(replace(measured, reference=None), tmp_path)
    assert 'class="raw near"' not in alone and 'class="reference"' not in alone
    assert "SPARC" not in alone, "what no motion has takes no row"
    assert '<span class="raw">n/a</span>' in row(alone, SEAMS)
    for values, target, names in (
        ({"a": 1.0, "b": 5.0}, 4.0, ("b",)),
        ({"a": 3.0, "b": 5.0, "c": 9.0}, 4.0, ("a", "b")),
        ({"a": 3.0, "b": 5.0}, 4.0, ()),  # neither is nearer
        ({"a": 3.0, "b": None}, 4.0, ()),
        ({"a": 1.0, "b": 5.0}, None, ()),
    ):
        assert nearest_names(values, target) == names
    short = {None: "n/a", 0.0: "0", 152.4: "152", 1234.5: "1,230", 0.00623: "0.00623"}
    assert {value: format_three_digits(value) for value in short} == short
    assert (format_three_digits(-3.214), format_three_digits(2.5e-7)) == ("-3.21", "2.5e-07")


def test_numbers_are_there_raw_and_filtered_in_the_units_that_it_says(tmp_path):
    whole = table(numbers(104.0, a=300.0), tmp_path)
    jerk = row(whole, JERK)
    assert '<span class="raw">300</span><span class="savgol">100</span>' in jerk
    power = row(whole, POWER_ABOVE_5_HZ)
    assert "<small>%</small>" in power and ">1.23<" in power  # a share of 0.0123
    rows = re.findall("<tr data-measure.*?</tr>", whole)
    first = [row for row in rows if 'class="later"' not in row.split(">")[0]]
    assert 0 < len(first) <= 6 < len(rows) and f"Show all {len(rows)} metrics" in whole
    for group in whole.split('<tr class="group')[1:]:  # a head goes where all that it heads goes
        later = ['class="later"' in row for row in re.findall("<tr data-measure.*?>", group)]
        assert group.startswith(" later") == all(later)
    slide = row(whole, "foot_sliding_cm_s")
    assert "<small>cm/s</small>" in slide and '<span class="raw">1</span>' in slide  # 0.01 m/s


def test_the_numbers_tell_only_findings_that_do_not_stand_beside_the_viewer(tmp_path):
    measured = numbers(104.0, a=1.0)
    grave = Finding("Grave.", {}, severity=3, worst_frame=45)
    slight = [Finding(f"Slight {n}.", {}, severity=1, limit_ratio=9.0 - n) for n in range(3)]
    measured.findings["a"] = [*slight, grave]
    whole = table(measured, tmp_path)
    assert "More findings (1)" in whole and "Slight 2." in whole
    assert "Grave." not in whole and "Slight 1." not in whole, "they stand beside the viewer"


def test_names_and_findings_cannot_bring_markup(tmp_path):
    measured = numbers(104.0, **{EVIL: 1.0})
    measured.findings[EVIL] = [Finding(EVIL, {})]
    for piece in (
        table(measured, tmp_path),
        markup.header(EVIL),
        markup.run_status(EVIL, {"motion": 0.5}, {"motion": EVIL}),
        markup.error_message(EVIL),
        markup.note(EVIL),
    ):
        assert "<script" not in piece and "&lt;script" in piece
    html = markup.run_status("line", {"speech": 1.0, "motion": 0.4}, {"motion": "globaldiff/local"})
    assert [html.count(f'class="{how}"') for how in ("done", "doing", "todo")] == [1, 1, 4]
    assert "40 %" in html and "globaldiff/local" in html
    for words in ("Jerk by depth: jerk and jerky <b>.", text.FIGURES["figure6"].help):
        told = add_tooltips(words)  # where a word stands first, and once
        assert re.sub("<[^>]*>", "", told) == escape(words)
        assert told.count(f'title="{escape(WORDS["jerk"])}"') <= 1
    assert add_tooltips("jerk") == f'<abbr title="{WORDS["jerk"]}" tabindex="0">jerk</abbr>'


def test_a_figure_is_shown_once_its_picture_is_there_with_all_its_files(tmp_path):
    def html(*files: str, said: Mapping[str, str] = NO_SENTENCES) -> str:
        return figures_html((tmp_path / name for name in files), lambda path: path.name, said)

    assert html("figure6.svg", "diagnostics.json") == ""
    told = html("figure6.svg", "figure6.png", "jitter.png")
    assert text.CAPTION not in told
    (tmp_path / "figure6.txt").write_text("Of <one> clip.")
    assert "<p>Of &lt;one&gt; clip.</p>" in html("figure6.png", "figure6.txt"), "to copy"
    assert told.count("<img") == 2
    assert told.count("download=") == 3 and 'download="figure6.svg"' in told
    later = html("figure6.png", "figure6.figure.npz")  # drawn when they are asked for
    for form in ("svg", "pdf"):
        link = f'<a href="figure6.figure.npz&amp;as={form}" download="figure6.{form}">'
        assert link in later
    assert later.count("download=") == 3
    assert told.index(text.FIGURES["figure6"].title) < told.index(text.FIGURES["jitter"].title)
    assert "local has &lt;3" in html("figure6.png", said={"trajectory": "local has <3"})


def test_a_run_is_found_by_its_token_until_its_files_are_gone(tmp_path):
    runs = SavedRuns(3600.0)
    first, second = (keep(runs, tmp_path / name, "mine") for name in "ab")
    assert first.token != second.token and len(first.token) >= 43  # 256 bits
    assert runs.find(first.token) == first
    assert runs.find("") is None and runs.find(first.token[:-1]) is None
    shutil.rmtree(first.job.folder)
    assert runs.find(first.token) is None
    assert runs.runs_of("mine") == [second]


def test_a_browser_is_told_of_its_own_runs_alone(tmp_path):
    runs = SavedRuns(3600.0)
    mine, yours, nobodys = (
        keep(runs, tmp_path / name, cookie, title="a < b")
        for name, cookie in (("a", "mine"), ("b", "yours"), ("c", ""))
    )
    assert runs.runs_of("mine") == [mine] and runs.runs_of("") == []
    told = runs.links_html("mine", mine)
    assert mine.token in told and "a &lt; b" in told and "60 minutes" in told
    assert yours.token not in told and nobodys.token not in told
    assert nobodys.token in runs.links_html("", nobodys)  # its own link, and no list
    assert runs.links_html("of a stranger") == ""


def asked(**changes) -> AnyRun:
    values = {"systems": ("globaldiff/local", "gan/5"), **changes}
    return generate_request(speech=Path("/up/talk.wav"), out=Path("out"), **values)


def test_what_a_run_was_asked_for_is_told_in_words_and_what_differs_is_found():
    by_name = {"globaldiff/local": 10}
    told = settings_summary(asked(seed=3, steps=by_name, sampler="heun", guidance=1.5))
    assert told["speech guidance scale"] == "1.5"
    assert (told["speech"], told["systems"], told["seed"]) == ("talk", "local, gan/5", "3")
    assert (told["steps"], told["filter"]) == ("local 10", "none")
    assert told["sampler"].startswith("Heun")
    assert told["tracked point"] == "right middle fingertip"
    assert told["words"] == "none"
    assert settings_summary(asked(word_source="recognise"))["words"] == "recognised"
    given = asked(word_source="recognise", transcript=Path("/up/said.txt"))
    assert settings_summary(given)["words"] == "said.txt"
    first, second = settings_summary(asked(seed=3)), settings_summary(asked(seed=7, steps=25))
    assert differing_settings(first, second) == {"seed": ("3", "7"), "steps": ("default", "25")}
    own = settings_summary(
        diagnose_request(motions=(Path("a.npz"),), out=Path("out"), names=("a",))
    )
    assert differing_settings(first, own)["seed"] == (
        "3",
        "none",
    ) and "speech" not in differing_settings(first, own)


STEPS = {"seed": "7", "steps": "25"}
Run = Any


@pytest.fixture
def run(tmp_path: Path) -> Run:
    """An ended run of a test's own, whose settings are the usual ones but for those named."""
    count = itertools.count()

    def make(settings: dict[str, str] | None = None, **changes: Any) -> RunView:
        return made_run(tmp_path / str(next(count)), settings=settings, **changes)

    return make


def test_the_settings_that_differ_are_told_in_one_sentence(run):
    a, b = (run(each).record for each in ({"seed": "3", "steps": "10"}, STEPS))
    assert settings_sentence(a, b) == (
        "Different settings: seed (3 in A, 7 in B); steps (10 in A, 25 in B)."
    )
    assert settings_sentence(a, a) == text.PAIR_SAME_SETTINGS
    own = a.model_copy(update={"settings": {"motions": "mine", "words": "said.txt"}})
    told = "Different settings: words (none in A, said.txt in B)."
    told = f"{text.PAIR_BROUGHT.format(run='B')} {told}"
    assert settings_sentence(run({"words": "none"}).record, own) == told
    usual, other = run(), run({"speech": "another"}, speech_sha256=OTHER)
    told = settings_sentence(usual.record, other.record)
    assert told == text.PAIR_SAME_SETTINGS  # told apart from the settings
    assert RunPair(usual, run({"seed": "1"})).speech_sentence() == text.PAIR_ONLY_SEED
    assert "play in sync" in RunPair(usual, run({"steps": "9"})).speech_sentence()
    told = RunPair(usual, other).speech_sentence()
    assert "(speech and another)" in told and "Choose which audio plays" in told


@pytest.mark.parametrize(
    ("a", "b", "pairs"),
    [
        (["x", "y"], ["y", "x"], [("x", "x"), ("y", "y")]),
        (["x"], ["y"], [("x", "y")]),  # the same speech, another system
        (["x", "y"], ["x", "z"], [("x", "x"), ("y", "z")]),
        (["x"], ["y", "z"], [("x", ""), ("", "y"), ("", "z")]),
    ],
)
def test_equal_names_stand_beside_each_other(a, b, pairs):
    assert match_motions(a, b) == pairs


def test_the_table_has_both_and_their_difference(run):
    jerk = {"globaldiff/local": 120.0, "globaldiff/full": 90.0}
    a, b = (run(reference=104.0, jerk=each) for each in (jerk, {"globaldiff/local": 100.0}))
    table = RunPair(a, b).metrics_table()
    heads = re.findall(r"<th scope=\"col\"[^>]*>([^<]*)</th>", table)
    minus = text.PAIR_DIFFERENCE
    assert heads == ["Metric", "reference", "local (A)", "local (B)", minus, "full (A)"]
    (jerk,) = re.findall(f'<tr data-measure="{JERK}".*?</tr>', table)
    values = re.findall('class="raw[^"]*">([^<]*)<', jerk)
    assert values == ["104", "120", "100", "\N{MINUS SIGN}20", "90"]
    assert "raw%2C-20.0%2Cworkbench/1%0D" in table, "saved as it is shown"
    rules = table[table.index('<details class="rules">') :]
    assert rules.count("<dt>") == len(re.findall("<tr data-measure", table))
    assert "Jerk</dt>" in rules and "<code>workbench/1</code>" in rules
    near = ["near" in cell for cell in re.findall("<td.*?</td>", jerk)]
    assert near == [False, False, True, False, False]
    assert "<button" not in jerk  # columns keep their places
    full = run(reference=105.0, jerk={"globaldiff/full": 100.0})
    table = RunPair(b, full).metrics_table()
    assert "reference (A)" in table and "reference (B)" in table, "they are not the same"
    assert 'class="raw near"' not in table


def test_numbers_of_different_protocols_are_never_in_one_row(run):
    """BeatAlign of a run with a reference and of one without have different mean speeds."""
    a, b = run(reference=104.0, jerk={"a": 120.0, "b": 90.0}), run(jerk={"a": 100.0})
    for run_view in (a, b):
        for name, of in run_view.record.metrics.items():
            for version in of.values():
                version |= {"beat_align": 0.6 if name == "a" else 0.5, "beat_align_chance": 0.4}
    pair = RunPair(a, b).metrics_table()
    rows = re.findall('<tr data-measure="beat_align".*?</tr>', pair)
    assert ["BeatAlign · beats/workbench<" in each for each in rows] == [True, False]
    values = [re.findall('class="raw[^"]*">([^<]*)<', each) for each in rows]
    assert values == [["0.5", "0.6", "n/a", "n/a", "0.5"], ["n/a", "n/a", "0.6", "n/a", "n/a"]]
    assert "beats/workbench%0D" in pair and "beats/workbench-own%0D" in pair
    record = b.record.model_copy(update={"request": {"metrics": {"mean_speeds": "speeds.npy"}}})
    assert "<code>beats/workbench-emage</code>" in run_metrics_table(record)
    hostile = b.record.model_copy(update={"request": {"metrics": ["mean_speeds"]}})
    assert "<code>beats/workbench-own</code>" in run_metrics_table(hostile)


def test_sets_and_clips_have_the_rule_of_each_metric_one_click_away(run):
    rows = [
        {"measure": key, "unit": "", "system": "a", "clips": 2, "difference_to": "",
         "mean": 1.0, "low": 1.0, "high": 1.0, "protocol": protocol}
        for key, protocol in (
            (JERK, "workbench/1"), ("gac/unicamp/dice", "gac/unicamp"), (FGD, "fgd/workbench"),
            ("beat_align_chance", "beats/workbench"),
        )
    ]  # fmt: skip
    told = {"clips": ["1", "2"], "worst": [], "measures": rows}
    shown = sets_html(told, ["a"], "", "")
    about = {row.key: row.description for row in METRICS}
    chance = f"{about['beat_align_chance']} {PROTOCOLS['beats/workbench'].rule}"
    fgd, gac = PROTOCOLS["fgd/workbench"].rule, PROTOCOLS["gac/unicamp"].rule
    for sentences in (about[JERK], gac, fgd, chance):
        assert f"<dd>{escape(sentences)} <code>" in shown
    clips = jerk_by_clip_html({"1": run().record, "2": run().record})
    assert "<code>workbench/1</code>" in clips.split('<details class="rules">')[1]
    assert all(row.description.count(". ") <= 1 for row in METRICS)


def test_both_are_in_one_player_with_one_time_line(run):
    a = run(jerk={"f/x": 5.0, "f/y": 9.0})
    b = run({"seed": "1"}, jerk={"f/x": 7.0}, duration_s=3.0)
    value = RunPair(a, b).player_value()
    assert [row["name"] for row in value["rows"]] == ["f/x (A)", "f/x (B)", "f/y (A)"]
    assert [row["label"] for row in value["rows"]] == ["x (A)", "x (B)", "y (A)"]
    noise = [row["noise_key"] for row in value["rows"]]
    assert noise[0] == noise[2] != noise[1]  # another seed is other noise
    assert all(row["video"].startswith("media/") for row in value["rows"])
    head, data = value["timeline"].split(",")
    line = json.loads(base64.b64decode(data))
    assert head == "data:application/json;base64" and line["duration_s"] == 3.0
    assert list(line["curves"]) == ["f/x (A)", "f/y (A)", "f/x (B)"]
    assert [each["name"] for each in line["worst"]] == ["f/y (A)"]  # the others overlap it
    own = run({"speech": NONE}, speech_sha256="", jerk={"take": 7.0}, duration_s=9.0)
    for first, second in ((a, own), (own, a)):  # what has no speech moves under the other's
        value = RunPair(first, second).player_value()
        assert "sounds" not in value and line_of(value["timeline"])["duration_s"] == 2.0
    assert (
        line_of(RunPair(own, own).player_value()["timeline"])["duration_s"] == 9.0
    )  # silence of either will do


def line_of(address: str) -> dict[str, Any]:
    return json.loads(base64.b64decode(address.partition(",")[2]))


def test_of_two_speeches_either_can_be_heard_with_its_own_time_line(run):
    said = [[0.1, 0.4, "hello"]]
    a = run(jerk={"f/x": 5.0}, said=Transcript((Word(0.1, 0.4, "hello"),)))
    b = run({"speech": "another"}, speech_sha256=OTHER, jerk={"f/x": 7.0}, duration_s=3.0)
    value = RunPair(a, b).player_value()
    assert [sound["label"] for sound in value["sounds"]] == ["A: speech", "B: another"]
    first, second = value["sounds"]
    assert (value["audio"], value["timeline"]) == (first["audio_url"], first["timeline_url"])
    assert first["audio_url"] != second["audio_url"]
    lines = [line_of(sound["timeline_url"]) for sound in value["sounds"]]
    assert [line["duration_s"] for line in lines] == [2.0, 3.0]
    assert [line["words"] for line in lines] == [said, []]  # nobody said it in the other
    assert lines[0]["curves"].keys() == lines[1]["curves"].keys() == {"f/x (A)", "f/x (B)"}


def test_only_one_speech_plays_together(run, tmp_path):
    first, second, other, silent = (
        run(speech_sha256=each) for each in ("ab" * 32, "ab" * 32, OTHER, "")
    )
    assert RunPair(first, second).has_same_speech
    assert not RunPair(first, other).has_same_speech
    assert not RunPair(silent, silent).has_same_speech
    runs = SavedRuns(3600.0)
    a, b = (keep(runs, tmp_path / name, "") for name in ("kept", "other"))
    assert url_of_runs(a, b) == f"?run={a.token}&run={b.token}"
