"""What a fresh page shows first, in ``examples/first_look``: made with the bundled weights.
``python -m tests.app.run.made_first_look`` makes it anew."""

import shutil
from pathlib import Path

from app.config import BUNDLED_WEIGHTS, EXAMPLES
from app.page.player.first_look_shown import EXAMPLE
from app.run.examples import STORED, FirstLook, first_look, make_first_look
from model.systems.registry import usual_systems


def look_in(kept: Path) -> FirstLook:
    """As the page asks for it, kept in a folder."""
    speech = EXAMPLES / f"{EXAMPLE}.wav"
    return first_look(kept, BUNDLED_WEIGHTS, usual_systems("first-look")[0], speech)


if __name__ == "__main__":
    shutil.rmtree(STORED, ignore_errors=True)
    look = look_in(STORED)
    make_first_look(look)
    look.folder.rename(STORED / look.folder.name)
    look.folder.parent.rmdir()
