"""Command line: names of the commands and parsing of their arguments.

Exit status: 0 for success, 1 for failure and 2 for wrong arguments, each with a sentence on stderr.
"""

from __future__ import annotations

import logging
import signal
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import NoReturn

from app import text
from app.commands import runs, studies
from app.commands.convert import convert
from app.commands.doctor import doctor
from app.commands.protocols import protocols
from app.config import use_matplotlib_file_backend
from app.errors import Cancelled, message_for_user
from app.flags import parse_command
from app.run.output.console import SafeLogFormatter, print_message
from model.systems.registry import unavailable_family_messages

PROGRAM = "python -m app"
COMMANDS: Mapping[str, Callable[..., None]] = {
    "generate": runs.generate,
    "diagnose": runs.diagnose,
    "step-sweep": runs.step_sweep,
    "render": runs.render,
    "figure6": runs.figure6,
    "convert": convert,
    "plan": runs.plan,
    "speech-effect": runs.speech_effect,
    "rotation-noise": runs.rotation_noise,
    "leaderboard add": runs.leaderboard_add,
    "leaderboard merge": runs.leaderboard_merge,
    "leaderboard page": runs.leaderboard_page,
    "protocols": protocols,
    "doctor": doctor,
    "study export": studies.export,
    "study check": studies.check_leaks,
    "study links": studies.create_links,
    "study analyse": studies.analyse,
    "study simulate": studies.simulate,
}
RENAMED_COMMANDS = {
    "hearing": "speech-effect",
    "mechanism": "rotation-noise",
    "steps": "step-sweep",
}
RENAMED_FLAGS = {
    "--joint": "--tracked-point",
    "--no-pictures": "--no-poses",
    "--sheet": "--contact-sheet-every",
}
"""Former names, which are accepted in this version with a message."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit status."""
    use_matplotlib_file_backend()
    log_to = logging.StreamHandler()
    log_to.setFormatter(SafeLogFormatter("%(levelname)s %(name)s: %(message)s"))
    logging.basicConfig(level=logging.WARNING, handlers=[log_to])
    command = parse(sys.argv[1:] if argv is None else argv)
    for sentence in unavailable_family_messages():
        print_message(sentence)
    # SIGTERM must unwind every `with`, so that no partial file or child process remains.
    previous = signal.signal(signal.SIGTERM, _interrupt)
    try:
        command()
    except (KeyboardInterrupt, Cancelled):
        print_message("Stopped. Nothing was saved.")
        return 1
    except Exception as error:
        sentence = message_for_user(error)
        if sentence is None:
            raise
        print_message(sentence)
        return 1
    finally:
        signal.signal(signal.SIGTERM, previous)
    return 0


def parse(argv: Sequence[str]) -> Callable[[], None]:
    """Parse a command line into the command, bound to its arguments.

    Raises SystemExit: status 2 after an error message if there is no such command; 0 after help.
    """
    argv = _with_current_names(argv)
    name = next((" ".join(argv[:n]) for n in (2, 1) if " ".join(argv[:n]) in COMMANDS), None)
    if name is None:
        _overview(argv)
    return parse_command(COMMANDS[name], f"{PROGRAM} {name}", argv[len(name.split()) :])


def _with_current_names(argv: Sequence[str]) -> list[str]:
    """Return the arguments with current names of commands and flags; report former ones."""
    current = []
    for number, word in enumerate(argv):
        name, equals, value = word.partition("=")
        renamed = RENAMED_FLAGS if number else RENAMED_COMMANDS
        if name in renamed:
            new = renamed[name]
            print_message(
                f"{PROGRAM}: {name} was renamed to {new}. The old name still works, but will be "
                "removed."
            )
        current.append(f"{renamed.get(name, name)}{equals}{value}")
    return current


def _overview(argv: Sequence[str]) -> NoReturn:
    """Write the list of commands, or an error for an unknown command, and exit."""
    begun = [word for word in argv[:1] if any(name.startswith(f"{word} ") for name in COMMANDS)]
    rest = argv[len(begun) :]
    commands = {name: run for name, run in COMMANDS.items() if name.split()[: len(begun)] == begun}
    if not rest or rest[0] not in ("-h", "--help"):
        command = " ".join([*begun, *rest[:1]])
        problem = f"There is no command {command!r}." if rest else "A command is missing."
        print_message(f"{PROGRAM}: {problem} The commands are: {', '.join(commands)}.")
        raise SystemExit(2)
    width = max(map(len, commands))
    lines = [
        f"{name:<{width}}  {(does.__doc__ or '').split('.')[0]}." for name, does in commands.items()
    ]
    head = f"{text.TAGLINE}\n\n{PROGRAM} COMMAND --help lists the options of a command.\n\n"
    sys.stdout.write(head + "\n".join(" ".join(line.split("\n")) for line in lines) + "\n")
    raise SystemExit(0)


def _interrupt(number: int, frame: object) -> None:
    raise KeyboardInterrupt
