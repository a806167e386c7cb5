"""Files, sizes and family of the authors' checkpoints (Xiangyue-Zhang/GlobalDiff); needs no torch.

Nothing of theirs is bundled: the networks are reimplemented, and tests check that they are equal.
The folder is the one of their code that holds the checkpoints (``ckpt``), or any other with the
files in it under the names that their scripts use; ``docs/official.md`` lists the known names.
"""

import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

from model.generation.family import Family, FileFlag, FileReport
from model.sampling.samplers import titled
from model.speech.encoder import WEIGHTS_VARIABLE, EncoderError
from model.storage.cards import Card, CheckpointError, load_card

SPEECH_DIM = 1024
EXPRESSION_DIM = 100
MOTION_DIM = 333
"""Channels of a frame: 55 joints of 6 numbers, then the translation."""
NUM_SPEAKERS = 31
SPEAKER_DIM = 64
WINDOW_FRAMES = 60
SEED_FRAMES = 8

_TORSO = (3, 6, 9, *range(12, 22))
_LEGS = (0, 1, 2, 4, 5, 7, 8, 10, 11)
_HEAD = (22, 23, 24)
_FINGERS = tuple(range(25, 55))


def _channels(joints: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(6 * joint + k for joint in joints for k in range(6))


HAND_CHANNELS = _channels(_FINGERS)
BODY_CHANNELS = (*_channels((*_TORSO, *_LEGS)), 330, 331, 332, *_channels(_HEAD))
"""Channels in the order of the body branch, with the translation between legs and head."""

Part = Literal["motion", "expression"]
PARTS: tuple[Part, ...] = get_args(Part)
FOLDER_VARIABLE = "OFFICIAL_DIR"
SPEECH_VARIABLE = "OFFICIAL_FEATURES"
SEED_VARIABLE = "OFFICIAL_SEED"
_ENDING = r"/[^/]*\.(pt|pth|bin|ckpt|zip)"
_NAMES: dict[Part, re.Pattern[str]] = {
    "motion": re.compile(rf".*/(epoch_\d+|DiffusionDIT[^/]*{_ENDING})", re.IGNORECASE),
    "expression": re.compile(rf"(.*/)?[^/]*(speech|expression)[^/]*{_ENDING}", re.IGNORECASE),
}
"""Patterns of the files' names with their folders, in the order in which they are tried."""
_CALLED: dict[Part, tuple[str, str]] = {
    "motion": ("motion network", "epoch_<n>, or DiffusionDIT.../best.pt"),
    "expression": ("expression model", "SimpleSpeechModel/best.pt"),
}


def official_folder() -> Path | None:
    """Return the folder that ``OFFICIAL_DIR`` names; None if none is named.

    Raises:
        CheckpointError: if it does not exist.
    """
    named = os.environ.get(FOLDER_VARIABLE)
    if named and not Path(named).is_dir():
        raise CheckpointError(
            f"There is no folder {named}; name the one that holds the authors' checkpoints with "
            "--official FOLDER."
        )
    return Path(named) if named else None


def official_file(part: Part) -> Path:
    """Return the checkpoint of a network: the one called best, else the last epoch's.

    Raises:
        CheckpointError: if there is none.
    """
    folder = official_folder()
    if folder is None:
        raise CheckpointError(
            "The systems official/... need the authors' checkpoints; name their folder with "
            "--official FOLDER."
        )
    there = (path for path in sorted(folder.rglob("*")) if path.is_file())
    own = [path for path in there if part_of(path.relative_to(folder.parent)) == part]
    if not own:
        what, called = _CALLED[part]
        raise CheckpointError(f"{folder} holds no file of the {what}; put it there as {called}.")
    return max(own, key=_rank)


def part_of(path: Path) -> Part | None:
    """Return the network of a file, by its name and its folder's."""
    named = f"/{path.as_posix()}"
    return next((part for part, names in _NAMES.items() if names.fullmatch(named)), None)


def require_speech() -> Path:
    """Return the folder of a speech model, or the file of features, that the networks need.

    Raises:
        EncoderError: if neither is named or exists.
    """
    named = os.environ.get(SPEECH_VARIABLE) or os.environ.get(WEIGHTS_VARIABLE)
    path = Path(named) if named else None
    if path is None or not path.exists():
        found = "none was named" if path is None else f"there is no {path}"
        raise EncoderError(
            "The systems official/... hear speech by WavLM or HuBERT; name a folder with its "
            f"config.json and weights, or a file of prepared features, with --official-features "
            f"PATH ({found})."
        )
    return path


def _rank(path: Path) -> tuple[bool, int]:
    epoch = path.name.lower().removeprefix("epoch_")
    return path.stem.lower() == "best", int(epoch) if epoch.isdigit() else -1


FILTERED = "official/authors"
UNFILTERED = "official/authors-unfiltered"
SPEAKERS = {
    "wayne": 1, "scott": 2, "solomon": 3, "lawrence": 4, "stewart": 5, "carla": 6, "sophie": 7,
    "miranda": 9, "kieks": 10, "nidal": 11, "zhao": 12, "lu": 13, "carlos": 15, "jorge": 16,
    "itoi": 17, "daiki": 18, "li": 20, "ayana": 21, "luqi": 22, "hailing": 23, "kexin": 24,
    "goto": 25, "yingqing": 27, "tiffnay": 28, "katya": 30,
}  # fmt: skip
"""BEAT2's speakers by number; 0 is no speaker, which is one time in ten in training."""


@dataclass(frozen=True)
class OfficialFamily(Family):
    """Family with weights in a separate folder that are not trained here."""

    @property
    def trained(self) -> tuple[str, ...]:
        """Names of trained networks: none."""
        return ()

    def systems_in(self, folder: Path) -> tuple[str, ...]:
        """Return both systems if a folder was named; reading them reports missing files."""
        return () if official_folder() is None else self.systems

    def require_files(self) -> None:
        """Check the named files (`Family.require_files`)."""
        if official_folder() is not None:
            for part in PARTS:
                official_file(part)
            require_speech()

    def why_not_on_page(self) -> str | None:
        """Return why prepared features, which are of one speech, cannot be used; otherwise None."""
        if official_folder() is None or not require_speech().is_file():
            return None
        return (
            "The page cannot use prepared features, which are of one speech; name a folder of "
            "WavLM or HuBERT with --official-features DIR."
        )

    def private_paths(self) -> tuple[Path, ...]:
        """Return the folder of the checkpoints."""
        folder = official_folder()
        return () if folder is None else (folder,)

    def file_reports(self) -> tuple[FileReport, ...]:
        """Check each network and their speech model."""
        from model.systems.official.networks import reports_of

        folder = official_folder()
        return () if folder is None else tuple(reports_of(folder))

    def card(self, name: str, folder: Path) -> Card:
        """Make a card from the checkpoints' names; other systems' speakers are number 0."""
        motion = official_file("motion")
        content = {
            "system": name,
            "speakers": SPEAKERS | {name: 0 for name in _speakers_in(folder)},
            "training_data": f"what the authors' checkpoint {motion.name} was trained on",
            "weights_are": f"the authors' checkpoint {motion.name}, run by this project's code",
        }
        return Card(content, name)


def _speakers_in(folder: Path) -> list[str]:
    """Return the speakers of the other systems of a folder."""
    cards = [load_card(folder, path.stem) for path in sorted(folder.glob("*.safetensors"))]
    names = [str(name) for card in cards for name in card.get("speakers", {})]
    return [name for name in dict.fromkeys(names) if name not in SPEAKERS]


FAMILY = OfficialFamily(
    name="official",
    title="GlobalDiff by its authors",
    systems=(FILTERED, UNFILTERED),
    about={
        FILTERED: "The authors' checkpoint as their script runs it, each window smoothed.",
        UNFILTERED: "The same checkpoint without the smoothing: what it really makes.",
    },
    samplers=dict.fromkeys(
        (FILTERED, UNFILTERED),
        titled("reinterpolate", steps=5),
    ),
    presets=lambda system: {},
    package="model.systems.official",
    place=5,
    whole_speech=(FILTERED, UNFILTERED),
    shared_weights={UNFILTERED: FILTERED},
    files_title="GlobalDiff by its authors (docs/official.md)",
    files=(
        FileFlag(
            "--official", FOLDER_VARIABLE, "FOLDER",
            "of checkpoints of the official code: adds the systems official/... (default: "
            f"${FOLDER_VARIABLE})",
        ),
        FileFlag(
            "--official-features", SPEECH_VARIABLE, "PATH",
            "a folder of WavLM or HuBERT by which they hear, or features of this speech, .npz or "
            f".npy (default: ${SPEECH_VARIABLE}, else $WAVLM_DIR)",
        ),
        FileFlag(
            "--official-seed", SEED_VARIABLE, "MOTION.npz",
            f"motion with whose first 8 frames they start (default: ${SEED_VARIABLE}, else "
            "somebody who stands still)",
        ),
    ),
)  # fmt: skip
