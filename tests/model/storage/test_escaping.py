"""Names that spreadsheets, LaTeX, Markdown and terminals would obey."""

import csv
import io

import pytest

from conventions.names import printable
from model.storage.escaping import csv_text, escape_csv_cell, escape_latex, escape_markdown

FORMULAS = [
    *("=cmd|' /C calc'!A0", "+1+cmd|' /C calc'!A0", "-2+3+cmd|' /C calc'!A0", "\t=1+1", "\r=1+1"),
    *("@SUM(1+9)*cmd|' /C calc'!A0", "\n=1+1", "  =1+1", "\uff1d1+1", "-1.5e", "-1.5=2"),
    *("name;=1+1", "name; @SUM(1)"),
]


@pytest.mark.parametrize("name", FORMULAS)
def test_no_cell_begins_a_formula(name):
    cell = str(escape_csv_cell(name))
    for part in cell.split(";"):  # where a spreadsheet cuts the line at semicolons
        assert part.strip()[0] not in "=+-@\t\r\n\uff1d\uff0b\uff0d\uff20"
    assert cell.isprintable()


def test_numbers_and_harmless_names_stay_as_they_are():
    for value in (-1.5, 0, None, "-1.5", "+2", "-1e-05", "-inf", ".5", "-0.25e+3"):
        assert escape_csv_cell(value) is value
    for name in ("globaldiff/full", "a-b=c", "mean, low", "50 %", "ä\u00df", ""):
        assert escape_csv_cell(name) == name


def test_a_table_is_read_back_as_it_was_but_for_what_would_be_obeyed():
    text = csv_text([["name", "value"], ['say "=1", or', -1.5], ["=1\x1b[2J", None]])
    assert list(csv.reader(io.StringIO(text))) == [
        ["name", "value"],
        ['say "=1", or', "-1.5"],
        ["'=1?[2J", ""],
    ]


HOSTILE = '\\input{/etc/passwd} % & $x$ #1 _a ^b ~ <>|" [3in] *\x1b[31m\u202e\n'


def test_every_special_character_of_latex_is_escaped():
    found = escape_latex(HOSTILE)
    assert found == (
        r"\textbackslash{}input\{/etc/passwd\} \% \& \$x\$ \#1 \_a \textasciicircum{}b"
        r" \textasciitilde{} \textless{}\textgreater{}\textbar{}'' {[}3in{]} {*}?{[}31m??"
    )


def test_markdown_gets_one_cell_without_markup():
    assert escape_markdown("a|b\n<script>[x](y)`c`*d*\\") == (
        r"a\|b?\<script\>\[x\](y)\`c\`\*d\*" "\\\\"
    )


def test_what_a_terminal_obeys_and_what_turns_text_is_replaced():
    assert printable("a\x1b]0;title\x07\x9b1m\u202eb\udcff\n") == "a?]0;title??1m?b??"
