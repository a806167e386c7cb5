"""How what is asked for is written on a command line: tyro makes flags of the fields of a frozen
dataclass, by their types, and says of them what their docstrings say."""

from __future__ import annotations

import functools
import io
import os
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import redirect_stderr
from dataclasses import dataclass, field, make_dataclass
from itertools import takewhile
from pathlib import Path
from typing import Annotated, Any

import tyro
from pydantic import GetCoreSchemaHandler
from pydantic_core import core_schema
from tyro.conf import arg
from tyro.constructors import PrimitiveConstructorSpec

from app.errors import RunError
from conventions.names import printable
from model.systems.registry import families


class TextType(PrimitiveConstructorSpec[Any]):
    """A type that tyro and pydantic read from text in the same way."""

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        def read(value: Any) -> Any:
            if not isinstance(value, str):
                return value
            try:
                return self.instance_from_str([value.strip()])
            except RunError as error:
                raise ValueError(str(error)) from error

        return core_schema.no_info_before_validator_function(read, handler(source))


def text_type(
    parse: Callable[[str], Any],
    metavar: str,
    default: str = "",
    show: Callable[[Any], str] = str,
) -> PrimitiveConstructorSpec[Any]:
    """Mark a type whose values are read from one word, on the command line, in forms and in files.

    Args:
        parse: may raise `RunError` with a sentence that says why a word cannot be read.
        default: shown in help in place of a default that is None or empty.
    """
    return TextType(
        nargs=1,
        metavar=metavar,
        instance_from_str=lambda words: parse(words[0]),
        is_instance=lambda value: True,
        str_from_instance=lambda value: [default if value in (None, ()) else show(value)],
    )


@dataclass(frozen=True)
class Switch:
    """Mark a type of which a check box gives one of two values."""

    on: str
    off: str

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        def read(value: Any) -> Any:
            return (self.on if value else self.off) if isinstance(value, bool) else value

        return core_schema.no_info_before_validator_function(read, handler(source))


def parse_names(told: str) -> tuple[str, ...]:
    """``A,B``; the empty tuple of ``all``.

    Raises:
        RunError: if there is none.
    """
    names = tuple(name.strip() for name in told.split(",") if name.strip())
    if not names:
        raise RunError("name at least one")
    return () if names == ("all",) else names


def choice_type(choices: tuple[Any, ...]) -> PrimitiveConstructorSpec:
    """Marks a type of which a person may ask for these alone."""

    def read(told: str) -> Any:
        for choice in choices:
            if told == str(choice):
                return choice
        raise RunError(f"{told!r} is none of {', '.join(map(str, choices))}")

    return text_type(read, "|".join(map(str, choices)))


def subset_type(
    choices: tuple[str, ...], refusal: str, metavar: str, none: str = ""
) -> PrimitiveConstructorSpec:
    """Marks a tuple of which a person may name these alone, each once.

    Args:
        refusal: says that there is no such ``name``, and the ``names`` that there are.
        none: the word for none of them; without it one must be named.
    """

    def read(told: str) -> tuple[str, ...]:
        names = () if told and told == none else parse_names(told)
        for name in names:
            if name not in choices:
                raise RunError(refusal.format(name=name, names=", ".join(choices)))
        return tuple(dict.fromkeys(names))

    return text_type(read, metavar, none, ",".join)


def negative_flag(name: str, about: str) -> Any:
    """Mark a switch that is on by default, whose flag ``--no-NAME`` leaves something out."""
    return arg(name=name, help=about, help_behavior_hint="")


def parse_count(told: str) -> int:
    """Raises `RunError` if it is none."""
    if not told.isdecimal() or int(told) < 1:
        raise RunError(f"{told!r} is no number from 1 on")
    return int(told)


File = Annotated[Path | None, text_type(Path, "FILE", "none")]
Text = Annotated[str | None, text_type(str, "NAME", "the first that is known")]
Names = Annotated[tuple[str, ...], text_type(parse_names, "A,B,...", "all", ",".join)]
Count = Annotated[int | None, text_type(parse_count, "N", "none")]
Minutes = Annotated[
    float,
    text_type(lambda told: 60 * float(told), "N", show=lambda seconds: f"{seconds / 60:g}"),
    arg(name="max-minutes"),
]
"""Seconds."""


def family_files() -> Any:
    """Marks what has a flag for each file that a family needs."""
    files = [file for family in families() for file in family.files]
    kind = Annotated[Path | None, text_type(Path, "FILE", "none")]
    named = [
        (_name_of(file.flag), Annotated[kind, arg(help=file.help)], field(default=None))
        for file in files
    ]
    return arg(constructor=make_dataclass("FamilyFiles", named, frozen=True))


def use_family_files(named: Mapping[str, Any]) -> None:
    """Let this process and its children know what was named; see at once that it is all there.

    Raises:
        CheckpointError, EncoderError: if something is named, but not there, or not enough.
    """
    for family in families():
        for file in family.files:
            path = named[_name_of(file.flag)]
            if path is not None:
                os.environ[file.variable] = str(path.absolute())
        family.require_files()


def _name_of(flag: str) -> str:
    return flag.removeprefix("--").replace("-", "_")


_SHAPE = (
    tyro.conf.OmitArgPrefixes,
    tyro.conf.FlagCreatePairsOff,
    tyro.conf.HelptextFromCommentsOff,
)
_NO_NUMBER = (
    (re.compile(r"invalid literal for int\(\) with base 10: (.*)"), r"\1 is no whole number"),
    (re.compile(r"could not convert string to float: (.*)"), r"\1 is no number"),
)


def read_flags(does: Callable[..., Any], program: str, argv: Sequence[str]) -> Callable[[], Any]:
    """A function with the arguments that the words of a command line give it.

    Raises:
        SystemExit: 2 after a sentence, where they give none; 0 after help.
    """

    @functools.wraps(does)
    def held(*given: object, **named: object) -> Callable[[], Any]:
        return functools.partial(does, *given, **named)

    told = io.StringIO()
    try:
        with redirect_stderr(told):
            return tyro.cli(held, prog=program, args=list(argv), config=_SHAPE)  # type: ignore[return-value]
    except RunError as error:  # of a value that cannot stand with the others
        sys.stderr.write(f"{printable(f'{program}: {error} See --help.')}\n")
        raise SystemExit(2) from None
    except SystemExit as left:
        if left.code:
            sentence = f"{program}: {_sentence(told.getvalue(), program)} See --help."
            sys.stderr.write(f"{printable(sentence)}\n")
        raise


def _sentence(box: str, program: str) -> str:
    """What tyro says in a box, as a line of text."""
    title, *lines = [line.strip("│ ") for line in box.splitlines()]
    lines = lines if title.startswith("╭") else lines[1:]  # in ASCII the title is underlined
    said = " ".join(takewhile(lambda line: not line.startswith(("─", "-----")), lines))
    said = re.sub(rf"^Missing from {re.escape(program)}[^:]*:", "Missing:", said)
    said = said.removeprefix("Error parsing ").replace("Unrecognized options: ", "There is no ")
    if "Perhaps you meant:" in lines:
        near = lines[lines.index("Perhaps you meant:") + 1].split()[0]
        said = f"{said}; perhaps {near} is meant"
    for found, better in _NO_NUMBER:
        said = found.sub(better, said)
    return said if said.endswith((".", ")")) else f"{said}."
