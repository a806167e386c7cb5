"""Bodies that play in a cell: the page's player, with all that it needs, in one file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory

from app.notebook.inputs import (
    MotionLike,
    SpeechLike,
    named_motions,
    read_motion,
    read_speech,
)
from app.page.alone import player_alone
from app.run.followed_point import TIP, choose_tip_source
from app.run.models import get_body
from app.run.output.result_folder import ResultFolder
from app.run.output.run_folder import RunRecord
from app.run.run_writer import RunWriter
from conventions.names import REFERENCE_NAME
from model.speech.transcript import NOTHING_SAID
from model.storage.files import written_atomically

HEIGHT_PX = 880


@dataclass(frozen=True, eq=False, repr=False)
class Player:
    """A cell shows it; `save` keeps it as a file for any browser, about 3 MB and 50 kB a second of
    each body."""

    html: str
    height: int = HEIGHT_PX
    """Of the cell, in pixels."""

    def save(self, path: str | Path) -> Path:
        """Write it whole or not at all.

        Raises:
            WriteError: with the reason.
        """
        with written_atomically(Path(path)) as part:
            part.write_text(self.html, encoding="utf-8")
        return Path(path)

    def __repr__(self) -> str:
        return f"Player({len(self.html) / 1e6:.1f} MB)"

    def _repr_html_(self) -> str:
        return (
            f'<iframe srcdoc="{escape(self.html)}" sandbox="allow-scripts allow-same-origin" '
            f'style="width: 100%; height: {self.height}px; border: 0"></iframe>'
        )


def show(
    motions: MotionLike | Mapping[str, MotionLike],
    speech: SpeechLike | None = None,
    *,
    reference: MotionLike | None = None,
    joint: str = TIP,
    height: int = HEIGHT_PX,
) -> Player:
    """Motions in lock-step under the sound, with the stage's displays and the time line.

    Args:
        motions: one, or several by name; or the folder of a run, or of those of several clips,
            which is shown as it is.
        joint: whose jerk and speed the time line shows.

    Raises:
        ValueError: of what cannot be shown, with one sentence.
    """
    if isinstance(motions, str | Path) and Path(motions).is_dir():
        return Player(player_alone(Path(motions)), height)
    named = named_motions(motions)
    if reference is not None:
        named[REFERENCE_NAME] = read_motion(reference)
    heard = None if speech is None else read_speech(speech)
    tip = choose_tip_source(get_body(None), None, joint)
    record = RunRecord(kind="given", title="Co-speech motion", point=joint)
    with TemporaryDirectory() as folder:
        with ResultFolder(Path(folder), is_kept=True) as results:
            run = RunWriter(results, record)
            run.timeline(run.show(named, heard, tip), NOTHING_SAID)
            run.finish("")
        return Player(player_alone(Path(folder)), height)
