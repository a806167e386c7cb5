"""Types, parsers, help and error messages of the command-line flags that tyro makes.

Flags follow from the field types of request dataclasses, and their help from field docstrings.
"""

from __future__ import annotations

import functools
import io
import os
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, field, make_dataclass
from itertools import takewhile
from pathlib import Path
from typing import Annotated, Any

import tyro
from tyro.conf import arg
from tyro.constructors import PrimitiveConstructorSpec

from app.errors import RunError
from conventions.names import printable
from model.systems.registry import families


def parsed_type(
    parse: Callable[[str], Any], metavar: str, default: str = "", show: Callable[[Any], str] = str
) -> PrimitiveConstructorSpec[Any]:
    """Make the annotation of a type that is parsed from one word, in flags and forms.

    The parser may raise `RunError` with the reason; ``default`` is the help's text for a default
    that is None or empty.
    """
    return PrimitiveConstructorSpec(
        nargs=1,
        metavar=metavar,
        instance_from_str=lambda words: parse(words[0]),
        is_instance=lambda value: True,
        str_from_instance=lambda value: [default if value in (None, ()) else show(value)],
    )


@dataclass(frozen=True)
class CheckboxValuePair:
    """Annotation of a type for which a check box selects one of two values."""

    checked: str
    unchecked: str


def parse_names_or_all(flag: str) -> tuple[str, ...]:
    """Parse ``A,B`` into a tuple of names, empty for ``all``; raises RunError without a name."""
    names = tuple(name.strip() for name in flag.split(",") if name.strip())
    if not names:
        raise RunError("give at least one name")
    return () if names == ("all",) else names


def choice_type(choices: tuple[Any, ...]) -> PrimitiveConstructorSpec:
    """Make the annotation of a type that accepts only the listed values."""

    def read(flag: str) -> Any:
        for choice in choices:
            if flag == str(choice):
                return choice
        raise RunError(f"{flag!r} is not one of {', '.join(map(str, choices))}")

    return parsed_type(read, "|".join(map(str, choices)), show=_shortest)


def _shortest(value: Any) -> str:
    """Format a value as among the choices: 1.0 as 1."""
    return f"{value:g}" if isinstance(value, float) else str(value)


def subset_type(
    choices: tuple[str, ...], refusal: str, metavar: str, none: str = ""
) -> PrimitiveConstructorSpec:
    """Make the annotation of a tuple that accepts only the listed names, each once.

    The refusal has placeholders for the unknown ``name`` and the known ``names``; ``none`` is the
    word for the empty tuple, without which at least one name is required.
    """

    def read(flag: str) -> tuple[str, ...]:
        names = () if flag and flag == none else parse_names_or_all(flag)
        for name in names:
            if name not in choices:
                raise RunError(refusal.format(name=name, names=", ".join(choices)))
        return tuple(dict.fromkeys(names))

    return parsed_type(read, metavar, none, ",".join)


def negative_flag(name: str, about: str) -> Any:
    """Make the annotation of a switch that is on by default and has the flag ``--no-NAME``."""
    return arg(name=name, help=about, help_behavior_hint="")


def parse_count(flag: str) -> int:
    """Parse a whole number of at least 1; raises RunError for all else."""
    if not flag.isdecimal() or int(flag) < 1:
        raise RunError(f"{flag!r} is not a whole number of at least 1")
    return int(flag)


File = Annotated[Path | None, parsed_type(Path, "FILE", "none")]
FileOrDefault = Annotated[File, arg(help_behavior_hint="")]
"""File whose help text says what is used by default."""
Text = Annotated[str | None, parsed_type(str, "NAME", "the first speaker")]
Names = Annotated[tuple[str, ...], parsed_type(parse_names_or_all, "A,B,...", "all", ",".join)]
Count = Annotated[int | None, parsed_type(parse_count, "N", "none")]
MinutesFlag = Annotated[
    float,
    parsed_type(lambda value: 60 * float(value), "N", show=lambda seconds: f"{seconds / 60:g}"),
    arg(name="max-minutes"),
]
"""Duration in seconds that is entered in minutes."""


def family_files_annotation() -> Any:
    """Make the annotation of an argument with one flag for each file that a system family needs."""
    files = [file for family in families() for file in family.files]
    named = [
        (
            _name_of(file.flag),
            Annotated[
                Path | None,
                parsed_type(Path, file.metavar),
                arg(help=file.help, help_behavior_hint=""),  # it says the default
            ],
            field(default=None),
        )
        for file in files
    ]
    return arg(constructor=make_dataclass("FamilyFiles", named, frozen=True))


