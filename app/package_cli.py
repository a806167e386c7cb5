"""Command line of the installed package, as ``co_speech_motion/__main__.py``.

A checkout has ``python -m app`` instead. Installed at the top level, ``app``, ``model`` and the
other roots would be visible to every other program of the environment. So they lie in one folder,
which only this program and its children search.
"""

import runpy
import sys
from pathlib import Path

PROGRAM = "co-speech-motion"
MODULES = {
    "bench": "app.bench",
    "corpus": "tools.corpus",
    "train": "model.train",
    "evaluate": "model.evaluate",
}
"""Commands that run a module each; all others but ``page`` are commands of ``python -m app``."""


def main() -> int:
    """Run one command; without a command, write the list of commands."""
    sys.path.insert(0, str(Path(__file__).resolve().parent))
    word = sys.argv[1] if len(sys.argv) > 1 else ""
    if word == "page":
        from app.page.launch import main as serve

        serve(sys.argv[2:])
        return 0
    if word in MODULES:
        sys.argv[:2] = [f"{PROGRAM} {word}"]
        runpy.run_module(MODULES[word], run_name="__main__", alter_sys=True)
        return 0
    from app.commands.cli import main as command

    if word in ("", "-h", "--help"):
        sys.stdout.write(
            f"{PROGRAM} page [...]               opens the page; page --help lists its options\n"
            f"{PROGRAM} corpus|train|evaluate    same as python -m tools.corpus, model.train or "
            "model.evaluate\n\n"
        )
    return command(sys.argv[1:] or ["--help"])


if __name__ == "__main__":
    sys.exit(main())
