"""The command ``leaderboard``: results of many sets in one file, and as a page."""

from __future__ import annotations

import argparse
from pathlib import Path

from app.commands.said import name_file, say
from app.errors import RunError
from app.run.many.board import board_page, entries_of, merged, read_board, write_board
from model.storage.files import written_atomically


def add_leaderboard(commands) -> None:
    """The command with its own commands."""
    parser = commands.add_parser(
        "leaderboard",
        help="keep results of many sets in one file, put two together, show them as a page",
        description="A leaderboard is one JSON file. Entries of the same clips, recorded motion "
        "and encoders stand in one table.",
    )
    own = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    add = own.add_parser("add", help="take in what diagnose left of whole sets")
    add.add_argument("board", type=Path, metavar="BOARD.json", help="made if it is not there")
    add.add_argument("results", type=Path, nargs="+", metavar="DIR", help="diagnose's --out")
    add.add_argument(
        "--systems", default="", metavar="A,B,...", help="take these only (default: all)"
    )
    add.add_argument("--note", default="", help="stands beside the numbers")
    add.set_defaults(command=_add)
    merge = own.add_parser("merge", help="put boards together")
    merge.add_argument("boards", type=Path, nargs="+", metavar="BOARD.json")
    merge.add_argument("--out", type=Path, required=True, metavar="BOARD.json")
    merge.set_defaults(command=_merge)
    page = own.add_parser("page", help="write it as a page that can be sorted")
    page.add_argument("board", type=Path, metavar="BOARD.json")
    page.add_argument("--out", type=Path, required=True, metavar="FILE.html")
    page.add_argument("--title", default="Leaderboard", help="default: %(default)s")
    page.set_defaults(command=_page)


def _add(options: argparse.Namespace) -> None:
    known = read_board(options.board) if options.board.exists() else []
    names = [name.strip() for name in options.systems.split(",") if name.strip()]
    new = [entries_of(folder, options.note, names) for folder in options.results]
    board = merged([known, *new])
    write_board(board, options.board)
    say(f"{len(board) - len(known)} of {len(board)} entries are new.")
    name_file(options.board)


def _merge(options: argparse.Namespace) -> None:
    write_board(merged(read_board(path) for path in options.boards), options.out)
    name_file(options.out)


def _page(options: argparse.Namespace) -> None:
    if options.out.suffix.lower() != ".html":
        raise RunError(f"{options.out.name} must end in .html.")
    page = board_page(merged([read_board(options.board)]), options.title)
    with written_atomically(options.out) as part:
        part.write_text(page, encoding="utf-8")
    name_file(options.out)
