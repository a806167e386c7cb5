"""What made a result: enough to make it again, or to tell two results apart."""

from __future__ import annotations

import datetime
import importlib.metadata
import platform
from collections.abc import Sequence
from typing import Any

from app.run.output.run_folder import told_of
from app.run.requests.request import Ask
from model.speech.transcript import Transcript

PROVENANCE, ARE = "provenance.json", "weights_are"
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
    ask: Ask, inputs: Any, said: Transcript, notes: Sequence[str]
) -> dict[str, Any]:
    """The whole record of generated motion, ready for JSON.

    Args:
        inputs: an `app.run.rows.Inputs`.
    """
    by_system = {
        name: {system: getattr(own, name) for system, own in inputs.options.items()}
        for name in ("steps", "face_steps", "sampler", "guidance")
    }
    weights_are = (str(each.card.get("weights_are", WEIGHTS_ARE)) for each in inputs.systems)
    return {
        "made_at": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "versions": versions(),
        "weights": describe_systems(inputs.systems),
        "speech": {
            "file": ask.speech and ask.speech.name,
            "sha256": inputs.speech_sha256,
            "duration_s": round(inputs.speech_s, 6),
            "frames": inputs.num_frames,
            "words": {"origin": said.origin, "count": len(said.words)} if said.words else None,
        },
        "options": {
            **told_of(ask),
            **by_system,
            "speaker": inputs.speaker,
            "live": dict(ask.take.facts) if ask.take else None,
        },
        "drawing": {
            "body": inputs.body.name,
            "body_sha256": inputs.body.sha256,
            "look": inputs.body.look,
            "backend": inputs.backend,
        },
        "notes": list(notes),
        ARE: "; ".join(dict.fromkeys(weights_are)),
    }
