"""Families of systems: generators of one method with their files, samplers and claims.

This module does not need torch; whatever does is imported when it is used.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from conventions.names import safe_file_stem
from model.sampling.samplers import SamplerChoice
from model.storage.cards import WeightsCard, load_card

if TYPE_CHECKING:
    from model.data.prepared import PreparedData
    from model.generation.base import System
    from model.training.config import TrainConfig
    from model.training.task import Task, TaskSetup


@dataclass(frozen=True)
class AblationStep:
    """An ablation step: a system that adds one thing to the one before."""

    system: str
    adds: str
    meaning: str
    equation: str
    """Equation in TeX, without HTML markup."""
    equation_reference: str
    """Number of the equation in the paper, such as "eq. 3"."""
    look_for: str


@dataclass(frozen=True)
class NonAblationSystem:
    """A system outside the ablation, shown next to it."""

    system: str
    title: str
    meaning: str


@dataclass(frozen=True)
class Ablation:
    """Ablation: systems that differ by one thing each, from the first to the last."""

    title: str
    introduction: str
    steps: tuple[AblationStep, ...]
    extra: tuple[NonAblationSystem, ...] = ()

    @property
    def explained_systems(self) -> tuple[str, ...]:
        """Names of the systems of all steps, and of the extra ones."""
        return tuple(each.system for each in (*self.steps, *self.extra))


@dataclass(frozen=True)
class Claim:
    """A paper's claim about the jerk of its systems, which is checked in every run."""

    less_jerk_property: str
    """Property of ``less_jerk_systems``, as in "the system with *global rotations* has less jerk
    than the one with *local rotations*"."""
    more_jerk_property: str
    """Property of ``more_jerk_system``, in the same sentence."""
    more_jerk_system: str
    less_jerk_systems: tuple[str, ...]
    first_less_jerk_system: str
    """The system of ``less_jerk_systems`` to which the others add something."""
    additions_name: str
    """Name of the additions; each system has one more than the one before."""


@dataclass(frozen=True)
class FileFlag:
    """A file or folder that a command-line flag or an environment variable names."""

    flag: str
    """Flag with its two dashes."""
    environment_variable: str
    metavar: str
    help: str


@dataclass(frozen=True)
class FileCheck:
    """Result of checking a file or folder that the user has named."""

    name: str
    detail: str = ""
    """Description of the file, if it works."""
    error: Exception | None = None
    """Error if it does not work."""
    advice: str = ""


Topic = Literal["motion", "sampling_steps", "speech_effect", "streaming", "training"]
"""Topics for which a family names its representative systems: motion of one speech, quality by
number of sampling steps, dependence on speech and noise, little delay, and training."""


class FamilyUnavailableError(ValueError):
    """Error for a family that is not available; the message gives the reason."""


