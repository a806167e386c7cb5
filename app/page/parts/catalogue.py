"""Choices of the page (systems, speakers, examples, ...), read without loading a model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from app import text
from app.errors import RunError
from app.findings.comparison import point_title
from conventions.joints import FINGERTIP_VERTICES, JOINT_NAMES
from conventions.names import short_names
from model.storage.cards import WeightsCard
from model.systems.registry import (
    families,
    family_of,
    list_systems,
    planning_systems,
    read_card,
    representatives,
    shared_speakers,
)

MAX_DEFAULT_SYSTEMS = 3


@dataclass(frozen=True)
class Catalogue:
    """Choices of the page."""

    systems: tuple[str, ...]
    speakers: tuple[str, ...]
    trained_on: str
    """Amount and kind of the training data, as part of a sentence; empty for random weights."""
    examples: tuple[Path, ...] = ()
    """Speech files that come with the app."""
    samplers: tuple[str, ...] = ()
    """Names of the samplers of all systems."""
    default_steps_text: str = ""
    """Default number of sampling steps of the systems, as text."""

    @property
    def system_choices(self) -> list[tuple[str, str]]:
        """Label and full name of each system."""
        return [(label, name) for name, label in short_names(self.systems).items()]


def descriptions_by_label(systems: Sequence[str]) -> dict[str, str]:
    """Return a sentence about each system by its label."""
    return {
        label: family_of(name).descriptions.get(name, "")
        for name, label in short_names(systems).items()
    }


def labels_by_group(systems: Sequence[str]) -> dict[str, list[str]]:
    """Return the labels of the systems by title of their group."""
    ablations = [family.ablation for family in families() if family.ablation is not None]
    steps = {step.system for ablation in ablations for step in ablation.steps}
    own = {*planning_systems(), *(each.system for ablation in ablations for each in ablation.extra)}
    groups: dict[str, list[str]] = {}
    for name, label in short_names(systems).items():
        title = text.OWN_GROUP if name in own else text.OTHERS_GROUP
        groups.setdefault(text.ABLATION_GROUP if name in steps else title, []).append(label)
    return groups


def read_catalogue(weights: Path, examples: tuple[Path, ...] = ()) -> Catalogue:
    """Read systems and speakers from the model cards in a folder of weights.

    Raises RunError if there is no system in it, CheckpointError if a card cannot be read.
    """
    names = list_systems(weights)
    if not names:
        raise RunError(
            f"No trained systems were found in {weights}; choose another folder with --weights DIR."
        )
    cards = [read_card(name, weights) for name in names]
    samplers = [sampler for name in names for sampler in family_of(name).samplers_of(name)]
    usual = [_usual_steps(name) for name in names]
    return Catalogue(
        names,
        shared_speakers(weights),
        _trained_on(cards),
        examples,
        tuple(dict.fromkeys(sampler.name for sampler in samplers)),
        ", ".join(dict.fromkeys(usual)),
    )


def _usual_steps(system: str) -> str:
    family = family_of(system)
    steps = {name: family.samplers_of(name)[0].default_steps for name in family.systems}
    owner = family.name if len(set(steps.values())) == 1 else system
    return f"{owner} {steps[system]}"


def example_title(path: Path) -> str:
    """Format the name of an example: ``a_long_drive.wav`` becomes "A long drive"."""
    return path.stem.replace("_", " ").capitalize()


def tracked_point_choices() -> list[tuple[str, str]]:
    """Return title and name of each tracked point, fingertips first."""
    return [(point_title(point), point) for point in (*FINGERTIP_VERTICES, *JOINT_NAMES)]


def _trained_on(cards: list[WeightsCard]) -> str:
    """Describe the training data according to the model cards, which hold for any weights."""
    cards = [
        card for card in cards if card.origin_note is None
    ]  # without checkpoints of other authors
    hours = [card.training_data_hours for card in cards]
    if max(hours, default=0.0) == 0.0 or not any(card.training_steps for card in cards):
        return ""
    data = cards[0].get("training_data")
    # A corpus made by this project has a description, any other folder only a name.
    what = "procedurally generated motion" if isinstance(data, dict) else f"“{data}”"
    least, most = (f"{hours_of_one:.1f}" for hours_of_one in (min(hours), max(hours)))
    return f"{least if least == most else f'{least} to {most}'} hours of {what}"


def default_systems(systems: Sequence[str]) -> list[str]:
    """Return the systems that are ticked by default, at most three, the usual ones first."""
    usual = [name for name in representatives("motion") if name in systems]
    chosen = [*dict.fromkeys((*usual, *systems))][:MAX_DEFAULT_SYSTEMS]
    return [name for name in systems if name in chosen]


def guidance_choices(*values: float) -> list[tuple[str, float | str]]:
    """Return labels and values of guidance scales, the default first."""
    named = ((text.GUIDANCE_NAMES.get(value, f"{value:g}"), value) for value in values)
    return [("default of each system", ""), *named]
