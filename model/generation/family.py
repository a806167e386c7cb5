"""A family of systems: one idea's generators under one name, the files and samplers that they
offer, their claims.

Only what can be told without torch is here; the rest is imported when it is asked for.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from conventions.names import file_stem
from model.sampling.samplers import Sampler
from model.storage.cards import Card, load_card

if TYPE_CHECKING:
    from model.data.prepared import PreparedData
    from model.generation.base import System
    from model.training.config import TrainConfig
    from model.training.task import Task, TaskSetup


@dataclass(frozen=True)
class ExplainedSystem:
    """A system that adds one thing to the one before."""

    system: str
    adds: str
    meaning: str
    equation: str
    """In TeX, without the signs of HTML."""
    source: str
    look_for: str


@dataclass(frozen=True)
class Beside:
    """A system that stands beside the ladder."""

    system: str
    title: str
    meaning: str


@dataclass(frozen=True)
class Ladder:
    """Systems that differ by one thing each, from the first to the last."""

    title: str
    introduction: str
    rungs: tuple[ExplainedSystem, ...]
    beside: tuple[Beside, ...] = ()

    @property
    def systems(self) -> tuple[str, ...]:
        """All that it explains."""
        return tuple(each.system for each in (*self.rungs, *self.beside))


@dataclass(frozen=True)
class Claim:
    """What a paper says of the jerk of its systems, which is held against every run."""

    what: str
    """That systems of ``less`` have, in the words of "the paper's claim, that *what* jerk less than
    *than*"."""
    than: str
    """That ``more`` has."""
    more: str
    less: tuple[str, ...]
    plain: str
    """Of ``less``, the one that the others add to."""
    added: str
    """What these add, one more in each than in the one before."""


@dataclass(frozen=True)
class FileFlag:
    """A file or folder that a flag of every command names, or a variable of the environment."""

    flag: str
    """With its two dashes."""
    variable: str
    metavar: str
    help: str


@dataclass(frozen=True)
class FileReport:
    """What ``python -m app doctor`` says of one of them."""

    name: str
    detail: str = ""
    """What was found, where it works."""
    error: Exception | None = None
    """Why it does not."""
    advice: str = ""


Use = Literal[
    "run", "steps", "hearing", "hearing-tab", "live", "training", "bench-training",
]  # fmt: skip
"""What systems are taken for where nobody has chosen: ticked on the page for a run, ticked for the
curve of steps, compared by the command ``hearing``, ticked in that tab, first in the tab Live,
``python -m model.train``, and rows of `make bench`."""


class FamilyError(ValueError):
    """A family that cannot be had; the message says why."""


