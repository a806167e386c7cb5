"""Families of other packages, by their entry points; one that is broken is told, and left out."""

import re
from collections.abc import Callable
from importlib.metadata import entry_points
from typing import Any

from model.generation.family import Family, FamilyError

GROUP = "co_speech_motion.families"
"""Of entry points that name a `Family`."""
_NAME = re.compile(r"[a-z0-9][a-z0-9.-]*(/[a-z0-9][a-z0-9.-]*)?")


def register_installed(register: Callable[[Family], None]) -> tuple[str, ...]:
    """Hand every family of another package to ``register``, in the order of their names.

    Returns:
        A sentence on each that cannot be had.
    """
    sentences = []
    for entry in sorted(entry_points(group=GROUP), key=lambda entry: (entry.name, entry.value)):
        try:
            family = entry.load()
            check_family(family)
            register(family)
        except (Exception, SystemExit) as error:  # one package must not keep out the others
            sentences.append(f"{_whose(entry)} is left out: {_why(error)}")
    return tuple(sentences)


def check_family(family: object) -> None:
    """See that what an entry point names can be shown and asked.

    Raises:
        FamilyError: if it is no family, or something that every family declares is missing.
    """
    if not isinstance(family, Family):
        raise FamilyError(f"it names a {type(family).__name__}, not a Family.")
    for name in family.names:
        if not _NAME.fullmatch(name):
            raise FamilyError(
                f"the name {name!r} must be small letters, digits, dots and dashes, with one slash "
                "or none."
            )
    for name in family.systems:
        if name not in family.about:
            raise FamilyError(f"nothing is said about {name}.")
        if not family.samplers_of(name):
            raise FamilyError(f"{name} has no sampler.")
    if family.weights is None:
        return
    for name in family.systems_in(family.weights):
        speakers = family.card(name, family.weights).get("speakers")
        if not isinstance(speakers, dict) or not speakers:
            raise FamilyError(f"the card of {name} names no speakers.")


def _whose(entry: Any) -> str:
    # Where the backport importlib_metadata is imported, entries of other folders are of its class.
    package = f" of the package {entry.dist.name}" if entry.dist else ""
    return f"The family {entry.name!r}{package} ({entry.value})"


def _why(error: BaseException) -> str:
    told = " ".join(str(error).split())
    sentence = told if isinstance(error, FamilyError) else f"{type(error).__name__}: {told}"
    return sentence if sentence.endswith(".") else f"{sentence}."
