"""How a tool is called: a function as a command, and what goes wrong as one sentence."""

import sys
from collections.abc import Callable, Sequence

import tyro

from conventions.names import printable


def called(
    does: Callable[..., None],
    program: str,
    arguments: Sequence[str] | None,
    *errors: type[Exception],
) -> int:
    """0 when done, 1 with a sentence for one of ``errors``; wrong arguments exit with 2."""
    try:
        tyro.cli(does, prog=f"python -m {program}", args=arguments)
    except errors as error:
        sys.stderr.write(f"{printable(str(error))}\n")
        return 1
    return 0
