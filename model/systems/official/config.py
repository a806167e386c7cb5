"""Family of the authors' checkpoints (`model.systems.official.checkpoints`); needs no torch."""

from dataclasses import dataclass
from pathlib import Path

from model.generation.family import Family, FileCheck, FileFlag
from model.sampling.samplers import make_samplers
from model.storage.cards import WeightsCard, load_card
from model.systems.official.checkpoints import (
    FOLDER_VARIABLE,
    OFFICIAL_NETWORKS,
    SEED_VARIABLE,
    SPEECH_VARIABLE,
    official_file,
    official_folder,
    require_speech_model_or_features,
)

FILTERED = "official/authors"
UNFILTERED = "official/authors-unfiltered"
SPEAKERS = {
    "wayne": 1, "scott": 2, "solomon": 3, "lawrence": 4, "stewart": 5, "carla": 6, "sophie": 7,
    "miranda": 9, "kieks": 10, "nidal": 11, "zhao": 12, "lu": 13, "carlos": 15, "jorge": 16,
    "itoi": 17, "daiki": 18, "li": 20, "ayana": 21, "luqi": 22, "hailing": 23, "kexin": 24,
    "goto": 25, "yingqing": 27, "tiffnay": 28, "katya": 30,
}  # fmt: skip
"""BEAT2's speakers by number; 0 means no speaker, which is one time in ten in training."""


@dataclass(frozen=True)
class OfficialFamily(Family):
    """Family with weights in a separate folder that are not trained here."""

    @property
    def trainable_networks(self) -> tuple[str, ...]:
        """Names of networks that this project trains: none."""
        return ()

    def available_systems(self, folder: Path) -> tuple[str, ...]:
        """Return both systems if a folder is named, even if files are missing in it."""
        return () if official_folder() is None else self.systems

    def require_files(self) -> None:
        """Check the named files (`Family.require_files`)."""
        if official_folder() is not None:
            for part in OFFICIAL_NETWORKS:
                official_file(part)
            require_speech_model_or_features()

    def one_recording_only_reason(self) -> str | None:
        """Return that prepared features are of one speech; None without them."""
        if official_folder() is None or not require_speech_model_or_features().is_file():
            return None
        return (
            "prepared features belong to one recording; name a folder of WavLM or HuBERT with "
            "--official-features DIR."
        )

    def non_redistributable_paths(self) -> tuple[Path, ...]:
        """Return the folder of the checkpoints."""
        folder = official_folder()
        return () if folder is None else (folder,)

    def check_files(self) -> tuple[FileCheck, ...]:
        """Check each network and their speech model."""
        from model.systems.official.networks import check_official_files

        folder = official_folder()
        return () if folder is None else tuple(check_official_files(folder))

    def card(self, name: str, folder: Path) -> WeightsCard:
        """Make a card from the checkpoints' names; other systems' speakers are number 0."""
        motion = official_file("motion")
        content = {
            "system": name,
            "speakers": SPEAKERS | {name: 0 for name in _speakers_in(folder)},
            "training_data": f"the training data of the authors' checkpoint {motion.name}",
            "weights_are": f"the authors' checkpoint {motion.name}, run by this project's code",
        }
        return WeightsCard(content, name)


def _speakers_in(folder: Path) -> list[str]:
    """Return the speakers of the other systems of a folder."""
    cards = [load_card(folder, path.stem) for path in sorted(folder.glob("*.safetensors"))]
    names = [str(name) for card in cards for name in card.get("speakers", {})]
    return [name for name in dict.fromkeys(names) if name not in SPEAKERS]


FAMILY = OfficialFamily(
    name="official",
    title="GlobalDiff by its authors",
    systems=(FILTERED, UNFILTERED),
    descriptions={
        FILTERED: "The authors' checkpoint as their script runs it, each window smoothed.",
        UNFILTERED: "The authors' checkpoint without smoothing: the raw output.",
    },
    samplers=dict.fromkeys(
        (FILTERED, UNFILTERED),
        make_samplers("reinterpolate", steps=5),
    ),
    presets=lambda system: {},
    package="model.systems.official",
    display_order=5,
    offline_only=(FILTERED, UNFILTERED),
    files_title="Official GlobalDiff, the authors' code (docs/official.md)",
    files=(
        FileFlag(
            "--official", FOLDER_VARIABLE, "FOLDER",
            "Folder with checkpoints of the official code; adds the systems official/... (default: "
            f"${FOLDER_VARIABLE})",
        ),
        FileFlag(
            "--official-features", SPEECH_VARIABLE, "PATH",
            "Folder of the authors' speech encoder (WavLM or HuBERT), or prepared features of your "
            f"speech (.npz or .npy; default: ${SPEECH_VARIABLE}, else $WAVLM_DIR)",
        ),
        FileFlag(
            "--official-seed", SEED_VARIABLE, "MOTION.npz",
            "Motion whose first 8 frames are the seed pose of the systems official/... (default: "
            f"${SEED_VARIABLE}, else a standing pose)",
        ),
    ),
)  # fmt: skip
