"""What is shown of a run that has ended: numbers, figures, settings, links, and words for them."""

import re
import shutil
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest

from app import text
from app.findings.measure_rows import nearest, written
from app.page.parts import markup
from app.page.parts.markup import WORDS, explained
from app.page.results.kept_runs import KeptRuns
from app.page.results.measures_table import measures_table
from app.page.results.result_parts import FiguresShown
from app.page.results.settings import differing, settings_of_own, settings_of_run
from app.page.routes.media import MediaAddresses
from app.run.diagnose import DiagnoseRequest
from app.run.requests.request import Artefact, GenerateRequest
from model.diagnostics import Diagnostics
from model.faults.evidence import Finding
from tests.app.fakes import measures
from tests.app.measured import both, diagnostics_of
from tests.app.page.results.made_run import ended_run, keep

EVIL = "<script>alert(1)</script>"


def diagnostics(**systems: float) -> Diagnostics:
    return diagnostics_of(
        measures(104.0), **{name: measures(jerk) for name, jerk in systems.items()}
    )


def row(table: str, title: str) -> str:
    (found,) = re.findall(f'<tr data-measure="{title}".*?</tr>', table)
    return found


def test_the_nearest_to_the_reference_is_marked_not_the_lowest() -> None:
    numbers = diagnostics(a=30.0, b=110.0)
    cells = re.findall("<td.*?</td>", row(measures_table(numbers), "Jerk"))
    assert ["near" in cell for cell in cells] == [False, False, True]
    assert "104" in cells[0] and 'class="reference"' in cells[0]
    table = measures_table(replace(numbers, reference=None))
    assert 'class="raw near"' not in table and 'class="reference"' not in table


def test_numbers_are_there_raw_and_filtered_in_the_units_that_it_says() -> None:
    table = measures_table(diagnostics(a=300.0))
    jerk = row(table, "Jerk")
    assert 'data-raw="300.0" data-savgol="100.0"' in jerk
    assert '<span class="raw">300</span><span class="savgol">100</span>' in jerk
    power = row(table, "Power above 5 Hz")
    assert 'data-unit="%"' in power and ">1.23<" in power  # a share of 0.0123
    slide = row(table, "Slide on the ground")
    assert 'data-unit="cm/s"' in slide and '<span class="raw">1</span>' in slide  # 0.01 m/s


def test_few_are_there_at_first_and_all_on_demand_each_explained() -> None:
    table = measures_table(diagnostics(**{"globaldiff/local": 300.0}))
    rows = re.findall("<tr data-measure.*?</tr>", table)
    first = [row for row in rows if 'class="later"' not in row.split(">")[0]]
    assert 0 < len(first) <= 6 < len(rows) and f"Show all {len(rows)} measures" in table
    assert 'title="Mean change of acceleration' in row(table, "Jerk")
    assert '<tr class="group"><th scope="colgroup" colspan="3"><span>Feet<' in table
    assert 'title="globaldiff/local">local</th>' in table


def test_what_no_motion_has_takes_no_row_and_what_one_lacks_is_said() -> None:
    numbers = diagnostics(a=1.0, b=2.0)
    numbers.systems["a"] = both(tip_jerk_m_s3=1.0)
    table = measures_table(numbers)
    assert "SPARC" not in table
    assert '<span class="raw">n/a</span>' in row(table, "Peak jerk at joins")


def test_the_gravest_three_stand_apart_and_lead_to_where_they_are_worst() -> None:
    numbers = diagnostics(a=1.0)
    grave = Finding("g", "Grave.", {}, gravity=3, worst_frame=45)
    slight = [Finding("s", f"Slight {n}.", {}, gravity=1, excess=9.0 - n) for n in range(3)]
    numbers.findings["a"] = [*slight, grave]
    table = measures_table(numbers)
    places = [table.index(words) for words in ("Grave.", "Slight 1.", "Also found", "Slight 2.")]
    assert places == sorted(places)
    assert 'data-at="1.500">Show 0:01.5<' in table and table.count("data-at") == 1


def test_names_and_findings_cannot_bring_markup() -> None:
    numbers = diagnostics(**{EVIL: 1.0})
    numbers.findings[EVIL] = [Finding("x", EVIL, {})]
    for piece in (
        measures_table(numbers),
        markup.header(EVIL),
        markup.status(EVIL, {"motion": 0.5}, {"motion": EVIL}),
        markup.error_message(EVIL),
        markup.notes_message([EVIL]),
    ):
        assert "<script" not in piece and "&lt;script" in piece
    assert markup.notes_message([]) == ""


@pytest.mark.parametrize(
    ("values", "target", "names"),
    [
        ({"a": 1.0, "b": 5.0}, 4.0, ("b",)),
        ({"a": 3.0, "b": 5.0, "c": 9.0}, 4.0, ("a", "b")),
        ({"a": 3.0, "b": 5.0}, 4.0, ()),  # neither is nearer
        ({"a": 3.0, "b": None}, 4.0, ()),
        ({"a": 1.0, "b": 5.0}, None, ()),
    ],
)
def test_nearest(values: dict, target: float | None, names: tuple) -> None:
    assert nearest(values, target) == names


def test_numbers_are_written_short() -> None:
    values = (None, 0.0, 152.4, 1234.5, 0.00623, -3.214, 2.5e-7)
    texts = ["n/a", "0", "152", "1,230", "0.00623", "-3.21", "2.5e-07"]
    assert list(map(written, values)) == texts


