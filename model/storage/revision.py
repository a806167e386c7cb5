"""Git revision of the code that made a result or trained weights."""

import subprocess
from pathlib import Path


def revision() -> str:
    """Return the Git revision, with ``+`` for changes in tracked files; "unknown" without Git."""
    root = Path(__file__).parent

    def git(*command: str) -> str:
        return subprocess.run(
            ["git", "-C", str(root), *command], capture_output=True, text=True, check=True
        ).stdout.strip()

    try:
        changed = git("status", "--porcelain", "--untracked-files=no")
        return git("rev-parse", "--short", "HEAD") + ("+" if changed else "")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
