"""Text that may be anyone's, such as names of files and systems, made harmless for where it goes.

Whoever opens a table, a paper or a terminal with it must see a name, and nothing that is obeyed.
"""

import csv
import io
import re
from collections.abc import Iterable

from conventions.names import printable

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(inf|nan)")
_FORMULA = re.compile(r"(^|;)(?= *[=+\-@\uff1d\uff0b\uff0d\uff20])")
"""Where a spreadsheet begins a formula: where a cell begins, also if it cuts lines at semicolons,
and with the wide forms of the signs, too."""
_TEX = {
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
    "<": r"\textless{}", ">": r"\textgreater{}", "|": r"\textbar{}", '"': "''",
    # At the beginning of a row these would belong to the \\ before it.
    "[": "{[}", "]": "{]}", "*": "{*}",
    **{letter: f"\\{letter}" for letter in "{}&%$#_"},
}  # fmt: skip
_MARKDOWN = re.compile(r"([\\`*\[\]<>|])")


def csv_cell(value: object) -> object:
    """A cell that no spreadsheet takes for a formula; numbers, also written ones, stay as they are.

    An apostrophe stands before a sign that would begin one.
    """
    if not isinstance(value, str) or _NUMBER.fullmatch(value):
        return value
    return _FORMULA.sub(r"\1'", printable(value))


def csv_text(rows: Iterable[Iterable[object]], line_end: str = "\r\n") -> str:
    """Rows of anything as CSV; None is an empty cell. Files of it are written with newline=""."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator=line_end)
    writer.writerows([csv_cell(value) for value in row] for row in rows)
    return text.getvalue()


def tex(text: str) -> str:
    """With LaTeX's special characters as what they look like."""
    return "".join(_TEX.get(char, char) for char in printable(text))


def markdown(text: str) -> str:
    """With Markdown's and HTML's special characters as what they look like, in a cell too."""
    return _MARKDOWN.sub(r"\\\1", printable(text))