def export_family_files(paths: Mapping[str, Any]) -> None:
    """Export family files to all processes; raises CheckpointError or EncoderError if missing."""
    for family in families():
        for file in family.files:
            path = paths[_name_of(file.flag)]
            if path is not None:
                os.environ[file.environment_variable] = str(path.absolute())
        family.require_files()


def _name_of(flag: str) -> str:
    return flag.removeprefix("--").replace("-", "_")


_SHAPE = (
    tyro.conf.OmitArgPrefixes,
    tyro.conf.FlagCreatePairsOff,
    tyro.conf.HelptextFromCommentsOff,
)
_NO_NUMBER = (
    (re.compile(r"invalid literal for int\(\) with base 10: (.*)"), r"\1 is not a whole number"),
    (re.compile(r"could not convert string to float: (.*)"), r"\1 is not a number"),
)


def parse_command(
    function: Callable[..., Any], program: str, argv: Sequence[str]
) -> Callable[[], Any]:
    """Return a function bound to the arguments of a command line.

    Raises SystemExit: status 2 after an error message for wrong arguments; status 0 after help.
    """

    @functools.wraps(function)
    def held(*positional: object, **named: object) -> Callable[[], Any]:
        return functools.partial(function, *positional, **named)

    output = io.StringIO()
    shown = io.TextIOWrapper(io.BytesIO(), encoding=sys.stdout.encoding or "utf-8")
    try:
        with redirect_stderr(output), redirect_stdout(shown):
            return tyro.cli(held, prog=program, args=list(argv), config=_SHAPE)  # type: ignore[return-value]
    except RunError as error:  # invalid in combination with other values
        sys.stderr.write(f"{printable(f'{program}: {error} See --help.')}\n")
        raise SystemExit(2) from None
    except SystemExit as left:
        if left.code:
            sentence = f"{program}: {_sentence(output.getvalue(), program)} See --help."
            sys.stderr.write(f"{printable(sentence)}\n")
        shown.seek(0)
        sys.stdout.write(_in_groups(shown.read()))
        raise


FLAG_GROUP_TITLES: Mapping[str, str] = {
    "positional arguments": "Input",
    "output options": "Output",
    "speech options": "Speech",
    "sampling options": "Systems and sampling",
    "planning options": "Plan",
    "imports options": "Reference motion and import settings",
    "motions options": "Motions",
    "metrics options": "Metrics",
    "options": "Options",
    "figures options": "Figures",
    "video options": "Video",
    "video.display options": "Video overlays",
    "stills options": "Stills and meshes",
    "pool options": "Batch runs",
    "files options": "Checkpoints of other authors",
}
"""Titles of the groups of flags in help, by those of tyro and in order."""


def _in_groups(help_text: str) -> str:
    """Sort the boxes of tyro's help and replace titles by `FLAG_GROUP_TITLES`, except in ASCII."""
    above, boxes = [], []
    for line in help_text.splitlines():
        if line.startswith("╭─ "):
            boxes.append([line])
        else:
            (boxes[-1] if boxes else above).append(line)
    order, groups = [*FLAG_GROUP_TITLES], {}
    for head, *rest in boxes:
        title = head.strip("╭╮─ ")
        own = FLAG_GROUP_TITLES.get(title, title)
        groups[title] = [f"╭─ {own} {'─' * (len(head) - len(own) - 4)}╮", *rest]
    titles = sorted(groups, key=lambda title: order.index(title) if title in order else len(order))
    return "".join(f"{line}\n" for line in [*above, *(each for t in titles for each in groups[t])])


def _sentence(box: str, program: str) -> str:
    """Convert tyro's boxed error message to one line of text."""
    title, *lines = [line.strip("│ ") for line in box.splitlines()]
    lines = lines if title.startswith("╭") else lines[1:]  # in ASCII the title is underlined
    message = " ".join(takewhile(lambda line: not line.startswith(("─", "-----")), lines))
    message = re.sub(rf"^Missing from {re.escape(program)}[^:]*:", "Missing:", message)
    message = message.removeprefix("Error parsing ").replace(
        "Unrecognized options: ", "There is no "
    )
    if "Perhaps you meant:" in lines:
        near = lines[lines.index("Perhaps you meant:") + 1].split()[0]
        message = f"{message}; did you mean {near}?"
    for pattern, better in _NO_NUMBER:
        message = pattern.sub(better, message)
    return message if message.endswith((".", ")", "?")) else f"{message}."
