"""The leak test of everything in the bundle that is text."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from app.study.design.key import TRIAL_KINDS
from app.study.design.wording import CHOICE_VALUES, wording
from app.study.make.participant_page import INDEX, SCRIPT, SITE, STYLE, fixed_words, index_html

_FREE_TEXTS = ("title", "consent", "postTo", "returnTo")
_KNOWN_KEYS = {
    *("study", "sound", "minutes", "trials", "lists", "instruction", "questions", "words"),
    "reasons",
    *_FREE_TEXTS,
}
_VOCABULARY = {"kind", "press", *TRIAL_KINDS, *CHOICE_VALUES}
"""What a trial may say of itself."""
_LEAST_PART = 4


def text_leaks(
    bundle: Path,
    data: dict[str, Any],
    protocol: str,
    systems: Sequence[str],
    clips: Sequence[str],
) -> Iterator[str]:
    """Names of systems and clips, addresses and unknown fields in what the page consists of.

    The page's own files hold no word of a study; they must be as this program has them. Sentences
    from `questions.toml` may hold any word. Everything else is searched: ids and structure for
    names and parts of names, what the researcher wrote for whole names.
    """
    for name in (SCRIPT, STYLE):
        if (bundle / name).read_bytes() != (SITE / name).read_bytes():
            yield f"page: {name} is not the file of this program."
    if (bundle / INDEX).read_text("utf-8") != index_html(data.get("title", ""), data.get("postTo")):
        yield f"page: {INDEX} is not the file of this program."
    for key in sorted(set(data) - _KNOWN_KEYS):
        yield f"JSON: the field `{key}` is unknown."
    parts = [data.get(key) for key in ("study", "trials", "lists")]
    standard = {**fixed_words(protocol), "reasons": wording()["reasons"]}
    parts += [
        data.get(key) for key, value in standard.items() if data.get(key) not in (None, value)
    ]
    structure = "\n".join(sorted(set(_strings(parts)) - _VOCABULARY))
    for name in _words(systems, clips):
        if _holds(structure, name):
            yield f"JSON: the page's data hold {name!r}."
    written = {key: str(data.get(key) or "") for key in _FREE_TEXTS}
    for key, text in written.items():
        for name in (*systems, *clips):
            if _holds(text, name):
                what = "URL" if key == "postTo" else "text"
                yield f"{what}: `{key}` holds {name!r}, the name of a system or clip; rename one."
    if re.search(r"https?:", structure):
        yield "URL: the page's data hold an address."


def _strings(value: Any) -> Iterator[str]:
    """All texts and names of fields inside a JSON value."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for key, item in value.items():
            yield key
            yield from _strings(item)
    elif isinstance(value, list):
        for item in value:
            yield from _strings(item)


def _words(systems: Sequence[str], clips: Sequence[str]) -> list[str]:
    """Whole names, and parts that are long enough to mean something."""
    names = {*systems, *clips}
    parts = {part for name in names for part in re.split(r"[\s/_.,-]+", name)}
    return sorted(names | {part for part in parts if len(part) >= _LEAST_PART})


def _holds(text: str, name: str) -> bool:
    """Whether the name occurs as a word, whatever its case."""
    return re.search(rf"(?<!\w){re.escape(name)}(?!\w)", text, re.IGNORECASE) is not None
