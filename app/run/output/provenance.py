"""What made a result: enough to make it again, or to tell two results apart."""

from __future__ import annotations

import datetime
import importlib.metadata
import platform
from collections.abc import Mapping, Sequence
from typing import Any

WEIGHTS_ARE = "demonstration weights of this project, not those of the paper"
_PACKAGES = ("torch", "numpy", "scipy", "pyrender2", "matplotlib", "imageio-ffmpeg", "pocketsphinx")


def versions() -> dict[str, str]:
    """Of this project, Python and the packages whose numbers or pictures could differ."""
    from model.training.run_folder import revision

    found = {"project": revision(), "python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            found[package] = "not installed"
    return found


def describe_systems(systems: Sequence[Any]) -> dict[str, dict[str, Any]]:
    """Weights and card of each system (`model.generation.base.System`)."""
    return {system.name: _describe(system) for system in systems}


def _describe(system: Any) -> dict[str, Any]:
    (_, own), *others = system.sha256s.items()
    return {
        "sha256": own,
        **{f"{name}_sha256": sha256 for name, sha256 in others},
        "trained_on": system.card.get("training_data"),
        "training_hours": system.card.get("training_hours"),
        "training_steps": system.card.get("steps"),
        "date": system.card.get("date"),
    }


def make_provenance(
    systems: Sequence[Any],
    speech: Mapping[str, Any],
    options: Mapping[str, Any],
    drawing: Mapping[str, Any],
    notes: Sequence[str],
) -> dict[str, Any]:
    """The whole record, ready for JSON."""
    return {
        "made_at": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "versions": versions(),
        "weights": describe_systems(systems),
        "speech": dict(speech),
        "options": dict(options),
        "drawing": dict(drawing),
        "notes": list(notes),
        "weights_are": "; ".join(
            dict.fromkeys(str(system.card.get("weights_are", WEIGHTS_ARE)) for system in systems)
        ),
    }
