"""Two runs that have ended, beside each other: what was asked for, numbers, and in one player."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import gradio as gr

from app import text
from app.findings.comparison import plain, point_title
from app.findings.measure_rows import JERK, Numbers
from app.page.parts import markup
from app.page.parts.html_parts import shown
from app.page.player.player import Address, Showing
from app.page.queue.runner import Updates
from app.page.results.kept_runs import KeptRun, address_of
from app.page.results.measures_table import Column, table_of
from app.page.results.result_parts import ResultParts
from app.run.output.run_folder import RunRecord, colors_of
from app.run.requests.settings import MOTIONS, NONE, SEED, SPEECH, differing
from app.run.timeline import NUM_SECONDS
from conventions.names import REFERENCE_NAME, short_names

MAX_VIDEOS = 12


@dataclass(frozen=True)
class RunPair:
    """The earlier run is A, the later one B."""

    a: KeptRun
    b: KeptRun

    @classmethod
    def of(cls, first: KeptRun, second: KeptRun) -> RunPair:
        return cls(*sorted((first, second), key=lambda run: run.ended))

    @property
    def has_one_speech(self) -> bool:
        """Whether both were given the same file of sound."""
        first, second = self.a.record.speech_sha256, self.b.record.speech_sha256
        return bool(first) and first == second

    def updates(self, parts: ResultParts, address: Address) -> Updates:
        """For a browser that opens both.

        Args:
            address: gives it their files.
        """
        a, b = self.a.record, self.b.record
        return {
            parts.status: markup.sentence_status(text.PAIR_STATUS),
            parts.message: shown(""),
            parts.verdict: shown(self._head()),
            parts.player: joined(*(run.showing.for_browser(address) for run in (self.a, self.b))),
            parts.figures: shown(""),
            parts.numbers: shown(pair_table(a, b)),
            parts.downloads_part: gr.update(visible=False),
        }

    def _head(self) -> str:
        a, b = self.a.record, self.b.record
        links = "".join(
            f'<li><b>{letter}</b><a href="{escape(address_of(kept))}">{escape(kept.record.title)}'
            "</a></li>"
            for letter, kept in (("A", self.a), ("B", self.b))
        )
        said = [told_speech(a, b, self.has_one_speech), jerk_line(a, b)]
        below = "".join(f"<p>{escape(sentence)}</p>" for sentence in said if sentence)
        return (
            f'<div class="verdict pair-head"><ol>{links}</ol><b>{escape(told_settings(a, b))}</b>'
            f"{below}{_settings_table(a, b)}</div>"
        )


def told_settings(a: RunRecord, b: RunRecord) -> str:
    """The settings that differ, in one sentence."""
    differ = differing(a.settings, b.settings)
    brought = [name for name, run in (("A", a), ("B", b)) if MOTIONS in run.settings]
    if len(brought) != 1:
        return _against(differ) or text.PAIR_SAME_SETTINGS
    # What a system was asked for is no setting of a file.
    shared = a.settings.keys() & b.settings.keys()
    told = _against({name: pair for name, pair in differ.items() if name in shared})
    return f"{text.PAIR_BROUGHT.format(run=brought[0])} {told}".rstrip()


def _against(differ: Mapping[str, tuple[str, str]]) -> str:
    told = "; ".join(f"{name} {first} against {second}" for name, (first, second) in differ.items())
    return f"{told[:1].upper()}{told[1:]}." if told else ""


def told_speech(a: RunRecord, b: RunRecord, is_one: bool) -> str:
    """Whether the speech is the same, and what that means."""
    first, second = a.settings.get(SPEECH, NONE), b.settings.get(SPEECH, NONE)
    if not is_one:
        return text.PAIR_OTHER_SPEECH.format(first=first, second=second)
    only_chance = list(differing(a.settings, b.settings)) == [SEED]
    return text.PAIR_ONLY_SEED if only_chance else text.PAIR_ONE_SPEECH.format(speech=first)


def jerk_line(a: RunRecord, b: RunRecord) -> str:
    """The followed point's jerk in both; empty where the points are not the same."""
    if a.point != b.point:
        return ""
    jerk = [
        {
            name: numbers["raw"][JERK]
            for name, numbers in _systems(run).items()
            if JERK in numbers["raw"]
        }
        for run in (a, b)
    ]
    told = "; ".join(_jerk_of(jerk, pair) for pair in pairs_of(list(jerk[0]), list(jerk[1])))
    return f"{point_title(a.point)} jerk in m/s³: {told}." if told else ""


