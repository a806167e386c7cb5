"""How fields of a request, and files that families need, are asked for on a command line.

A request is a frozen dataclass of `app.run`; its command adds the flags of its fields and gets the
request back from what was written. Fields without a flag are of the page alone.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from app.config import BUNDLED_WEIGHTS
from app.errors import RunError
from model.systems.registry import families

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T", bound="DataclassInstance")
_KEY, _INNER = "flag", "flags"


@dataclass(frozen=True)
class Flag:
    """Of one field of a request. A field that is a switch has a flag that turns it over."""

    help: str | None = None
    metavar: str | None = None
    read: Callable[[str], Any] | None = None
    """The value from what is written, which is taken as it is by default. May raise `RunError`."""
    name: str = ""
    """Such as ``--start``; by default that of the field."""
    is_positional: bool = False
    takes_several: bool = False
    choices: Sequence[Any] | None = None
    usual: Callable[[], Any] | None = None
    """What stands where nothing is written, if that is not the field's own default."""

    def add(self, parser: argparse.ArgumentParser, of: Field[Any]) -> None:
        """Let a parser know it."""
        default = self.usual() if self.usual else _default(of)
        if self.is_positional:
            parser.add_argument(
                of.name,
                type=self._argument,
                nargs="+" if self.takes_several else None,
                metavar=self.metavar,
                help=self.help,
            )
            return
        name = self.name or f"--{of.name.replace('_', '-')}"
        if isinstance(default, bool):
            action = "store_false" if default else "store_true"
            parser.add_argument(name, dest=of.name, action=action, help=self.help)
            return
        parser.add_argument(
            name,
            dest=of.name,
            type=self._argument,
            default=None if default is MISSING else default,
            required=default is MISSING,
            choices=self.choices,
            metavar=self.metavar,
            help=self.help,
        )

    def _argument(self, written: str) -> Any:
        try:
            return self.read(written) if self.read else written
        except RunError as error:
            raise argparse.ArgumentTypeError(str(error)) from None
        except ValueError:
            raise argparse.ArgumentTypeError(f"{written!r} is no number") from None


def flag(
    help: str | None = None,
    metavar: str | None = None,
    read: Callable[[str], Any] | None = None,
    name: str = "",
    **more: Any,
) -> Mapping[str, Flag]:
    """Metadata of a field with a `Flag`."""
    return {_KEY: Flag(help, metavar, read, name, **more)}


def flags_of(request: type) -> Mapping[str, type]:
    """Metadata of a field that is a request of its own, whose flags stand among the others."""
    return {_INNER: request}


def _default(of: Field[Any]) -> Any:
    return of.default if of.default_factory is MISSING else of.default_factory()


def add_flags(parser: argparse.ArgumentParser, request: type) -> None:
    """The flags of all fields of a request, in their order."""
    for of in fields(request):
        if (own := of.metadata.get(_KEY)) is not None:
            own.add(parser, of)
        elif (inner := of.metadata.get(_INNER)) is not None:
            add_flags(parser, inner)


def read_flags(request: type[T], options: argparse.Namespace, **others: Any) -> T:
    """The request that was written; ``others`` are its fields that have no flags, or other values
    than were written."""
    asked: dict[str, Any] = {}
    for of in fields(request):
        if (own := of.metadata.get(_KEY)) is not None:
            value = getattr(options, of.name)
            asked[of.name] = tuple(value) if own.takes_several else value
        elif (inner := of.metadata.get(_INNER)) is not None:
            asked[of.name] = read_flags(inner, options)
    return request(**{**asked, **others})


def names_of(written: str) -> tuple[str, ...]:
    """``A,B``; the empty tuple of ``all``.

    Raises:
        RunError: if there is none.
    """
    names = tuple(name.strip() for name in written.split(",") if name.strip())
    if not names:
        raise RunError("name at least one")
    return () if names == ("all",) else names


OUT_FOLDER = flag("folder of results", "DIR", Path, name="--out")
SPEECH = flag("any sound file", "SPEECH", Path, is_positional=True)
SEED = flag("default: %(default)s", "N", int)
WEIGHTS = flag("default: bundled", "DIR", Path, usual=lambda: BUNDLED_WEIGHTS)
SPEAKER = flag("default: the first that is known", "NAME")
MANNER = flag("whose manner (default: the first)", "NAME", name="--speaker")
SOUND = flag("sound of the video", "WAV", Path)


def add_family_files(parser: argparse.ArgumentParser) -> None:
    """Flags that name them, a group for each family that has some."""
    for family in families():
        if not family.files:
            continue
        group = parser.add_argument_group(family.files_title)
        for file in family.files:
            group.add_argument(file.flag, type=Path, metavar=file.metavar, help=file.help)


def use_family_files(options: argparse.Namespace) -> None:
    """Let this process and its children know what was named; see at once that it is all there.

    Raises:
        CheckpointError, EncoderError: if something is named, but not there, or not enough.
    """
    for family in families():
        for file in family.files:
            path = getattr(options, file.flag.removeprefix("--").replace("-", "_"))
            if path is not None:
                os.environ[file.variable] = str(path.absolute())
        family.require_files()
