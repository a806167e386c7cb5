"""How what is asked for is written on a command line: tyro makes flags of the fields of a frozen
dataclass, by their types, and says of them what their docstrings say."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, make_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, get_type_hints

from tyro.conf import arg
from tyro.constructors import PrimitiveConstructorSpec

from app.errors import RunError
from model.systems.registry import families

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T", bound="DataclassInstance")


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


def a_count(told: str) -> int:
    """Raises `RunError` if it is none."""
    if not told.isdecimal() or int(told) < 1:
        raise RunError(f"{told!r} is no number from 1 on")
    return int(told)


File = Annotated[Path | None, written(Path, "FILE", "none")]
Text = Annotated[str | None, written(str, "NAME", "the first that is known")]
Names = Annotated[tuple[str, ...], written(names_of, "A,B,...", "all", ",".join)]
Count = Annotated[int | None, written(a_count, "N", "none")]


def part_of(asked: type, *names: str, **instead: Any) -> type:
    """The same dataclass, of which a command has flags of some fields alone.

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
    part = type(asked.__name__, (asked,), {"__annotations__": own, **values})
    return dataclass(frozen=True, kw_only=True)(part)


def whole(asked: type[T], part: Any, **others: Any) -> T:
    """What was asked for by some of its fields."""
    return asked(**{of.name: getattr(part, of.name) for of in fields(asked)} | others)


def family_files() -> type:
    """A dataclass with a flag for each file that a family needs."""
    files = [file for family in families() for file in family.files]
    kind = Annotated[Path | None, written(Path, "FILE", "none")]
    named = [
        (_name_of(file.flag), Annotated[kind, arg(help=file.help)], field(default=None))
        for file in files
    ]
    return make_dataclass("FamilyFiles", named, frozen=True)


def add_family_files(parser: argparse.ArgumentParser) -> None:
    """Flags that name them, a group for each family that has some."""
    for family in families():
        if not family.files:
            continue
        group = parser.add_argument_group(family.files_title)
        for file in family.files:
            group.add_argument(file.flag, type=Path, metavar=file.metavar, help=file.help)


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
