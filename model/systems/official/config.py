"""Nothing of the authors' checkpoints is bundled. The networks are written anew; equality with the
authors' code is held by the tests.
"""

from dataclasses import dataclass
from pathlib import Path

from model.generation.family import Family, FileFlag, FileReport
from model.sampling.samplers import SAMPLER_TITLES, Sampler
from model.storage.cards import Card, load_card
from model.systems.official.files import (
    FOLDER_VARIABLE,
    PARTS,
    SEED_VARIABLE,
    SPEECH_VARIABLE,
    official_file,
    official_folder,
    require_speech,
)

FILTERED = "official/authors"
UNFILTERED = "official/authors-unfiltered"
SPEAKERS = {
    "wayne": 1, "scott": 2, "solomon": 3, "lawrence": 4, "stewart": 5, "carla": 6, "sophie": 7,
    "miranda": 9, "kieks": 10, "nidal": 11, "zhao": 12, "lu": 13, "carlos": 15, "jorge": 16,
    "itoi": 17, "daiki": 18, "li": 20, "ayana": 21, "luqi": 22, "hailing": 23, "kexin": 24,
    "goto": 25, "yingqing": 27, "tiffnay": 28, "katya": 30,
}  # fmt: skip
"""BEAT2's, by their numbers; 0 is no speaker, which training shows one time in ten."""


@dataclass(frozen=True)
class OfficialFamily(Family):
    """Its weights lie in a folder of their own, and are not trained here."""

    @property
    def trained(self) -> tuple[str, ...]:
        """Nothing."""
        return ()

    def systems_in(self, folder: Path) -> tuple[str, ...]:
        """Both systems, where a folder was named; what it lacks is told when they are read."""
        return () if official_folder() is None else self.systems

    def require_files(self) -> None:
        """See `Family.require_files`."""
        if official_folder() is not None:
            for part in PARTS:
                official_file(part)
            require_speech()

    def why_not_on_page(self) -> str | None:
        """Prepared features are of one speech."""
        if official_folder() is None or not require_speech().is_file():
            return None
        return (
            "The page cannot use prepared features, which are of one speech; name a folder of "
            "WavLM or HuBERT with --official-features DIR."
        )

    def private_paths(self) -> tuple[Path, ...]:
        """The folder of the checkpoints."""
        folder = official_folder()
        return () if folder is None else (folder,)

    def file_reports(self) -> tuple[FileReport, ...]:
        """Of each network, and of what hears for them."""
        from model.systems.official.networks import reports_of

        folder = official_folder()
        return () if folder is None else tuple(reports_of(folder))

    def card(self, name: str, folder: Path) -> Card:
        """What is known of the checkpoints, from their names. Speakers of the other systems are
        no speaker to these."""
        motion = official_file("motion")
        content = {
            "system": name,
            "speakers": SPEAKERS | {name: 0 for name in _speakers_in(folder)},
            "training_data": f"what the authors' checkpoint {motion.name} was trained on",
            "weights_are": f"the authors' checkpoint {motion.name}, run by this project's code",
        }
        return Card(content, name)


def _speakers_in(folder: Path) -> list[str]:
    """Speakers that other systems of a folder know."""
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
        (Sampler("reinterpolate", 5, title=SAMPLER_TITLES["reinterpolate"]),),
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
