"""Flags of a command from the fields of its request."""

import argparse
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from app.errors import RunError
from app.flags import SEED, add_flags, flag, flags_of, names_of, read_flags


def _even(written: str) -> int:
    if int(written) % 2:
        raise RunError(f"{written} is odd.")
    return int(written)


@dataclass(frozen=True)
class _Inner:
    color: str = field(default="red", metadata=flag("which"))


@dataclass(frozen=True)
class _Request:
    files: tuple[Path, ...] = field(
        metadata=flag(None, "FILE", Path, is_positional=True, takes_several=True)
    )
    out: Path = field(metadata=flag("where to", "DIR", Path))
    kept: str = "of the page alone"
    seed: int = field(default=0, metadata=SEED)
    max_s: float = field(default=60.0, metadata=flag("minutes", "N", lambda m: 60 * float(m)))
    size: int = field(default=2, metadata=flag("even", "PX", _even, "--width"))
    way: str = field(default="a", metadata=flag("how", choices=("a", "b")))
    has_video: bool = field(default=True, metadata=flag("none", name="--no-video"))
    is_draft: bool = field(default=False, metadata=flag("faster", name="--draft"))
    body: str | None = field(default=None, metadata=flag("which", usual=lambda: "from outside"))
    names: tuple[str, ...] = field(default_factory=tuple, metadata=flag("which", read=names_of))
    inner: _Inner = field(default_factory=_Inner, metadata=flags_of(_Inner))


def _read(written: str, **others: object) -> _Request:
    parser = argparse.ArgumentParser()
    add_flags(parser, _Request)
    return read_flags(_Request, parser.parse_args(written.split()), **others)


def test_every_field_is_read_as_it_says_and_unwritten_as_it_is() -> None:
    assert _read("a b --out x") == _Request((Path("a"), Path("b")), Path("x"), body="from outside")
    written = (
        "a --out x --seed 3 --max-s 2 --width 4 --way b --no-video --draft --body c --names d,e "
        "--color blue"
    )
    assert _read(written, kept="here") == _Request(
        (Path("a"),), Path("x"), "here", seed=3, max_s=120.0, size=4, way="b", has_video=False,
        is_draft=True, body="c", names=("d", "e"), inner=_Inner("blue"),
    )  # fmt: skip
    assert names_of("all") == ()
    assert names_of(" a, b,") == ("a", "b")


def test_what_cannot_be_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    for written, sentence in [
        ("--out x", "required: FILE"),
        ("a", "required: --out"),
        ("a --out x --width 3", "argument --width: 3 is odd."),
        ("a --out x --seed 1.5", "argument --seed: '1.5' is no number"),
        ("a --out x --way c", "invalid choice: 'c'"),
        ("a --out x --names ,", "argument --names: name at least one"),
        ("a --out x --kept here", "unrecognized arguments: --kept"),
    ]:
        with pytest.raises(SystemExit) as stopped:
            _read(written)
        assert stopped.value.code == 2
        assert sentence in capsys.readouterr().err