def _systems(run: RunRecord) -> dict[str, Numbers]:
    return {name: each for name, each in run.numbers.items() if name != REFERENCE_NAME}


def _jerk_of(jerk: Sequence[Mapping[str, float]], names: tuple[str, str]) -> str:
    """In both runs, of what stands beside each other there."""
    labels = short_names(dict.fromkeys(name for name in names if name))
    told = [
        ("" if i and name == names[0] else f"{labels[name]} ") + f"{plain(jerk[i][name])} in {run}"
        for i, (name, run) in enumerate(zip(names, "AB", strict=True))
        if name
    ]
    return " and ".join(told)


def pairs_of(a: Sequence[str], b: Sequence[str]) -> list[tuple[str, str]]:
    """What stands beside what: equal names, and of the others those that are the only one of their
    run; an empty name where there is nothing to stand beside."""
    only_a, only_b = (
        [name for name in own if name not in other] for own, other in ((a, b), (b, a))
    )
    pairs = [(name, name) for name in a if name in b]
    if len(only_a) == len(only_b) == 1:
        return [*pairs, (only_a[0], only_b[0])]
    return [*pairs, *((name, "") for name in only_a), *(("", name) for name in only_b)]


def pair_table(a: RunRecord, b: RunRecord) -> str:
    """The numbers of both and their difference, motion by motion."""
    columns: list[Column] = []
    references = [run.numbers.get(REFERENCE_NAME) for run in (a, b)]
    if is_one_reference(a, b) and references[0] is not None:
        columns.append(Column.of(REFERENCE_NAME, REFERENCE_NAME, references[0], is_reference=True))
    else:
        for letter, reference in zip("AB", references, strict=True):
            if reference is not None:
                name = f"{REFERENCE_NAME} ({letter})"
                columns.append(Column.of(name, name, reference))
    runs = _systems(a), _systems(b)
    for pair in pairs_of(list(runs[0]), list(runs[1])):
        columns += _columns([run.get(name) for run, name in zip(runs, pair, strict=True)], pair)
    points = dict.fromkeys(point_title(run.point) for run in (a, b))
    return table_of(columns, " and ".join(points), text.PAIR_LEGEND)


def _columns(numbers: Sequence[Numbers | None], names: Sequence[str]) -> list[Column]:
    labels = short_names(dict.fromkeys(name for name in names if name))
    found = [
        Column.of(lettered(name, letter), lettered(labels[name], letter), each)
        for each, name, letter in zip(numbers, names, "AB", strict=True)
        if each is not None
    ]
    if len(found) < 2:
        return found
    name = f"{' and '.join(dict.fromkeys(labels.values()))}: {text.PAIR_DIFFERENCE}"
    return [*found, found[1].less(found[0], name, text.PAIR_DIFFERENCE)]


def lettered(name: str, letter: str) -> str:
    return f"{name} ({letter})"


def is_one_reference(a: RunRecord, b: RunRecord) -> bool:
    """Whether both stand beside the same recording: its numbers are the same."""
    first, second = a.numbers.get(REFERENCE_NAME), b.numbers.get(REFERENCE_NAME)
    return first is not None and first == second


def joined(a: Showing, b: Showing) -> dict[str, Any]:
    """Both for one player, in lock-step: under the one speech that they have, or under either's, as
    somebody chooses."""
    runs = a.record, b.record
    values = [run.value() for run in (a, b)]
    lines = [run.timeline() for run in (a, b)]
    rows = _rows(*runs, values)
    value = {
        "run": " ".join(value["run"] for value in values),
        "rows": rows,
    }
    if not all(lines):
        return value
    names = [row["name"] for row in rows]
    heard = _heard(runs, lines)
    sounds = [
        {
            "label": _sound_label(runs[i], "AB"[i]),
            "audio": values[i]["audio"],
            "timeline": _as_address(_timeline(lines, i, names, has_one_speech=len(heard) == 1)),
        }
        for i in heard
    ]
    first = {kind: sounds[0][kind] for kind in ("audio", "timeline")}
    return value | first | ({"sounds": sounds} if len(sounds) > 1 else {})


def _heard(runs: Sequence[RunRecord], lines: Sequence[dict[str, Any]]) -> list[int]:
    """Whose sound can be listened to: each that is another; of one speech, or of none, that of
    whichever is longer."""
    spoken = [i for i, run in enumerate(runs) if run.speech_sha256]
    if len({runs[i].speech_sha256 for i in spoken}) == 2:
        return spoken
    longest_first = sorted((0, 1), key=lambda i: lines[i].get("duration_s", 0.0), reverse=True)
    return [i for i in longest_first if i in spoken or not spoken][:1]