def test_stages_are_done_doing_or_still_to_do() -> None:
    html = markup.status("line", {"speech": 1.0, "motion": 0.4}, {"motion": "globaldiff/local"})
    assert [html.count(f'class="{how}"') for how in ("done", "doing", "todo")] == [1, 1, 4]
    assert "40 %" in html and "globaldiff/local" in html


def figures(tmp_path: Path, *files: str) -> FiguresShown:
    shown = FiguresShown(MediaAddresses(), "")
    for file in files:
        path = tmp_path / file
        path.touch()
        kind = "diagnostics" if path.stem == "diagnostics" else "figure"
        shown.take(Artefact(kind, path.stem, path))
    return shown


def test_a_figure_is_shown_once_its_picture_is_there_with_all_its_files(tmp_path: Path) -> None:
    assert figures(tmp_path, "figure6.svg", "diagnostics.png").html() == ""
    html = figures(tmp_path, "figure6.svg", "figure6.png", "jitter.png").html()
    assert html.count("<img") == 2
    assert html.count("download=") == 3 and 'download="figure6.svg"' in html
    assert html.index(text.FIGURES["figure6"].title) < html.index(text.FIGURES["jitter"].title)


def test_sentences_come_with_the_numbers_and_are_theirs(tmp_path: Path) -> None:
    shown = figures(tmp_path, "figure6.png")
    assert "figcaption><p class" in shown.html()
    for local, other, words in ((300.0, 100.0, "local has 3"), (100.0, 300.0, "global has 3")):
        systems = {"local": measures(local), "global": measures(other)}
        assert f"{words}.0 times" in shown.html(diagnostics_of(**systems))


class Read(HTMLParser):
    """The text of HTML, and its titles."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.text, self.titles = "", []
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert tag == "abbr"
        self.titles += [value for name, value in attrs if name == "title"]

    def handle_data(self, data: str) -> None:
        self.text += data


def test_a_word_is_explained_where_it_stands_first() -> None:
    read = Read(explained("Jerk by depth: jerk and jerky <b>."))
    assert read.text == "Jerk by depth: jerk and jerky <b>."
    assert read.titles == [WORDS["jerk"], WORDS["depth"]]
    assert explained("jerk") == f'<abbr title="{WORDS["jerk"]}">jerk</abbr>'
    assert Read(explained("A seam beside other seams.")).titles == [WORDS["seam"]]
    for figure in text.FIGURES.values():
        assert Read(explained(figure.help)).text == figure.help


def test_a_run_is_found_by_its_token_until_its_files_are_gone(tmp_path: Path) -> None:
    runs = KeptRuns(3600.0)
    first, second = (keep(runs, tmp_path / name, "mine") for name in "ab")
    assert first.token != second.token and len(first.token) >= 43  # 256 bits
    assert runs.find(first.token) == first
    assert runs.find("") is None and runs.find(first.token[:-1]) is None
    shutil.rmtree(first.job.folder)
    assert runs.find(first.token) is None
    assert runs.of("mine") == [second]


def test_a_browser_is_told_of_its_own_runs_alone(tmp_path: Path) -> None:
    runs = KeptRuns(3600.0)
    mine, yours, nobodys = (
        keep(runs, tmp_path / name, cookie, ended_run(tmp_path, "a < b"))
        for name, cookie in (("a", "mine"), ("b", "yours"), ("c", ""))
    )
    assert runs.of("mine") == [mine] and runs.of("") == []
    told = runs.html("mine", mine)
    assert mine.token in told and "a &lt; b" in told and "60 minutes" in told
    assert yours.token not in told and nobodys.token not in told
    assert nobodys.token in runs.html("", nobodys)  # its own link, and no list
    assert runs.html("of a stranger") == ""


def asked(**changes) -> GenerateRequest:
    values = {"systems": ("globaldiff/local", "gan/5"), **changes}
    return GenerateRequest(Path("/up/talk.wav"), Path("out"), Path("weights"), **values)


def test_what_a_run_was_asked_for_is_told_in_words_and_what_differs_is_found() -> None:
    by_name = {"globaldiff/local": 10}
    told = settings_of_run(asked(seed=3, steps=by_name, sampler="heun", guidance=1.5))
    assert told["strength of the speech"] == "1.5"
    assert (told["speech"], told["systems"], told["seed"]) == ("talk", "local, gan/5", "3")
    assert (told["steps"], told["filter"]) == ("local 10", "none")
    assert told["sampler"].startswith("Heun")
    assert told["followed point"] == "right middle fingertip"
    assert told["words"] == "none"
    assert settings_of_run(asked(words="recognise"))["words"] == "recognised"
    given = asked(words="recognise", transcript=Path("/up/said.txt"))
    assert settings_of_run(given)["words"] == "said.txt"
    first, second = settings_of_run(asked(seed=3)), settings_of_run(asked(seed=7, steps=25))
    assert differing(first, second) == {"seed": ("3", "7"), "steps": ("usual", "25")}
    own = settings_of_own(DiagnoseRequest((Path("a.npz"),), Path("out"), names=("a",)))
    assert differing(first, own)["seed"] == ("3", "none") and "speech" not in differing(first, own)
