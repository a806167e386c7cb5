"""Provenance of a result, for its reproduction, and settings and title of a run in words."""

from __future__ import annotations

import datetime
import importlib.metadata
import platform
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from app.findings.comparison import point_title
from app.run.requests.convert import flat_public_fields
from app.run.requests.parts import SYSTEM_OPTIONS, MotionInput, Steps
from app.run.requests.requests import DiagnoseRequest, GenerateRequest, RunRequest
from conventions.names import printable, short_names
from model.storage.revision import revision
from model.systems.registry import sampler_title

if TYPE_CHECKING:
    from model.generation.base import System
    from model.generation.windows import GenerateOptions
    from model.speech.audio import Speech
    from renderer.body.body import Body

PROVENANCE, WEIGHTS_ARE_KEY = "provenance.json", "weights_are"
WEIGHTS_ARE = "demonstration weights of this project, not those of the paper"
_PACKAGES = ("torch", "numpy", "scipy", "pyrender2", "matplotlib", "imageio-ffmpeg", "pocketsphinx")


def software_versions() -> dict[str, str]:
    """Return the versions of this project, Python and packages that affect numbers or pictures."""
    installed = {"project": revision(), "python": platform.python_version()}
    for package in _PACKAGES:
        try:
            installed[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            installed[package] = "not installed"
    return installed


def describe_systems(systems: Sequence[Any]) -> dict[str, dict[str, Any]]:
    """Return weights and model card of each system (`model.generation.base.System`)."""
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
    request: GenerateRequest,
    speech: Speech,
    systems: Sequence[System],
    options: Mapping[str, GenerateOptions],
    body: Body,
    backend: str | None,
) -> dict[str, Any]:
    """Return the provenance of generated motion as JSON, as far as it is known before its end.

    ``backend`` is the OpenGL backend; None if nothing is rendered.
    """
    by_system = {
        name: {system: getattr(own, name) for system, own in options.items()}
        for name in SYSTEM_OPTIONS
    }
    weights_are = (str(each.card.get("weights_are", WEIGHTS_ARE)) for each in systems)
    return {
        "made_at": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "versions": software_versions(),
        "weights": describe_systems(systems),
        "speech": {
            "file": request.speech.path.name,
            "sha256": speech.sha256,
            "duration_s": round(speech.duration_s, 6),
            "frames": speech.num_motion_frames,
        },
        "options": {
            **flat_public_fields(request),
            **by_system,
            "speaker": next(iter(options.values())).speaker,
            "noise_seed": next(iter(options.values())).seed,
            "live": dict(request.live_recording.metadata) if request.live_recording else None,
        },
        "drawing": {
            "body": body.name,
            "body_sha256": body.sha256,
            "look": body.body_look_if_painted,
            "backend": backend,
        },
        WEIGHTS_ARE_KEY: "; ".join(dict.fromkeys(weights_are)),
    }


Settings = Mapping[str, str]
"""Values of the settings of a run by name, both in words."""
SPEECH = "speech"
MOTIONS = "motions"
"""Name of the setting for imported files, which only runs that measure have."""
SEED = "seed"
DEFAULT_VALUE_TEXT, NONE = "default", "none"
_MAX_NAMED = 3
"""Maximum number of files named in a run's title."""
_FILTERS = {"none": NONE, "savgol": "Savitzky-Golay 7/2"}


def settings_summary(request: RunRequest) -> Settings:
    """Return all settings that can distinguish two runs."""
    speech, reference = request.speech.path, request.imports.reference
    first = {SPEECH: speech.stem if speech else NONE}
    last = {
        "reference": reference.name if reference else NONE,
        "words": _words(request),
        "tracked point": point_title(request.tracked_point).lower(),
    }
    if isinstance(request, DiagnoseRequest):
        motions = request.motions
        frames, overlap = motions.generation_window_frames, motions.window_overlap_frames
        windows = f"{frames} frames, overlap {overlap}" if frames else NONE
        names = ", ".join(motion_labels(motions))
        return {**first, MOTIONS: names, **last, "windows": windows}
    assert isinstance(request, GenerateRequest)
    sampling = request.sampling
    return {
        **first,
        "systems": ", ".join(short_names(sampling.systems).values()),
        "speaker": sampling.speaker or DEFAULT_VALUE_TEXT,
        SEED: str(sampling.seed),
        "samples": str(sampling.samples),
        **{title: _of_systems(getattr(sampling, name)) for name, title in SYSTEM_OPTIONS.items()},
        "filter": _FILTERS[sampling.post_filter],
        **last,
    }


def run_title(request: RunRequest, systems: Sequence[str] = ()) -> str:
    """Return a short title of a run, with ``systems`` if the request names none."""
    if request.output.title:
        return request.output.title
    reference = request.imports.reference
    if isinstance(request, GenerateRequest):
        named = short_names(systems or request.sampling.systems).values()
        return f"{request.speech.path.stem}: {', '.join(named)}; seed {request.sampling.seed}"
    assert isinstance(request, DiagnoseRequest)
    names = motion_labels(request.motions)
    more = len(names) - _MAX_NAMED
    others = f" and {more} more" if more > 0 else ""
    compared = f", compared with {reference.stem}" if reference else ""
    return f"{', '.join(names[:_MAX_NAMED])}{others}{compared}"


def motion_labels(motions: MotionInput) -> Sequence[str]:
    """Return the names of imported motions: by default the printable stem of each file.

    Two files with the same stem are named with their folders.
    """
    if motions.names:
        return motions.names
    paths = motions.motions
    stems = [path.stem for path in paths]
    return [
        printable(
            f"{path.resolve().parent.name}/{path.stem}" if stems.count(path.stem) > 1 else path.stem
        )
        for path in paths
    ]


def differing_settings(first: Settings, second: Settings) -> dict[str, tuple[str, str]]:
    """Return the settings that differ, except for the speech, with both values."""
    names = [name for name in {**first, **second} if name != SPEECH]
    pairs = {name: (first.get(name, NONE), second.get(name, NONE)) for name in names}
    return {name: pair for name, pair in pairs.items() if pair[0] != pair[1]}


def _words(request: RunRequest) -> str:
    if request.speech.transcript is not None:
        return request.speech.transcript.name
    return "recognised" if request.speech.word_source == "recognise" else NONE


def _of_systems(option: Steps | float | str) -> str:
    if isinstance(option, Mapping):
        names = short_names(option)
        return (
            ", ".join(f"{names[name]} {count}" for name, count in option.items())
            or DEFAULT_VALUE_TEXT
        )
    if isinstance(option, str):
        return sampler_title(option)
    return DEFAULT_VALUE_TEXT if option is None else f"{option:g}"