@dataclass(frozen=True)
class Family:
    """Description of a family: its systems, what they can do, and how they are made.

    A new one is a folder in `model.systems`, or an installed package (`model.systems.registry`),
    that makes one of these; nothing else needs to know it.
    """

    name: str
    title: str
    """Name for users."""
    presets: "Callable[[str], Mapping[str, TrainConfig]]"
    """Function from the name of a network to its training presets by name."""
    package: str
    """Importable package: ``package.task.make_task(config, data, setup)`` makes the training task,
    ``package.system.load(name, folder)`` reads a generator."""
    systems: tuple[str, ...] = ()
    """Names of its generators, in the order of display."""
    descriptions: Mapping[str, str] = field(default_factory=dict)
    """One sentence for the user on each generator."""
    samplers: Mapping[str, tuple[SamplerChoice, ...]] = field(default_factory=dict)
    """Samplers of each generator; the first is the default."""
    display_order: int = 100
    """Place of its systems among the families: the lowest first."""
    helper_networks: tuple[str, ...] = ()
    """Networks that are trained like systems and used by them."""
    offline_only: tuple[str, ...] = ()
    """Generators that need the whole speech before they start, and so cannot stream."""
    shared_weights: Mapping[str, str] = field(default_factory=dict)
    """Generators that use the weights of another, with the name of that other."""
    shipped_weights_folder: Path | None = None
    """Folder of the weights that the family ships; those in a requested folder take precedence."""
    representatives: Mapping[Topic, tuple[str, ...]] = field(default_factory=dict)
    """Generators that represent the family, by topic."""
    planning_systems: tuple[str, ...] = ()
    """Generators that draw a gesture plan first, and accept one."""
    ablation: Ablation | None = None
    claim: Claim | None = None
    files_title: str = ""
    """Heading of the flags of ``files``."""
    files: tuple[FileFlag, ...] = ()
    """Files that users must name; a family with files overrides the methods that read them."""

    @property
    def network_names(self) -> tuple[str, ...]:
        """Names of its generators and helpers."""
        return (*self.systems, *self.helper_networks)

    @property
    def trainable_networks(self) -> tuple[str, ...]:
        """Names of the networks that this project trains, each with weights of its own."""
        return tuple(name for name in self.network_names if name not in self.shared_weights)

    def config(self, preset: str, system: str) -> "TrainConfig":
        """Return the training config of a preset; raises ValueError for an unknown one."""
        presets = self.presets(system)
        if preset not in presets:
            choice = (
                f"choose one of {', '.join(presets)}" if presets else "this system has no configs"
            )
            raise ValueError(f"There is no config {preset!r} of {system}; {choice}.")
        return presets[preset]

    def samplers_of(self, system: str) -> tuple[SamplerChoice, ...]:
        """Return the samplers of a generator; the first is the default."""
        return self.samplers.get(system, ())

    def weights_name(self, system: str) -> str:
        """Return the name under which the weights of a generator are saved."""
        return self.shared_weights.get(system, system)

    def available_systems(self, folder: Path) -> tuple[str, ...]:
        """Return the generators with weights in a folder, or among the family's own."""
        return tuple(
            name
            for name in self.systems
            if _weights_file(self.weights_folder(name, folder), self.weights_name(name)).is_file()
        )

    def weights_folder(self, name: str, folder: Path) -> Path:
        """Return the folder of a network's weights: ``folder``, or the family's own without any."""
        if (
            self.shipped_weights_folder is None
            or _weights_file(folder, self.weights_name(name)).is_file()
        ):
            return folder
        return self.shipped_weights_folder

    def require_files(self) -> None:
        """Check that all named ``files`` exist; raises CheckpointError or EncoderError."""

    def one_recording_only_reason(self) -> str | None:
        """Return why the named files suit one speech only, with advice; None if they suit any."""
        return None

    def non_redistributable_paths(self) -> tuple[Path, ...]:
        """Return the paths of ``files`` that must not be passed on."""
        return ()

    def check_files(self) -> tuple[FileCheck, ...]:
        """Check the named files; empty without any. Never raises."""
        return ()

    def card(self, name: str, folder: Path) -> WeightsCard:
        """Load the model card of a generator's or helper's weights."""
        return load_card(self.weights_folder(name, folder), self.weights_name(name))

    def system_fields(self, name: str, card: WeightsCard) -> "dict[str, Any]":
        """Return the fields of `System` that follow from the family and the model card."""
        from model.speech.encoders import make_encoder

        return {
            "name": name,
            "card": card,
            "speakers": card.speakers,
            "encoder": make_encoder(card.encoder),
            "samplers": self.samplers_of(name),
        }

    def make_task(self, config: "TrainConfig", data: "PreparedData", setup: "TaskSetup") -> "Task":
        """Return the training task of ``config``.

        Raises CheckpointError if weights that it needs are missing, damaged or of another shape;
        DataError if the data does not suit its networks.
        """
        return import_module(f"{self.package}.task").make_task(config, data, setup)

    def load(self, name: str, folder: Path) -> "System":
        """Load a generator; raises CheckpointError if its files are missing or damaged."""
        home = self.weights_folder(name, folder)
        return import_module(f"{self.package}.system").load(name, home)


def _weights_file(folder: Path, weights: str) -> Path:
    return folder / f"{safe_file_stem(weights)}.safetensors"
