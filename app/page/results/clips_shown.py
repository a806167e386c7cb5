"""Several clips of one run: the verdict over them, and a row for each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

from app import text
from app.errors import page_sentence, without_folders
from app.findings.comparison import plain, point_title
from app.findings.verdict import jerk_over_clips, verdict_over_clips
from app.page.parts import markup
from app.run.many.table import interval
from app.run.output.run_folder import RunRecord
from conventions.names import short_names


def title_of(records: Sequence[RunRecord]) -> str:
    """Of a run, or of several clips that are one."""
    if len(records) < 2:
        return records[0].title
    asked = records[0].settings.get("systems", "")
    return text.CLIPS_TITLE.format(count=len(records), systems=asked)


def clips_html(runs: Mapping[str, RunRecord]) -> str:
    """Of runs by clip, each system's headline number in every clip; empty of one run alone."""
    if len(runs) < 2:
        return ""
    point = next(iter(runs.values())).point
    jerk = jerk_over_clips(run.numbers for run in runs.values())
    verdict = verdict_over_clips(point, jerk)
    above = "" if verdict is None else markup.verdict(verdict.numbers, verdict.judgement)
    names = short_names(jerk)
    rows = [
        _row(clip, [plain(of[number]) if number in of else "…" for of in jerk.values()], run)
        for number, (clip, run) in enumerate(runs.items(), 1)
    ]
    means = [interval(list(of.values())) for of in jerk.values()]
    cells = [f"{plain(mean)} [{plain(low)}, {plain(high)}]" for mean, low, high in means]
    head = "".join(
        f'<th scope="col" title="{escape(name)}">{escape(names[name])}</th>' for name in jerk
    )
    title = text.CLIPS_TABLE.format(point=point_title(point))
    return (
        f'<div class="measures all clips">{above}<p>{escape(title)}</p>'
        f'<div class="scroll" role="region" aria-label="{escape(title)}" tabindex="0"><table>'
        f'<thead><tr><th scope="col">{text.CLIP}</th>{head}</tr></thead>'
        f"<tbody>{''.join(rows)}</tbody>"
        f"<tfoot>{_row(text.CLIPS_MEAN, cells)}</tfoot></table></div></div>"
    )


def _row(title: str, cells: list[str], run: RunRecord | None = None) -> str:
    if run is not None and run.state in ("failed", "cancelled"):
        why = escape(page_sentence(without_folders(run.sentence)) or text.STOPPED)
        return f'<tr><th scope="row">{escape(title)}</th><td colspan="{len(cells)}">{why}</td></tr>'
    told = "".join(f"<td>{escape(cell)}</td>" for cell in cells)
    return f'<tr><th scope="row">{escape(title)}</th>{told}</tr>'
