"""Files and sizes of the authors' checkpoints (Xiangyue-Zhang/GlobalDiff); needs no torch.

Nothing of theirs is bundled: the networks are reimplemented, and tests check that they are equal.
The folder is the one of their code that holds the checkpoints (``ckpt``), or any other with the
files in it under the names that their scripts use; ``docs/official.md`` lists the known names.
"""

import os
import re
from pathlib import Path
from typing import Literal, get_args

from model.speech.encoder import WEIGHTS_VARIABLE, EncoderError
from model.storage.cards import CheckpointError

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

OfficialNetwork = Literal["motion", "expression"]
OFFICIAL_NETWORKS: tuple[OfficialNetwork, ...] = get_args(OfficialNetwork)
FOLDER_VARIABLE = "OFFICIAL_DIR"
SPEECH_VARIABLE = "OFFICIAL_FEATURES"
SEED_VARIABLE = "OFFICIAL_SEED"
_ENDING = r"/[^/]*\.(pt|pth|bin|ckpt|zip)"
_NAMES: dict[OfficialNetwork, re.Pattern[str]] = {
    "motion": re.compile(rf".*/(epoch_\d+|DiffusionDIT[^/]*{_ENDING})", re.IGNORECASE),
    "expression": re.compile(rf"(.*/)?[^/]*(speech|expression)[^/]*{_ENDING}", re.IGNORECASE),
}
"""Patterns of the files' names with their folders, in the order in which they are tried."""
_CALLED: dict[OfficialNetwork, tuple[str, str]] = {
    "motion": ("motion network", "epoch_<n>, or DiffusionDIT.../best.pt"),
    "expression": ("expression model", "SimpleSpeechModel/best.pt"),
}


def official_folder() -> Path | None:
    """Return the folder in ``OFFICIAL_DIR``, None if unset; raises CheckpointError if missing."""
    named = os.environ.get(FOLDER_VARIABLE)
    if named and not Path(named).is_dir():
        raise CheckpointError(
            f"There is no folder {named}; name the one that holds the authors' checkpoints with "
            "--official FOLDER."
        )
    return Path(named) if named else None


def official_file(part: OfficialNetwork) -> Path:
    """Return a network's best or else last checkpoint; raises CheckpointError if none."""
    folder = official_folder()
    if folder is None:
        raise CheckpointError(
            "The systems official/... need the GlobalDiff authors' checkpoints; give the folder "
            "with --official FOLDER."
        )
    there = (path for path in sorted(folder.rglob("*")) if path.is_file())
    own = [path for path in there if network_by_file_name(path.relative_to(folder.parent)) == part]
    if not own:
        what, called = _CALLED[part]
        raise CheckpointError(f"{folder} holds no file of the {what}; put it there as {called}.")
    return max(own, key=_rank)


def network_by_file_name(path: Path) -> OfficialNetwork | None:
    """Return the network of a file, by its name and its folder's."""
    named = f"/{path.as_posix()}"
    return next((part for part, names in _NAMES.items() if names.fullmatch(named)), None)


def require_speech_model_or_features() -> Path:
    """Return the folder of a speech model or file of features; raises EncoderError."""
    named = os.environ.get(SPEECH_VARIABLE) or os.environ.get(WEIGHTS_VARIABLE)
    path = Path(named) if named else None
    if path is None or not path.exists():
        problem = "none was named" if path is None else f"there is no {path}"
        raise EncoderError(
            "The systems official/... need speech features of WavLM or HuBERT; name a folder with "
            "config.json and weights, or a file of prepared features, with --official-features "
            f"PATH ({problem})."
        )
    return path


def _rank(path: Path) -> tuple[bool, int]:
    epoch = path.name.lower().removeprefix("epoch_")
    return path.stem.lower() == "best", int(epoch) if epoch.isdigit() else -1
