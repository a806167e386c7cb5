"""Registry of all families, bundled and installed, and systems by name; does not need torch."""

import os
import re
from collections.abc import Callable, Iterator
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from pkgutil import iter_modules
from typing import TYPE_CHECKING, Any

import model.systems
from model.generation.family import Family, FamilyUnavailableError, Topic
from model.sampling.samplers import UnknownNameError
from model.storage.cards import BUNDLED_WEIGHTS, CheckpointError, WeightsCard

if TYPE_CHECKING:
    from model.generation.base import System

GROUP = "co_speech_motion.families"
"""Group of the entry points that name a `Family`."""
_NAME = re.compile(r"[a-z0-9][a-z0-9.-]*(/[a-z0-9][a-z0-9.-]*)?")


def register_installed_reporting_failures(register: Callable[[Family], None]) -> tuple[str, ...]:
    """Register other packages' families by name; return a sentence on each failure."""
    sentences = []
    for entry in sorted(entry_points(group=GROUP), key=lambda entry: (entry.name, entry.value)):
        try:
            family = entry.load()
            check_family(family)
            register(family)
        except (Exception, SystemExit) as error:  # one package must not keep out the others
            sentences.append(f"{_entry_label(entry)} is left out: {_why(error)}")
    return tuple(sentences)


def check_family(family: object) -> None:
    """Check that an entry point's object is a complete family; raises FamilyUnavailableError."""
    if not isinstance(family, Family):
        raise FamilyUnavailableError(f"its entry point is a {type(family).__name__}, not a Family.")
    for name in family.network_names:
        if not _NAME.fullmatch(name):
            raise FamilyUnavailableError(
                f"the name {name!r} must consist of lower-case letters, digits, dots and dashes, "
                "with at most one slash."
            )
    for name in family.systems:
        if name not in family.descriptions:
            raise FamilyUnavailableError(f"it has no description of {name}.")
        if not family.samplers_of(name):
            raise FamilyUnavailableError(f"{name} has no sampler.")
    if family.shipped_weights_folder is None:
        return
    for name in family.available_systems(family.shipped_weights_folder):
        speakers = family.card(name, family.shipped_weights_folder).get("speakers")
        if not isinstance(speakers, dict) or not speakers:
            raise FamilyUnavailableError(f"the model card of {name} lists no speakers.")


def _entry_label(entry: Any) -> str:
    # Where the backport importlib_metadata is imported, entries of other folders are of its class.
    package = f" of the package {entry.dist.name}" if entry.dist else ""
    return f"The system family {entry.name!r}{package} ({entry.value})"


def _why(error: BaseException) -> str:
    reason = " ".join(str(error).split())
    sentence = (
        reason if isinstance(error, FamilyUnavailableError) else f"{type(error).__name__}: {reason}"
    )
    return sentence if sentence.endswith(".") else f"{sentence}."


def _bundled() -> list[Family]:
    """Return the families in the folders next to this file: ``FAMILY`` of each ``config.py``."""
    folders = (each.name for each in iter_modules(model.systems.__path__) if each.ispkg)
    bundled_families = [
        import_module(f"{model.systems.__name__}.{name}.config").FAMILY for name in folders
    ]
    return sorted(bundled_families, key=lambda family: (family.display_order, family.name))


_FAMILIES = _bundled()


def families() -> tuple[Family, ...]:
    """Return all families, in the order in which their systems are shown."""
    return tuple(_FAMILIES)


def register(family: Family) -> None:
    """Add a family; raises FamilyUnavailableError if one of its names is taken."""
    taken = {name for existing in _FAMILIES for name in (existing.name, *existing.network_names)}
    doubles = [name for name in (family.name, *family.network_names) if name in taken]
    if doubles:
        raise FamilyUnavailableError(f"the name {doubles[0]!r} is already used by another family.")
    _FAMILIES.append(family)


def unavailable_family_messages() -> tuple[str, ...]:
    """Return a sentence on each installed family of another package that is not available."""
    return _LEFT_OUT


def family_of(name: str) -> Family:
    """Return the family of a system or helper; raises UnknownNameError naming those that exist."""
    for family in _FAMILIES:
        if name in family.network_names:
            return family
    valid = ", ".join(name for family in _FAMILIES for name in family.network_names)
    raise UnknownNameError(f"There is no system {name!r}; choose one of {valid}.")


def representatives(topic: Topic) -> tuple[str, ...]:
    """Return the systems, any number of each family, that represent them in a topic."""
    return tuple(name for family in _FAMILIES for name in family.representatives.get(topic, ()))


def planning_systems() -> tuple[str, ...]:
    """Return the systems that plan first, and accept a plan."""
    return tuple(name for family in _FAMILIES for name in family.planning_systems)


def default_planning_system() -> str:
    """Return the name of the system that provides plans by default."""
    return planning_systems()[0]


def sampler_title(sampler: str) -> str:
    """Return the title of a sampler for users."""
    systems = ((family, system) for family in _FAMILIES for system in family.systems)
    choices = (each for family, system in systems for each in family.samplers_of(system))
    titles = (each.title for each in choices if each.name == sampler and each.title)
    return next(titles, sampler)


def list_systems(folder: Path = BUNDLED_WEIGHTS) -> tuple[str, ...]:
    """Return the systems with weights in ``folder``, in the order of the families."""
    return tuple(name for family in _FAMILIES for name in family.available_systems(folder))


def read_card(name: str, folder: Path = BUNDLED_WEIGHTS) -> WeightsCard:
    """Read the model card of a system's weights."""
    return family_of(name).card(name, folder)


def shared_speakers(folder: Path = BUNDLED_WEIGHTS) -> tuple[str, ...]:
    """Return the speakers shared by all systems in ``folder``, in the order of numbers.

    Systems of other packages count only if there are no others.
    """
    names = list_systems(folder)
    own = [name for name in names if family_of(name) in _BUNDLED]
    tables = [read_card(name, folder).speakers for name in own or names]
    if not tables:
        return ()
    shared = [name for name in tables[0] if all(name in table for table in tables)]
    return tuple(sorted(shared, key=lambda name: tables[0][name]))


def files_affecting_system(name: str, folder: Path = BUNDLED_WEIGHTS) -> Iterator[Path]:
    """Yield every file of which a system may consist, and others; none for an unknown system.

    They are all weights and cards of its folder, and the files named for its family.
    """
    for family in _FAMILIES:
        if name in family.network_names:
            for home in {folder, family.weights_folder(name, folder)}:
                yield from (*home.glob("[!.]*.safetensors"), *home.glob("[!.]*.json"))
            for named in filter(
                None, (os.environ.get(each.environment_variable) for each in family.files)
            ):
                yield from (Path(named), *Path(named).rglob("*"))


def load_system(name: str, folder: Path = BUNDLED_WEIGHTS) -> "System":
    """Load a system.

    Raises UnknownNameError, which lists the available systems; CheckpointError if files are missing
    or damaged; FamilyUnavailableError if the code of a family of another package fails.
    """
    available = list_systems(folder)
    if name not in available:
        choices = ", ".join(available) if available else f"none in {folder}"
        raise UnknownNameError(f"There is no system {name!r}; available: {choices}.")
    family = family_of(name)
    try:
        return family.load(name, folder)
    except Exception as error:  # code of other packages may raise anything
        if family in _BUNDLED or isinstance(error, CheckpointError):
            raise
        raise FamilyUnavailableError(
            f"{name} cannot be loaded because the code of {family.package} failed: "
            f"{type(error).__name__}: {error}"
        ) from error


_BUNDLED = tuple(_FAMILIES)
_LEFT_OUT = register_installed_reporting_failures(register)
