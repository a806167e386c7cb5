"""From the fields of the page's tab to the text of a plan."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from app.errors import RunError
from app.page.parts.asked import form_of, whole_number
from model.systems.registry import usual_planner

SEPARATOR = "--"
PROTOCOLS = {
    "Pairs, which is more real? (silent)": "pairwise",
    "Right or wrong speech? (one system at a time)": "matched",
    "Rank all systems on three questions": "ranking",
    "Rate all systems with sliders": "rating",
}
CHANGES = {
    "on wrong words": "{ wrong_words = true }",
    "half as many": "{ times = { gestures_per_min = 0.5 } }",
    "smaller": "{ times = { size_m = 0.6 } }",
    "larger": "{ times = { size_m = 1.5 } }",
}
"""What can be done to the gestures of the system that plans, as a style of `model.plan.style`."""
QUESTIONS = {
    "Do words matter?": ("Rank all systems on three questions", ["on wrong words"]),
    "How many gestures?": ("Rate all systems with sliders", ["half as many"]),
    "How large?": ("Rate all systems with sliders", ["smaller", "larger"]),
}
"""Studies ready to be made: a protocol, and changes beside the gestures as planned."""
MAX_FILES = 60
MAX_VIDEO_S = 1800.0
"""Of all videos of a study that the page makes."""


@dataclass(frozen=True)
class StudyForm:
    """What the visitor has filled in, as Gradio hands it over."""

    title: str | None
    protocol: str
    speeches: list[str] | None
    systems: list[str]
    motions: list[str] | None
    """Files named ``<system>--<clip>.npz``."""
    length_s: float | None
    participants: float | None
    seed: float | None
    views: list[str]
    post_to: str | None
    return_to: str | None = None
    changed: list[str] | None = None
    """Of `CHANGES`, each a system of its own."""

    @classmethod
    def of(cls, values: Sequence[Any]) -> StudyForm:
        """From the values of the fields; the page has its own words for the protocols.

        Raises:
            RunError: if a value has another type than its field.
        """
        form = form_of(cls, values)
        return replace(form, protocol=PROTOCOLS.get(form.protocol, form.protocol))


def plan_text(form: StudyForm) -> str:
    """The plan as TOML; files are named relative to it.

    Raises:
        RunError: if something is missing that only the page can say well.
    """
    if not form.speeches:
        raise RunError("There is no speech yet: upload at least one file.")
    if len(form.speeches) + len(form.motions or []) > MAX_FILES:
        raise RunError(f"At most {MAX_FILES} files can be uploaded; use the command line for more.")
    if not form.length_s:
        raise RunError("The length of the videos is missing: give it in seconds.")
    clips = [Path(path) for path in form.speeches]
    others = _by_system(form.motions or [])
    changed = form.changed or []
    unknown = next((name for name in changed if name not in CHANGES), None)
    if unknown is not None:
        raise RunError(f"There is no change {unknown!r}; there are {', '.join(CHANGES)}.")
    count = len(clips) * (len(form.systems) + len(others) + len(changed)) * len(form.views)
    if count * form.length_s > MAX_VIDEO_S:
        raise RunError(
            f"This study has {count * form.length_s / 60:.0f} minutes of video; the page makes at "
            f"most {MAX_VIDEO_S / 60:.0f}, so use the command line or plan less."
        )
    lines = [
        f"title = {_text((form.title or '').strip() or 'Co-speech motion')}",
        f"protocol = {_text(form.protocol)}",
        f"participants = {whole_number(form.participants or 0, 'Participants', 1, 1000)}",
        f"seed = {whole_number(form.seed or 0, 'The seed of the order', 0, 2**31 - 1)}",
        f"views = [{', '.join(_text(view) for view in form.views)}]",
        f"length_s = {float(form.length_s):g}",
    ]
    if post_to := (form.post_to or "").strip():
        lines.append(f"post_to = {_text(post_to)}")
    if return_to := (form.return_to or "").strip():
        lines.append(f"return_to = {_text(return_to)}")
    for clip in clips:
        lines += ["", "[[clips]]", f"name = {_text(clip.stem)}", f"speech = {_text(clip.name)}"]
    for system in form.systems:
        lines += ["", "[[systems]]", f"name = {_text(system)}"]
    for name in changed:
        planner = usual_planner()
        lines += ["", "[[systems]]", f"name = {_text(f'{planner} {name}')}"]
        lines += [f"system = {_text(planner)}", f"style = {CHANGES[name]}"]
    for system, motions in others.items():
        lines += ["", "[[systems]]", f"name = {_text(system)}", "[systems.motion]"]
        lines += [f"{_text(clip)} = {_text(path.name)}" for clip, path in motions.items()]
    return "\n".join(lines) + "\n"


def collect_files(form: StudyForm, folder: Path) -> None:
    """Put the uploads beside the plan, under the names that it gives them, without a copy of the
    bytes where the disk is the same.

    Raises:
        RunError: if two uploads have the same name.
    """
    for path in (*(form.speeches or []), *(form.motions or [])):
        target = folder / Path(path).name
        if target.exists():
            raise RunError(f"Two uploads have the name {target.name}; rename one.")
        try:
            os.link(path, target)
        except OSError:
            shutil.copyfile(path, target)


def _by_system(paths: list[str]) -> dict[str, dict[str, Path]]:
    systems: dict[str, dict[str, Path]] = {}
    for path in map(Path, paths):
        system, separator, clip = path.stem.partition(SEPARATOR)
        if not (system and separator and clip):
            raise RunError(
                f"The motion file {path.name} must be named <system>{SEPARATOR}<clip>.npz, with "
                "the name of a speech file as the clip."
            )
        systems.setdefault(system, {})[clip] = path
    return systems


def _text(value: str) -> str:
    """A TOML string; JSON's escapes are among TOML's."""
    return json.dumps(value, ensure_ascii=True).replace("\x7f", "\\u007f")