@dataclass(frozen=True)
class Family:
    """What training, evaluation, the page and the command line ask of a family.

    A new one is a folder beside the others in `model.systems`, or a package of its own
    (`model.systems.registry`), that makes one of these; nothing else needs to know of it.
    """

    name: str
    title: str
    """What a person calls it."""
    presets: "Callable[[str], Mapping[str, TrainConfig]]"
    """Name of what is trained -> settings of its training by their names."""
    package: str
    """Its folder as Python imports it: ``package.task.make_task(config, data, setup)`` makes
    what is trained, ``package.system.load(name, folder)`` reads a generator."""
    systems: tuple[str, ...] = ()
    """Its generators, in the order in which they are shown."""
    about: Mapping[str, str] = field(default_factory=dict)
    """One sentence for a person on each generator."""
    samplers: Mapping[str, tuple[Sampler, ...]] = field(default_factory=dict)
    """Of each generator; the first is the usual one."""
    place: int = 100
    """Where its systems are shown among the families': the least first."""
    helpers: tuple[str, ...] = ()
    """Networks that are trained like systems and serve them."""
    whole_speech: tuple[str, ...] = ()
    """Generators that need all of the speech before they begin, and so cannot be had live."""
    shared_weights: Mapping[str, str] = field(default_factory=dict)
    """Generators that move with the weights of another, and whose."""
    weights: Path | None = None
    """Where its own weights lie, of a family that brings some; those in a folder that is asked for
    come first."""
    usual: Mapping[Use, tuple[str, ...]] = field(default_factory=dict)
    """Its generators that are taken where nobody has chosen, by what for."""
    plans: tuple[str, ...] = ()
    """Generators that draw a plan of gestures first, and can be given one."""
    ladder: Ladder | None = None
    claim: Claim | None = None
    files_title: str = ""
    """Above the flags of ``files``."""
    files: tuple[FileFlag, ...] = ()
    """What a person names to have its generators at all; a family with files has methods of its
    own that read them."""

    @property
    def names(self) -> tuple[str, ...]:
        """Its generators and its helpers."""
        return (*self.systems, *self.helpers)

    @property
    def trained(self) -> tuple[str, ...]:
        """Everything that has weights of its own."""
        return tuple(name for name in self.names if name not in self.shared_weights)

    def config(self, preset: str, system: str) -> "TrainConfig":
        """Settings of a training.

        Raises:
            ValueError: if there are none of that name.
        """
        presets = self.presets(system)
        if preset not in presets:
            found = f"choose one of {', '.join(presets)}" if presets else "it is not trained here"
            raise ValueError(f"There is no config {preset!r} of {system}; {found}.")
        return presets[preset]

    def samplers_of(self, system: str) -> tuple[Sampler, ...]:
        """The samplers of a generator; the first is the usual one."""
        return self.samplers.get(system, ())

    def weights_of(self, system: str) -> str:
        """Under whose name the weights of a generator are saved."""
        return self.shared_weights.get(system, system)

    def systems_in(self, folder: Path) -> tuple[str, ...]:
        """Its generators whose weights lie in a folder of weights."""
        return tuple(
            name
            for name in self.systems
            if _weights_file(self.home_of(name, folder), self.weights_of(name)).is_file()
        )

    def home_of(self, name: str, folder: Path) -> Path:
        """Where the weights lie that a generator or a helper moves with: ``folder``, or the
        family's own where that has none."""
        if self.weights is None or _weights_file(folder, self.weights_of(name)).is_file():
            return folder
        return self.weights

    def require_files(self) -> None:
        """See that everything is there that was named by ``files``.

        Raises:
            CheckpointError, EncoderError: if it is not.
        """

    def why_not_on_page(self) -> str | None:
        """Why the page cannot offer its generators with the files that were named, as a sentence;
        None where it can."""
        return None

    def private_paths(self) -> tuple[Path, ...]:
        """Of ``files``, what no visitor of the page may read."""
        return ()

    def file_reports(self) -> tuple[FileReport, ...]:
        """What is found of the files that were named; nothing where none were. Never raises."""
        return ()

    def card(self, name: str, folder: Path) -> Card:
        """The card of the weights that a generator or a helper has."""
        return load_card(self.home_of(name, folder), self.weights_of(name))

    def fields_of(self, name: str, card: Card) -> "dict[str, Any]":
        """What it and the card of its weights say of a generator, as `System` has it."""
        from model.speech.encoder import make_encoder

        return {
            "name": name,
            "card": card,
            "speakers": card.speakers,
            "encoder": make_encoder(card.encoder),
            "samplers": self.samplers_of(name),
        }

    def make_task(self, config: "TrainConfig", data: "PreparedData", setup: "TaskSetup") -> "Task":
        """What there is to train under ``config``.

        Raises:
            CheckpointError: if weights that it needs are missing, damaged or of another shape.
            DataError: if the data does not suit its networks.
        """
        return import_module(f"{self.package}.task").make_task(config, data, setup)

    def load(self, name: str, folder: Path) -> "System":
        """Read a generator.

        Raises:
            CheckpointError: if its files are missing or damaged.
        """
        home = self.home_of(name, folder)
        return import_module(f"{self.package}.system").load(name, home)


def _weights_file(folder: Path, weights: str) -> Path:
    return folder / f"{file_stem(weights)}.safetensors"
