"""What made a result: enough to make it again, or to tell two results apart."""

from __future__ import annotations

import datetime
import importlib.metadata
import platform
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from app.run.ask import OF_SYSTEMS, Ask
from app.run.output.run_folder import told_of

if TYPE_CHECKING:
    from model.generation.base import System
    from model.generation.windows import GenerateOptions
    from model.speech.audio import Speech
    from renderer.body.body import Body

PROVENANCE, ARE = "provenance.json", "weights_are"
WEIGHTS_ARE = "demonstration weights of this project, not those of the paper"
_PACKAGES = ("torch", "numpy", "scipy", "pyrender2", "matplotlib", "imageio-ffmpeg", "pocketsphinx")


def versions() -> dict[str, str]:
    """Of this project, Python and the packages whose numbers or pictures could differ."""
    from model.training.loop import revision

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


def origin_of(
    ask: Ask,
    speech: Speech,
    systems: Sequence[System],
    options: Mapping[str, GenerateOptions],
    body: Body,
    backend: str | None,
) -> dict[str, Any]:
    """The record of generated motion, ready for JSON, but for what the end of a run tells.

    Args:
        options: by system.
        backend: of OpenGL; None when nothing is drawn.
    """
    by_system = {
        name: {system: getattr(own, name) for system, own in options.items()} for name in OF_SYSTEMS
    }
    weights_are = (str(each.card.get("weights_are", WEIGHTS_ARE)) for each in systems)
    return {
        "made_at": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "versions": versions(),
        "weights": describe_systems(systems),
        "speech": {
            "file": ask.speech and ask.speech.name,
            "sha256": speech.sha256,
            "duration_s": round(speech.duration_s, 6),
            "frames": speech.num_frames,
        },
        "options": {
            **told_of(ask),
            **by_system,
            "speaker": next(iter(options.values())).speaker,
            "live": dict(ask.take.facts) if ask.take else None,
        },
        "drawing": {
            "body": body.name,
            "body_sha256": body.sha256,
            "look": body.look,
            "backend": backend,
        },
        ARE: "; ".join(dict.fromkeys(weights_are)),
    }
