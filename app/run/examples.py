"""What is made without a network: a motion with a tremble, two minutes with planted faults."""

from __future__ import annotations

import hashlib
import json
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from app.config import EXAMPLES
from app.run.body_motion import picture_motions
from app.run.followed_point import TIP, choose_tip_source
from app.run.models import get_body
from app.run.output.result_folder import ResultFolder
from app.run.output.run_folder import SPEECH, RunRecord
from app.run.requests.request import Ask, OnEvent, ShouldCancel
from app.run.run_writer import RunWriter
from conventions.names import file_stem
from model.speech.transcript import NOTHING_SAID

if TYPE_CHECKING:
    from collections.abc import Callable

    from model.motion.motion import Motion


CLEAN = EXAMPLES / "procedural_speaker" / "a_procedural_speaker.npz"
"""14 s of motion."""
TWO_MINUTES = EXAMPLES / "two_minutes" / "two_minutes.npz"
FAULTY = "a system with faults"
NOISE_RAD = 0.012
SLIDE_M, SLIDE_S = 0.35, 2.5
"""How far feet slide to the side and back, and how long one way takes."""
JUMP_RAD, JUMP_EVERY = 0.06, 52
"""Of every joint, where windows of 60 frames join."""
FLOAT_M, FLOAT_RISE_S = 0.08, 0.5
CALMER = 0.9


RECORDED = "recorded"


def planted_files(folder: Path) -> list[str]:
    """The motion with faults, which is made once, and its reference, speech and transcript."""
    from model.motion.motion import load_motion, save_motion

    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{FAULTY}.npz"
    if not path.is_file():
        save_motion(with_faults(load_motion(TWO_MINUTES)), path)
        shutil.copyfile(TWO_MINUTES, folder / f"{RECORDED}.npz")
    speech, transcript = (TWO_MINUTES.with_suffix(ending) for ending in (".ogg", ".TextGrid"))
    return [str(each) for each in (path, folder / f"{RECORDED}.npz", speech, transcript)]


def with_faults(motion: Motion) -> Motion:
    """All of `PLANTS`, each in its seconds; the face is a calmer one all the while, or it would be
    found to be copied, which is not what is shown."""
    from conventions.rates import FPS

    faulty = replace(motion, expressions=(CALMER * motion.expressions).astype("float32"))
    for plant in PLANTS:
        span = slice(round(plant.from_s * FPS), round(plant.to_s * FPS))
        part = plant.change(faulty.part(span))
        poses, trans = faulty.poses.copy(), faulty.trans.copy()
        poses[span], trans[span] = part.poses, part.trans
        faulty = replace(faulty, poses=poses, trans=trans)
    return faulty


def tremble(motion: Motion) -> Motion:
    """White noise on the rotations of the right arm, `NOISE_RAD` about each axis."""
    import numpy as np

    from conventions.joints import JOINT_INDEX

    joints = motion.poses.reshape(len(motion.poses), -1, 3).copy()
    arm = [JOINT_INDEX[f"right_{name}"] for name in ("shoulder", "elbow", "wrist")]
    noise = np.random.default_rng(0).standard_normal((len(joints), len(arm), 3))
    joints[:, arm] += NOISE_RAD * noise
    return replace(motion, poses=joints.reshape(motion.poses.shape).astype(np.float32))


def slide(motion: Motion) -> Motion:
    """Feet that stand glide to the side and back."""
    import numpy as np

    from conventions.rates import FPS

    trans = motion.trans.copy()
    way = np.arange(len(trans)) / FPS * np.pi / SLIDE_S
    trans[:, 0] += SLIDE_M * (1.0 - np.cos(way)) / 2.0
    return replace(motion, trans=trans)


def join(motion: Motion) -> Motion:
    """All joints jump, and back, where windows would meet."""
    import numpy as np

    joints = motion.poses.reshape(len(motion.poses), -1, 3).copy()
    is_odd = np.arange(len(joints)) // JUMP_EVERY % 2
    joints[:, 1:, 0] += JUMP_RAD * is_odd[:, None]
    return replace(motion, poses=joints.reshape(motion.poses.shape).astype(np.float32))


