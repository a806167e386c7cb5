"""Escaping of untrusted text, such as names of files and systems, for CSV, TeX and Markdown.

Tables, papers and terminals then show a name, and nothing in it is executed.
"""

import csv
import io
import re
from collections.abc import Iterable

from conventions.names import printable

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(inf|nan)")
_FORMULA = re.compile(r"(^|;)(?= *[=+\-@\uff1d\uff0b\uff0d\uff20])")
"""Pattern of the start of a spreadsheet formula: the start of a cell, also in programs that split
at semicolons, and with full-width forms of the signs."""
_TEX = {
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
    "<": r"\textless{}", ">": r"\textgreater{}", "|": r"\textbar{}", '"': "''",
    # At the beginning of a row these would belong to the \\ before it.
    "[": "{[}", "]": "{]}", "*": "{*}",
    **{letter: f"\\{letter}" for letter in "{}&%$#_"},
}  # fmt: skip
_MARKDOWN = re.compile(r"([\\`*\[\]<>|])")


def escape_csv_cell(value: object) -> object:
    """Return a cell that no spreadsheet takes for a formula; numbers, also as text, are unchanged.

    An apostrophe is inserted before a sign that would start one.
    """
    if not isinstance(value, str) or _NUMBER.fullmatch(value):
        return value
    return _FORMULA.sub(r"\1'", printable(value))


def csv_text(rows: Iterable[Iterable[object]], line_end: str = "\r\n") -> str:
    """Format rows as CSV; None is an empty cell. Write the text to files with newline=""."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator=line_end)
    writer.writerows([escape_csv_cell(value) for value in row] for row in rows)
    return text.getvalue()


def escape_latex(text: str) -> str:
    """Escape LaTeX's special characters."""
    return "".join(_TEX.get(char, char) for char in printable(text))


def escape_markdown(text: str) -> str:
    """Escape the special characters of Markdown, HTML and Markdown tables."""
    return _MARKDOWN.sub(r"\\\1", printable(text))