def _sound_label(run: RunRecord, letter: str) -> str:
    speech = run.settings.get(SPEECH, NONE)
    return letter if speech == NONE else f"{letter}: {speech}"


def _as_address(timeline: Mapping[str, Any]) -> str:
    data = base64.b64encode(json.dumps(timeline).encode()).decode("ascii")
    return f"data:application/json;base64,{data}"


def _rows(a: RunRecord, b: RunRecord, values: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """A beside B, motion by motion; of too many the first."""
    by_name = [{row["name"]: row for row in value["rows"]} for value in values]
    seeds = [run.settings.get(SEED, "") for run in (a, b)]
    is_one = is_one_reference(a, b)
    systems = [[name for name in rows if name != REFERENCE_NAME] for rows in by_name]
    last = [REFERENCE_NAME if REFERENCE_NAME in rows else "" for rows in by_name]
    if is_one:
        last[1] = ""
    rows: list[dict[str, Any]] = []
    for pair in [*pairs_of(*systems), last]:
        for i, name in enumerate(pair):
            if not name:
                continue
            row, letter = by_name[i][name], "AB"[i]
            rows.append(
                {
                    **row,
                    "name": _name(name, letter, is_one),
                    "label": _name(row["label"], letter, is_one),
                    "stem": f"{row['stem']}-{letter}",
                    "noise": row["noise"] and f"{row['noise']} of seed {seeds[i]}",
                    "run": values[i]["run"],
                }
            )
    colors = colors_of(row["name"] for row in rows)
    for row in rows:
        row["color"] = colors[row["name"]]
    return rows[:MAX_VIDEOS]


def _name(name: str, letter: str, is_one_reference: bool) -> str:
    return name if name == REFERENCE_NAME and is_one_reference else lettered(name, letter)


def _timeline(
    lines: Sequence[dict[str, Any]], heard: int, names: Sequence[str], *, has_one_speech: bool
) -> dict[str, Any]:
    """One time line of both, of the motions that have a row, under the sound of one of them."""
    curves, worst = {}, []
    for line, letter in zip(lines, "AB", strict=True):
        new = {
            name: next(each for each in (lettered(name, letter), name) if each in names)
            for name in line["curves"]
            if lettered(name, letter) in names or name in names
        }
        curves |= {new[name]: curve for name, curve in line["curves"].items() if name in new}
        worst.append(
            [each | {"name": new[each["name"]]} for each in line["worst"] if each["name"] in new]
        )
    points = dict.fromkeys(line["point"] for line in lines)
    others = lines if has_one_speech else ()
    words = next((line["words"] for line in (lines[heard], *others) if line["words"]), [])
    return lines[heard] | {
        "curves": curves,
        "worst": worst_of_both(*worst),
        "point": " and ".join(points),
        "words": words,
    }


def worst_of_both(
    first: list[dict[str, Any]], second: list[dict[str, Any]], count: int = NUM_SECONDS
) -> list[dict[str, Any]]:
    """The worst of two such lists, without overlap."""
    kept: list[dict[str, Any]] = []
    for each in sorted([*first, *second], key=lambda one: -one["jerk_m_s3"]):
        if all(each["start_s"] >= k["end_s"] or each["end_s"] <= k["start_s"] for k in kept):
            kept.append(each)
    return kept[:count]


def _settings_table(a: RunRecord, b: RunRecord) -> str:
    """Every setting of both, those that differ first."""
    names = list({**a.settings, **b.settings})
    differ = {name for name in names if a.settings.get(name, NONE) != b.settings.get(name, NONE)}
    rows = "".join(
        f'<tr{" class=differs" if name in differ else ""}><th scope="row">{escape(name)}</th>'
        + "".join(f"<td>{escape(run.settings.get(name, NONE))}</td>" for run in (a, b))
        + "</tr>"
        for name in sorted(names, key=lambda name: name not in differ)
    )
    head = '<tr><th scope="col">Setting</th><th scope="col">A</th><th scope="col">B</th></tr>'
    return (
        f"<details><summary>{text.PAIR_SETTINGS}</summary><table><thead>{head}</thead>"
        f"<tbody>{rows}</tbody></table></details>"
    )
