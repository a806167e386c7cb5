"""The leaderboard: results of many sets in one file, and as a page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from app.commands.said import name_file, say
from app.errors import RunError
from app.flags import Names
from app.run.many.board import board_page, entries_of, merged, read_board, write_board
from model.storage.files import written_atomically

Board = Annotated[Positional[Path], arg(metavar="BOARD.json")]


def add(
    board: Board,
    results: Annotated[Positional[tuple[Path, ...]], arg(metavar="DIR")],
    systems: Names = (),
    note: str = "",
) -> None:
    """Take what `diagnose` left of whole sets into a leaderboard.

    A leaderboard is one JSON file. Entries of the same clips, recorded motion and encoders stand in
    one table.

    Args:
        board: made if it is not there.
        results: folders that `diagnose` has left.
        systems: take these only.
        note: stands beside the numbers.
    """
    known = read_board(board) if board.exists() else []
    new = [entries_of(folder, note, list(systems)) for folder in results]
    entries = merged([known, *new])
    write_board(entries, board)
    say(f"{len(entries) - len(known)} of {len(entries)} entries are new.")
    name_file(board)


def merge(
    boards: Annotated[Positional[tuple[Path, ...]], arg(metavar="BOARD.json")], out: Path
) -> None:
    """Put leaderboards together.

    Args:
        out: where.
    """
    write_board(merged(read_board(path) for path in boards), out)
    name_file(out)


def page(board: Board, out: Path) -> None:
    """Write a leaderboard as a page that can be sorted.

    Args:
        out: ends in .html.
    """
    if out.suffix.lower() != ".html":
        raise RunError(f"{out.name} must end in .html.")
    told = board_page(merged([read_board(board)]))
    with written_atomically(out) as part:
        part.write_text(told, encoding="utf-8")
    name_file(out)
