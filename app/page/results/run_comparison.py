"""Comparison of two finished runs: settings, metrics, and all motions in one player."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from app import text
from app.findings.comparison import point_title
from app.page.parts import markup
from app.page.parts.markup import Updates, update_html
from app.page.results.result_parts import ResultParts
from app.page.results.run_view import RunView
from app.page.results.saved_runs import SavedRun, url_of_runs
from app.page.results.tables import Column, beat_speed_source_of, metrics_table
from app.page.routes.media import SharedFolders
from app.run.output.provenance import MOTIONS, NONE, SEED, SPEECH, differing_settings
from app.run.output.run_folder import RunRecord
from app.run.output.viewer_files import read_timeline
from app.run.requests.parts import NUM_WORST_SECONDS
from conventions.colors import colors_of
from conventions.names import REFERENCE_NAME, short_names

MAX_VIDEOS = 12


def comparison_updates(
    a: SavedRun, b: SavedRun, parts: ResultParts, media: SharedFolders, cookie: str
) -> Updates:
    """Return the updates of a tab that opens a comparison in the browser with this cookie."""
    runs = a.view, b.view
    pair = RunPair(*(run.read_only_copy(media.share(run.folder, cookie)) for run in runs))
    links = "".join(
        f'<li><b>{letter}</b><a href="{escape(url_of_runs(run))}">{escape(run.record.title)}</a>'
        for letter, run in zip("AB", (a, b), strict=True)
    )
    updates: Updates = {
        parts.status: markup.sentence_status("Two runs side by side."),
        parts.verdict: update_html(
            f'<div class="verdict pair-head"><ol>{links}</ol>{pair.settings_html()}</div>'
        ),
        parts.player: pair.player_value(),
        parts.numbers: update_html(pair.metrics_table()),
    }
    return updates | {
        part: update_html("") for part in (parts.message, parts.figures, parts.downloads)
    }


class RunPair:
    """Comparison of two runs: A is the earlier one, B the later one."""

    def __init__(self, a: RunView, b: RunView) -> None:
        self.run_views, self.runs = (a, b), (a.record, b.record)
        first, second = (run.speech_sha256 for run in self.runs)
        self.has_same_speech = bool(first) and first == second
        """True if both runs have the same speech file."""
        recorded, again = (run.metrics.get(REFERENCE_NAME) for run in self.runs)
        self.has_same_reference = recorded is not None and recorded == again
        """True if both runs have the same reference motion, as its metrics are equal."""
        names = [[row.name for row in run.rows] for run in self.runs]
        systems = [[name for name in own if name != REFERENCE_NAME] for own in names]
        in_a, in_b = (REFERENCE_NAME if REFERENCE_NAME in own else "" for own in names)
        self.pairs = [*match_motions(*systems), (in_a, "" if self.has_same_reference else in_b)]
        """Names of motions that are compared, the reference last; A has a shared one."""

    def unique_name(self, name: str, letter: str) -> str:
        """Return the name of a motion among those of both runs."""
        is_shared = name == REFERENCE_NAME and self.has_same_reference
        return name if is_shared else f"{name} ({letter})"

    def settings_html(self) -> str:
        """Format the settings that differ, a sentence on the speech, and all settings."""
        return (
            f"<b>{escape(settings_sentence(*self.runs))}</b><p>{escape(self.speech_sentence())}</p>"
            f"{_settings_table(*self.runs)}"
        )

    def speech_sentence(self) -> str:
        """Return a sentence on whether the speech is the same, and what that means."""
        a, b = (run.settings for run in self.runs)
        first, second = a.get(SPEECH, NONE), b.get(SPEECH, NONE)
        if not self.has_same_speech:
            return text.PAIR_OTHER_SPEECH.format(first=first, second=second)
        only_chance = list(differing_settings(a, b)) == [SEED]
        return text.PAIR_ONLY_SEED if only_chance else text.PAIR_ONE_SPEECH.format(speech=first)

    def metrics_table(self) -> str:
        """Format the metrics of both runs and their differences, motion by motion."""
        columns: list[Column] = []
        *systems, references = self.pairs
        for pair in (references, *systems):
            labels = short_names(dict.fromkeys(filter(None, pair)))
            is_shared = pair is references and self.has_same_reference
            run_columns = [
                Column(
                    self.unique_name(name, letter),
                    self.unique_name(labels[name], letter),
                    run.metrics[name],
                    "reference" if is_shared else "",
                    beat_speed_source_of(run),
                )
                for name, letter, run in zip(pair, "AB", self.runs, strict=True)
                if name in run.metrics
            ]
            columns += run_columns
            if len(run_columns) == 2 and pair is not references:
                named = f"{' and '.join(dict.fromkeys(labels.values()))}: {text.PAIR_DIFFERENCE}"
                columns.append(run_columns[1].minus(run_columns[0], named, text.PAIR_DIFFERENCE))
        points = dict.fromkeys(point_title(run.tracked_point) for run in self.runs)
        return metrics_table(columns, " and ".join(points), text.PAIR_LEGEND)

    def player_value(self) -> dict[str, Any]:
        """Return the player's value for both runs, with one sound or a choice of two."""
        values = [run_view.player_value() for run_view in self.run_views]
        lines = [read_timeline(run_view.folder, run_view.record) for run_view in self.run_views]
        rows = self._rows(values)
        value = {"run": " ".join(value["run"] for value in values), "rows": rows}
        if not all(lines):
            return value
        # Different speeches can be chosen; with one speech, or none, the longer sound plays.
        spoken = [i for i, run in enumerate(self.runs) if run.speech_sha256]
        audible = sorted(spoken or (0, 1), key=lambda i: -lines[i].get("duration_s", 0.0))[:1]
        if len(spoken) == 2 and not self.has_same_speech:
            audible = spoken
        names = [row["name"] for row in rows]
        sounds = [
            {
                "label": _sound_label(self.runs[i], "AB"[i]),
                "audio_url": values[i]["audio"],
                "timeline_url": _as_address(self._timeline(lines, i, names, len(audible) == 1)),
            }
            for i in audible
        ]
        first = {kind: sounds[0][f"{kind}_url"] for kind in ("audio", "timeline")}
        return value | first | ({"sounds": sounds} if len(sounds) > 1 else {})

    def _rows(self, values: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
        """Return the rows of both runs, motion by motion, up to the maximum."""
        rows: list[dict[str, Any]] = []
        for names in self.pairs:
            for name, letter, run, value in zip(names, "AB", self.runs, values, strict=True):
                of_seed = f"of seed {run.settings.get(SEED, '')}"
                rows += [
                    {
                        **row,
                        "name": self.unique_name(name, letter),
                        "label": self.unique_name(row["label"], letter),
                        "stem": f"{row['stem']}-{letter}",
                        "noise_key": row["noise_key"] and f"{row['noise_key']} {of_seed}",
                        "compared_run": value["run"],
                    }
                    for row in value["rows"]
                    if row["name"] == name
                ]
        colors = colors_of([row["name"] for row in rows], REFERENCE_NAME)
        return [row | {"color": colors[row["name"]]} for row in rows][:MAX_VIDEOS]

    def _timeline(
        self,
        lines: Sequence[dict[str, Any]],
        sound_index: int,
        names: Sequence[str],
        is_shared: bool,
    ) -> dict[str, Any]:
        """Merge the timelines of both runs for motions that have a row, with the sound of one."""
        curves, worst = {}, []
        for line, letter in zip(lines, "AB", strict=True):
            curves |= {self.unique_name(name, letter): one for name, one in line["curves"].items()}
            worst += [
                {**each, "name": self.unique_name(each["name"], letter)} for each in line["worst"]
            ]
        words = [line["words"] for line in (lines[sound_index], *lines)[: 3 if is_shared else 1]]
        return lines[sound_index] | {
            "curves": {name: curve for name, curve in curves.items() if name in names},
            "worst": merge_worst_seconds([each for each in worst if each["name"] in names]),
            "point": " and ".join(dict.fromkeys(line["point"] for line in lines)),
            "words": next(filter(None, words), []),
        }


def settings_sentence(a: RunRecord, b: RunRecord) -> str:
    differ = differing_settings(a.settings, b.settings)
    brought = [name for name, run in (("A", a), ("B", b)) if MOTIONS in run.settings]
    if len(brought) != 1:
        return _against(differ) or text.PAIR_SAME_SETTINGS
    # Settings of systems do not apply to imported files.
    shared = a.settings.keys() & b.settings.keys()
    sentence = _against({name: pair for name, pair in differ.items() if name in shared})
    return f"{text.PAIR_BROUGHT.format(run=brought[0])} {sentence}".rstrip()


def _against(differ: Mapping[str, tuple[str, str]]) -> str:
    listed = "; ".join(
        f"{name} ({first} in A, {second} in B)" for name, (first, second) in differ.items()
    )
    return f"Different settings: {listed}." if listed else ""


def match_motions(a: Sequence[str], b: Sequence[str]) -> list[tuple[str, str]]:
    """Pair the motions of two runs by name; a single remaining motion of each run is paired too.

    The name of a missing partner is empty.
    """
    only_a, only_b = ([one for one in own if one not in other] for own, other in ((a, b), (b, a)))
    pairs = [(name, name) for name in a if name in b]
    if len(only_a) == len(only_b) == 1:
        return [*pairs, (only_a[0], only_b[0])]
    return [*pairs, *((name, "") for name in only_a), *(("", name) for name in only_b)]


def _sound_label(run: RunRecord, letter: str) -> str:
    speech = run.settings.get(SPEECH, NONE)
    return letter if speech == NONE else f"{letter}: {speech}"


def _as_address(timeline: Mapping[str, Any]) -> str:
    data = base64.b64encode(json.dumps(timeline).encode()).decode("ascii")
    return f"data:application/json;base64,{data}"


def merge_worst_seconds(seconds: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Merge lists of worst seconds into one without overlap, of at most `NUM_WORST_SECONDS`."""
    chosen: list[dict[str, Any]] = []

    def badness_rank(second: Mapping[str, Any]) -> float:
        return -second.get("jerk_m_s3", math.inf if second.get("is_gravest") else 0.0)

    for each in sorted(seconds, key=badness_rank):
        if all(each["start_s"] >= k["end_s"] or each["end_s"] <= k["start_s"] for k in chosen):
            chosen.append(each)
    return chosen[:NUM_WORST_SECONDS]


def _settings_table(a: RunRecord, b: RunRecord) -> str:
    """Format a table of all settings of both runs, differing ones first."""
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
        f"<details><summary>All settings</summary><table><thead>{head}</thead>"
        f"<tbody>{rows}</tbody></table></details>"
    )
