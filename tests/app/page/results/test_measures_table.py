import re
from dataclasses import replace

import pytest

from app.findings.measure_rows import nearest, written
from app.page.results.measures_table import measures_table
from model.diagnostics import Diagnostics
from model.faults.evidence import Finding
from tests.app.fakes import measures
from tests.app.measured import both, diagnostics_of


def diagnostics(**systems: float) -> Diagnostics:
    return diagnostics_of(
        measures(104.0), **{name: measures(jerk) for name, jerk in systems.items()}
    )


def row(table: str, title: str) -> str:
    found = re.search(f'<tr data-measure="{title}".*?</tr>', table)
    assert found is not None
    return found.group()


def test_the_nearest_to_the_reference_is_marked_not_the_lowest() -> None:
    cells = re.findall("<td.*?</td>", row(measures_table(diagnostics(a=30.0, b=110.0)), "Jerk"))
    assert ["near" in cell for cell in cells] == [False, False, True]
    assert "104" in cells[0] and 'class="reference"' in cells[0]


def test_raw_and_filtered_are_both_there() -> None:
    jerk = row(measures_table(diagnostics(a=300.0)), "Jerk")
    assert 'data-raw="300.0" data-savgol="100.0"' in jerk
    assert '<span class="raw">300</span><span class="savgol">100</span>' in jerk


def test_units_of_the_table_are_those_it_says() -> None:
    power = row(measures_table(diagnostics(a=300.0)), "Power above 5 Hz")
    assert 'data-unit="%"' in power and ">1.23<" in power  # a share of 0.0123
    slide = row(measures_table(diagnostics(a=300.0)), "Slide on the ground")
    assert 'data-unit="cm/s"' in slide and '<span class="raw">1</span>' in slide  # 0.01 m/s


def test_few_are_there_at_first_and_all_on_demand_each_explained() -> None:
    table = measures_table(diagnostics(**{"globaldiff/local": 300.0}))
    rows = re.findall("<tr data-measure.*?</tr>", table)
    first = [row for row in rows if 'class="later"' not in row.split(">")[0]]
    assert 0 < len(first) <= 6 < len(rows) and f"Show all {len(rows)} measures" in table
    assert 'title="Mean change of acceleration' in row(table, "Jerk")
    assert '<tr class="group"><th scope="colgroup" colspan="3"><span>Feet<' in table
    assert 'title="globaldiff/local">local</th>' in table


def test_without_a_reference_nothing_is_marked() -> None:
    table = measures_table(replace(diagnostics(a=1.0, b=2.0), reference=None))
    assert 'class="raw near"' not in table and 'class="reference"' not in table


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
    evil = "<script>alert(1)</script>"
    numbers = diagnostics(**{evil: 1.0})
    numbers.findings[evil] = [Finding("x", evil, {})]
    assert "<script" not in measures_table(numbers)


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


@pytest.mark.parametrize(
    ("value", "text"),
    [(None, "n/a"), (0.0, "0"), (152.4, "152"), (1234.5, "1,230"), (0.00623, "0.00623"),
     (-3.214, "-3.21"), (2.5e-7, "2.5e-07")],
)  # fmt: skip
def test_numbers_are_written_short(value: float | None, text: str) -> None:
    assert written(value) == text
