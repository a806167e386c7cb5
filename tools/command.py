"""Command-line entry of the tools: a function as a command, with errors as one sentence."""

import sys
from collections.abc import Callable, Sequence

import tyro

from conventions.names import printable


def run_cli(
    does: Callable[..., None],
    program: str,
    arguments: Sequence[str] | None,
    *errors: type[Exception],
) -> int:
    """Run a function as a command; return 0, or 1 after printing one of ``errors``."""
    try:
        tyro.cli(does, prog=f"python -m {program}", args=arguments)
    except errors as error:
        sys.stderr.write(f"{printable(str(error))}\n")
        return 1
    return 0
