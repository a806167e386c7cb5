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
from dataclasses import MISSING, dataclass, field, fields, make_dataclass
from itertools import takewhile
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import tyro
from tyro.conf import arg
from tyro.constructors import PrimitiveConstructorSpec

from app.errors import RunError
from conventions.names import listed, printable
from model.systems.registry import families


def written(
    read: Callable[[str], Any],
    metavar: str,
    usual: str = "",
    show: Callable[[Any], str] = str,
) -> PrimitiveConstructorSpec:
    """Marks a type whose values are read from one word.

    Args:
        read: may raise `RunError` with the sentence that says why a word is none.
        usual: what is said in place of a default that is None or empty.
    """
    return PrimitiveConstructorSpec(
        nargs=1,
        metavar=metavar,
        instance_from_str=lambda words: read(words[0]),
        is_instance=lambda value: True,
        str_from_instance=lambda value: [usual if value in (None, ()) else show(value)],
    )


def names_of(told: str) -> tuple[str, ...]:
    """``A,B``; the empty tuple of ``all``.

    Raises:
        RunError: if there is none.
    """
    names = tuple(name.strip() for name in told.split(",") if name.strip())
    if not names:
        raise RunError("name at least one")
    return () if names == ("all",) else names


def one_of(choices: tuple[Any, ...]) -> PrimitiveConstructorSpec:
    """Marks a type of which a person may ask for these alone."""

    def read(told: str) -> Any:
        for choice in choices:
            if told == str(choice):
                return choice
        raise RunError(f"{told!r} is none of {', '.join(map(str, choices))}")

    return written(read, "|".join(map(str, choices)))


def some_of(
    choices: tuple[str, ...], refusal: str, metavar: str, none: str = ""
) -> PrimitiveConstructorSpec:
    """Marks a tuple of which a person may name these alone, each once.

    Args:
        refusal: says that there is no such ``name``, and the ``names`` that there are.
        none: the word for none of them; without it one must be named.
    """

    def read(told: str) -> tuple[str, ...]:
        names = () if told and told == none else names_of(told)
        for name in names:
            if name not in choices:
                raise RunError(refusal.format(name=name, names=", ".join(choices)))
        return tuple(dict.fromkeys(names))

    return written(read, metavar, none, ",".join)


def no(name: str, about: str) -> Any:
    """Marks a switch that is on by default, whose flag ``--no-NAME`` leaves something out."""
    return arg(name=name, help=about, help_behavior_hint="")


def a_count(told: str) -> int:
    """Raises `RunError` if it is none."""
    if not told.isdecimal() or int(told) < 1:
        raise RunError(f"{told!r} is no number from 1 on")
    return int(told)


File = Annotated[Path | None, written(Path, "FILE", "none")]
Text = Annotated[str | None, written(str, "NAME", "the first that is known")]
Names = Annotated[tuple[str, ...], written(names_of, "A,B,...", "all", ",".join)]
Count = Annotated[int | None, written(a_count, "N", "none")]
Minutes = Annotated[
    float,
    written(lambda told: 60 * float(told), "N", show=lambda seconds: f"{seconds / 60:g}"),
    arg(name="max-minutes"),
]
"""Seconds."""


def part_of(asked: type, *names: str, **instead: Any) -> Any:
    """Marks a dataclass of which a command has flags of some fields alone; it is given the whole.

    Args:
        instead: of some fields another type, or with it another default: ``(type,)`` or ``(type,
            default)``.
    """
    hints = get_type_hints(asked, include_extras=True)
    own: dict[str, Any] = {name: each[0] for name, each in instead.items()}
    values: dict[str, Any] = {
        name: field(default=each[1]) if each[1:] else field() for name, each in instead.items()
    }
    for of in fields(asked):
        if of.name not in (*names, *instead):
            own[of.name] = hints[of.name]
            values[of.name] = field(
                init=False, default=of.default, default_factory=of.default_factory
            )

    def whole(cls: type, **given: Any) -> Any:
        return asked(**given)

    own_kind = {"__annotations__": own, "__new__": whole, **values}
    part = type(asked.__name__, (asked,), own_kind)
    return arg(constructor=dataclass(frozen=True, kw_only=True)(part))


def refuse_ignored(asked: Any, names: Sequence[str], why: str, **usual: Any) -> None:
    """Refuse flags that a command would ignore, where they differ from their defaults.

    Args:
        asked: the dataclass that the command was given.
        names: fields of it that the command does not use.
        why: first clause of the refusal.
        usual: defaults that differ from the dataclass's own.

    Raises:
        RunError: naming the flags.
    """
    hints = get_type_hints(type(asked), include_extras=True)
    given = []
    for of in fields(asked):
        if of.name not in names:
            continue
        default = of.default if of.default_factory is MISSING else of.default_factory()
        if getattr(asked, of.name) not in (default, usual.get(of.name, default)):
            marks = getattr(hints[of.name], "__metadata__", ())
            flag = next((mark.name for mark in marks if getattr(mark, "name", None)), of.name)
            given.append(f"--{flag.replace('_', '-')}")
    if given:
        raise RunError(f"{why}; leave {listed(given)} out.")


def family_files() -> Any:
    """Marks what has a flag for each file that a family needs."""
    files = [file for family in families() for file in family.files]
    kind = Annotated[Path | None, written(Path, "FILE", "none")]
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
