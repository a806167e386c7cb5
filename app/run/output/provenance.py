"""What made a result: enough to make it again, or to tell two results apart; and what a run was
asked for, in words."""

from __future__ import annotations

import datetime
import importlib.metadata
import platform
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from app.findings.comparison import point_title
from app.run.ask import OF_SYSTEMS, Ask, Steps
from app.run.output.run_folder import told_of
from conventions.names import printable, short_names
from model.systems.registry import sampler_title

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
            "noise_seed": next(iter(options.values())).seed,
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


Settings = Mapping[str, str]
"""By name of a setting its value, both for a person."""
SPEECH = "speech"
MOTIONS = "motions"
"""Of files that somebody brought; no other run has it."""
SEED = "seed"
USUAL, NONE = "usual", "none"
_MAX_NAMED = 3
"""Files that a run's title names."""
_FILTERS = {"none": NONE, "savgol": "Savitzky-Golay 7/2"}


def settings_of(ask: Ask) -> Settings:
    """All that can tell two runs apart."""
    reference = ask.reference.name if ask.reference else NONE
    words, point = _words(ask), point_title(ask.joint).lower()
    if ask.motions:
        return {
            SPEECH: ask.speech.stem if ask.speech else NONE,
            MOTIONS: ", ".join(names_of_motions(ask)),
            "reference": reference,
            "words": words,
            "followed point": point,
            "windows": f"{ask.window} frames, {ask.overlap} shared" if ask.window else NONE,
        }
    return {
        SPEECH: ask.speech.stem if ask.speech else NONE,
        "systems": ", ".join(short_names(ask.systems).values()),
        "speaker": ask.speaker or USUAL,
        SEED: str(ask.seed),
        "samples": str(ask.samples),
        **{title: _of_systems(getattr(ask, name)) for name, title in OF_SYSTEMS.items()},
        "filter": _FILTERS[ask.post_filter],
        "reference": reference,
        "words": words,
        "followed point": point,
    }


def title_of(ask: Ask, systems: Sequence[str]) -> str:
    """What a run is made of, in a few words."""
    if ask.title:
        return ask.title
    if not ask.motions:
        stem = ask.speech.stem if ask.speech else NONE
        return f"{stem}: {', '.join(short_names(systems).values())}; seed {ask.seed}"
    names = names_of_motions(ask)
    more = len(names) - _MAX_NAMED
    others = f" and {more} more" if more > 0 else ""
    beside = f" beside {ask.reference.stem}" if ask.reference else ""
    return f"{', '.join(names[:_MAX_NAMED])}{others}{beside}"


def names_of_motions(ask: Ask) -> Sequence[str]:
    """What given motions are called: by default the stem of each file, as it can be printed, with
    its folder where two have the same stem."""
    if ask.names:
        return ask.names
    stems = [path.stem for path in ask.motions]
    return [
        printable(
            f"{path.resolve().parent.name}/{path.stem}" if stems.count(path.stem) > 1 else path.stem
        )
        for path in ask.motions
    ]


def differing(first: Settings, second: Settings) -> dict[str, tuple[str, str]]:
    """The settings that are not the same, but for the speech, with both values."""
    names = [name for name in {**first, **second} if name != SPEECH]
    pairs = {name: (first.get(name, NONE), second.get(name, NONE)) for name in names}
    return {name: pair for name, pair in pairs.items() if pair[0] != pair[1]}


def _words(ask: Ask) -> str:
    """Where they come from."""
    if ask.transcript is not None:
        return ask.transcript.name
    return "recognised" if ask.words == "recognise" else NONE


def _of_systems(asked: Steps | float | str) -> str:
    if isinstance(asked, Mapping):
        names = short_names(asked)
        return ", ".join(f"{names[name]} {count}" for name, count in asked.items()) or USUAL
    if isinstance(asked, str):
        return sampler_title(asked)
    return USUAL if asked is None else f"{asked:g}"
