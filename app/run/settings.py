"""What a run was asked for, in words, and where two runs were asked for different things."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from app.findings.comparison import point_title
from app.run.ask import OF_SYSTEMS, Ask, Steps
from conventions.names import printable, short_names
from model.systems.registry import sampler_title

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
