"""What a run was asked for, in words, and where two runs were asked for different things."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from app.findings.comparison import point_title
from app.findings.verdict import short_names
from app.run.requests.request import GenerateRequest, Steps, WordsAsked
from model.systems.registry import sampler_title

Settings = Mapping[str, str]
"""By name of a setting its value, both for a person."""
SPEECH = "speech"
MOTIONS = "motions"
"""Of files that somebody brought; no other run has it."""
SEED = "seed"
USUAL, NONE = "usual", "none"
_FILTERS = {"none": NONE, "savgol": "Savitzky-Golay 7/2"}


def settings_of_run(asked: GenerateRequest) -> Settings:
    """Of generated motion."""
    reference = asked.reference
    return {
        SPEECH: asked.speech.stem,
        "systems": ", ".join(short_names(asked.systems).values()),
        "speaker": asked.speaker or USUAL,
        SEED: str(asked.seed),
        "samples": str(asked.samples),
        "steps": _steps(asked.steps),
        "steps of the face": _steps(asked.face_steps),
        "sampler": sampler_title(asked.sampler) if asked.sampler else USUAL,
        "strength of the speech": USUAL if asked.guidance is None else f"{asked.guidance:g}",
        "filter": _FILTERS[asked.post_filter],
        "reference": reference.name if reference else NONE,
        "words": words_asked(asked.transcript, asked.words),
        "followed point": point_title(asked.joint).lower(),
    }


def title_of(asked: GenerateRequest, systems: Sequence[str]) -> str:
    """What a run is made of, in a few words."""
    return f"{asked.speech.stem}: {', '.join(short_names(systems).values())}; seed {asked.seed}"


def differing(first: Settings, second: Settings) -> dict[str, tuple[str, str]]:
    """The settings that are not the same, but for the speech, with both values."""
    names = [name for name in {**first, **second} if name != SPEECH]
    pairs = {name: (first.get(name, NONE), second.get(name, NONE)) for name in names}
    return {name: pair for name, pair in pairs.items() if pair[0] != pair[1]}


def words_asked(transcript: Path | None, asked: WordsAsked) -> str:
    """Where words come from."""
    if transcript is not None:
        return transcript.name
    return "recognised" if asked == "recognise" else NONE


def _steps(asked: Steps) -> str:
    if isinstance(asked, Mapping):
        names = short_names(asked)
        return ", ".join(f"{names[name]} {count}" for name, count in asked.items()) or USUAL
    return USUAL if asked is None else str(asked)
