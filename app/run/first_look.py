"""What stands on the page before the first run: one motion twice, with a tremble on one arm."""

from __future__ import annotations

import hashlib
import json
import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from app.config import EXAMPLES
from app.run.followed_point import choose_tip_source
from app.run.models import get_body
from app.run.output.result_folder import ResultFolder
from app.run.planted import NOISE_RAD, tremble
from app.run.requests.request import GenerateRequest
from app.run.videos.own_videos import picture_motions
from conventions.names import file_stem

if TYPE_CHECKING:
    from collections.abc import Callable

    from model.motion.motion import Motion

STEADY, TREMBLING = "A", "B"
LOOK_S = 6.7
"""Of the speech, to a pause: whoever opens the page first waits for each second of it."""
FORMAT = 3
"""Of what is kept; another number makes it anew."""
FACTS = "first_look.json"
STORED = EXAMPLES / "first_look"
"""What `python -m tests.app.run.made_first_look` has made with the bundled weights, so that a fresh
page need not wait for a model to be read; a test holds it against what they make."""


@dataclass(frozen=True)
class FirstLook:
    """Where the example lies, and what is known of it."""

    folder: Path
    speech: Path
    system: str

    @property
    def beginning(self) -> Path:
        """What is played: the first `LOOK_S` of the speech."""
        return self.folder / "beginning.wav"

    @property
    def is_made(self) -> bool:
        return (self.folder / FACTS).is_file()

    def facts(self) -> dict:
        """Jerk of both fingertips in m/s^3 by row, the noise, and where the motion comes from."""
        return json.loads((self.folder / FACTS).read_text())


def first_look(kept: Path, weights: Path, system: str, speech: Path) -> FirstLook:
    """Where it is kept: outside of the repository, apart for each state of weights and speech."""
    key = hashlib.sha256(f"{FORMAT} {system} {NOISE_RAD}".encode())
    key.update((weights / f"{file_stem(system)}.json").read_bytes())
    key.update(speech.read_bytes())
    return FirstLook(kept / "first-look" / key.hexdigest()[:16], speech, system)


def take_stored(look: FirstLook, stored: Path = STORED) -> bool:
    """Copy it from where it lies made by these very weights, of this very speech; whether it
    does."""
    beside = stored / look.folder.name
    if not (beside / FACTS).is_file():
        return False
    look.folder.parent.mkdir(parents=True, exist_ok=True)
    with ResultFolder(look.folder) as folder:
        for path in sorted(beside.iterdir()):
            shutil.copyfile(path, folder.path(path.name))
        folder.publish()
    return True


def make_first_look(
    look: FirstLook, weights: Path, on_share: Callable[[float], None] = lambda share: None
) -> None:
    """Generate and plant; leaves the whole folder or nothing.

    Args:
        on_share: told of the share done; what it raises ends the work.

    Raises:
        RunError, SpeechError: each with one sentence.
    """
    from app.run.pipeline import generate_all
    from model.measures.smoothness import derivative_magnitudes
    from model.motion.motion import load_motion, save_motion
    from model.speech.audio import SAMPLE_RATE, load_speech, write_wav

    tip = choose_tip_source(get_body(None), None)
    look.folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as temporary:
        beginning = Path(temporary, look.beginning.name)
        waveform = load_speech(look.speech).waveform
        write_wav(beginning, waveform[: round(SAMPLE_RATE * LOOK_S)])
        request = GenerateRequest(
            *(beginning, Path(temporary, "run"), weights),
            systems=(look.system,),
            has_video=False,
            has_figures=False,
        )
        result = generate_all(request, lambda event: on_share(0.0))
        motion = load_motion(result.out / f"{file_stem(look.system)}.npz")
        provenance = json.loads((result.out / "provenance.json").read_text())
        sound = beginning.read_bytes()
    motions: dict[str, Motion] = {STEADY: motion, TREMBLING: tremble(motion)}
    with ResultFolder(look.folder) as folder:
        jerk = {
            name: round(float(derivative_magnitudes(tip.track(each), 3).mean()))
            for name, each in motions.items()
        }
        for name, each in picture_motions(motions).motions.items():
            save_motion(each, folder.path(f"{name}.npz"))
        folder.path(look.beginning.name).write_bytes(sound)
        facts = {"jerk_m_s3": jerk, "noise_rad": NOISE_RAD, "provenance": provenance}
        folder.path(FACTS).write_text(json.dumps(facts, indent=1) + "\n")
        folder.publish()