def freeze(motion: Motion) -> Motion:
    """Nothing moves."""
    poses, trans = motion.poses.copy(), motion.trans.copy()
    poses[:], trans[:] = poses[0], trans[0]
    return replace(motion, poses=poses, trans=trans)


def lift(motion: Motion) -> Motion:
    """The body leaves the floor by `FLOAT_M`, and comes back to it."""
    import numpy as np

    from conventions.rates import FPS

    trans = motion.trans.copy()
    since = np.arange(len(trans)) / FPS
    rise = np.minimum(np.minimum(since, since[::-1]) / FLOAT_RISE_S, 1.0)
    trans[:, 1] += FLOAT_M * rise**2 * (3.0 - 2.0 * rise)
    return replace(motion, trans=trans)


@dataclass(frozen=True)
class Plant:
    """A fault, and the seconds that it is planted in."""

    name: str
    change: Callable[[Motion], Motion]
    from_s: float
    to_s: float


PLANTS = (
    Plant("sliding feet", slide, 4, 114),
    Plant("trembling right arm", tremble, 20, 100),
    Plant("joins every 52 frames", join, 50, 86),
    Plant("nothing moves", freeze, 90.25, 92.75),
    Plant("floating", lift, 100, 108),
)
"""Longer where a fault counts by the mean or the median of all frames."""


STEADY, TREMBLING = "A", "B"
LOOK_S = 6.7
"""Of the speech, to a pause: whoever opens the page first waits for each second of it."""
FORMAT = 4
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
    weights: Path

    @property
    def beginning(self) -> Path:
        """What is played: the first `LOOK_S` of the speech."""
        return self.folder / SPEECH

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
    return FirstLook(kept / "first-look" / key.hexdigest()[:16], speech, system, weights)


def take_stored(look: FirstLook, stored: Path = STORED) -> bool:
    """Copy it from where it lies made by these very weights, of this very speech; whether it
    does."""
    beside = stored / look.folder.name
    if not (beside / FACTS).is_file():
        return False
    look.folder.parent.mkdir(parents=True, exist_ok=True)
    with ResultFolder(look.folder) as folder:
        for path in sorted(beside.rglob("*")):
            if path.is_file():
                shutil.copyfile(path, folder.path(path.relative_to(beside).as_posix()))
        folder.publish()
    return True


def make_first_look(
    look: FirstLook,
    on_event: OnEvent = lambda event: None,
    should_cancel: ShouldCancel = lambda: False,
) -> None:
    """Generate and plant; leaves the whole folder or nothing.

    Raises:
        CancelledRun: when ``should_cancel`` said so.
        RunError, SpeechError: each with one sentence.
    """
    from app.run.pipeline import do
    from conventions.rates import SAMPLE_RATE
    from model.measures.smoothness import derivative_magnitudes
    from model.motion.motion import load_motion
    from model.speech.audio import load_speech, write_wav

    tip = choose_tip_source(get_body(None), None)
    look.folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as temporary:
        beginning = Path(temporary, SPEECH)
        waveform = load_speech(look.speech).waveform
        write_wav(beginning, waveform[: round(SAMPLE_RATE * LOOK_S)])
        speech = load_speech(beginning)
        ask = Ask(
            speech=beginning,
            out=Path(temporary, "run"),
            weights=look.weights,
            systems=(look.system,),
            has_figures=False,
        )
        result = do(ask, on_event, should_cancel)
        motion = load_motion(result.out / f"{file_stem(look.system)}.npz")
        provenance = json.loads((result.out / "provenance.json").read_text())
    motions: dict[str, Motion] = {STEADY: motion, TREMBLING: tremble(motion)}
    record = RunRecord(kind="given", point=TIP)
    with ResultFolder(look.folder) as folder, RunWriter(folder, record) as run:
        jerk = {
            name: round(float(derivative_magnitudes(tip.track(each), 3).mean()))
            for name, each in motions.items()
        }
        shown = picture_motions(motions).motions
        run.timeline(run.show(shown, speech, tip, look.weights), NOTHING_SAID)
        run.find_plans(shown)
        facts = {"jerk_m_s3": jerk, "noise_rad": NOISE_RAD, "provenance": provenance}
        path = folder.path(FACTS)
        path.write_text(json.dumps(facts, indent=1) + "\n")
        run.file("numbers", path.stem, path)
        run.finish("")
