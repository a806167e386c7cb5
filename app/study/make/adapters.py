"""Configurations of other study tools, with the same blind ids as everywhere.

They stay with the researcher: HEMVIP and the GENEA tools have their own servers and pages.
Attention checks are not part of them, as each of these tools wants special videos for its own.

HEMVIP (github.com/jonepatr/hemvip): ``pages`` of type ``video`` (sliders) and ``videopc`` (left,
right or equal), each stimulus a pair of condition and address. GENEA leaderboard
(github.com/GENEALeaderboard): CSV of ``clip_name, system_1, system_2``, or for mismatched speech
``clip_name, system, mismatch_type, mismatch_data``. jsPsych 8: a timeline as JSON, in which types
are the names of the plugins' global variables.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from app.study.design.blinding import Blinding, blind_lists
from app.study.design.key import Question
from app.study.design.plan import Plan, questions_of, wording
from app.study.design.trials import Design
from app.study.make.workspace import Workspace
from model.storage.harmless import csv_text


def write_adapters(plan: Plan, design: Design, blinding: Blinding, workspace: Workspace) -> None:
    """Write ``researcher_only/adapters``: one file for each participant, or one table for all."""
    folder = workspace.private / "adapters"
    for number, pages in enumerate(blind_lists(design, blinding)):
        shown = [(trial, videos) for trial, videos in pages if videos]  # no checks
        hemvip = hemvip_config(plan, shown)
        workspace.write_json(folder / "hemvip" / f"subj_{number:03d}.json", hemvip)
        timeline = jspsych_timeline(plan, shown)
        workspace.write_json(folder / "jspsych" / f"timeline_{number:03d}.json", timeline)
    for name, table in genea_tables(plan, design, blinding).items():
        workspace.write_text(folder / "genea" / name, table)


def hemvip_config(plan: Plan, shown: Sequence[tuple[str, list[str]]]) -> dict[str, Any]:
    """One participant's experiment. HEMVIP has no ranking; sliders take its place there."""
    is_pair = plan.protocol in ("pairwise", "matched")
    instruction = wording()["protocols"][plan.protocol]["instruction"]
    pages = [
        {
            "type": "videopc" if is_pair else "video",
            "id": f"{trial}-{question.id}",
            "name": f"Page {number} of {len(shown)}",
            "content": instruction,
            "question": question.text,
            "stimuli": [[video, _address(plan, video)] for video in videos],
        }
        for number, (trial, videos) in enumerate(shown, start=1)
        for question in questions_of(plan.protocol)
    ]
    first = {"type": "generic", "id": "consent", "name": plan.title, "content": _consent(plan)}
    last = {
        "type": "finish",
        "name": wording()["finish"]["heading"],
        "content": wording()["finish"]["text"],
        "showResults": False,
        "writeResults": True,
    }
    return {
        "testname": plan.title,
        "stopOnErrors": True,
        "remoteService": "/save",
        "pages": [first, *pages, last],
    }


def genea_tables(plan: Plan, design: Design, blinding: Blinding) -> dict[str, str]:
    """Pairs of blind ids, one row for each trial; the trial's id takes the clip's place.

    The table of mismatched speech tells the GENEA server which video is which, as it must.
    Studies that rank or rate more than two videos have no such table.
    """
    if plan.protocol not in ("pairwise", "matched"):
        return {}
    rows = [
        (blinding.trials[index], trial.stimuli)
        for index, trial in enumerate(design.trials)
        if trial.kind != "attention"
    ]
    if plan.protocol == "pairwise":
        header = ["clip_name", "system_1", "system_2"]
        table = [[trial, *(blinding.videos[each] for each in pair)] for trial, pair in rows]
        return {"pairwise.csv": csv_text([header, *sorted(table)], line_end="\n")}
    header = ["clip_name", "system", "mismatch_type", "mismatch_data"]
    table = []
    for trial, pair in rows:
        right, wrong = sorted(pair, key=lambda stimulus: stimulus.speech != stimulus.clip)
        table.append([trial, blinding.videos[right], "speech", blinding.videos[wrong]])
    return {"mismatch.csv": csv_text([header, *sorted(table)], line_end="\n")}


def jspsych_timeline(plan: Plan, shown: Sequence[tuple[str, list[str]]]) -> list[dict[str, Any]]:
    """One participant's timeline: each video alone to its end, then the questions."""
    words = wording()
    agree = words["consent"]["agree"]
    timeline: list[dict[str, Any]] = [
        {
            "type": "jsPsychPreload",
            "video": sorted({_address(plan, v) for _, vs in shown for v in vs}),
        },
        {"type": "jsPsychHtmlButtonResponse", "stimulus": _consent(plan), "choices": [agree]},
    ]
    for trial, videos in shown:
        timeline += [
            {
                "type": "jsPsychVideoButtonResponse",
                "stimulus": [_address(plan, video)],
                "choices": [words["buttons"]["next"]],
                "response_allowed_while_playing": False,
                "data": {"trial": trial, "video": video, "shown": videos},
            }
            for video in videos
        ]
        for question in questions_of(plan.protocol):
            data = {"trial": trial, "question": question.id, "shown": videos}
            timeline += list(_jspsych_questions(question, videos, data))
    return timeline


def _jspsych_questions(
    question: Question, videos: Sequence[str], data: dict[str, Any]
) -> Iterator[dict[str, Any]]:
    buttons = wording()["buttons"]
    if question.kind == "choice":
        yield {
            "type": "jsPsychHtmlButtonResponse",
            "stimulus": question.text,
            "choices": [buttons["left"], buttons["tie"], buttons["right"]],
            "data": {**data, "values": [videos[0], "tie", videos[-1]]},
        }
    elif question.kind == "slider":
        for number, video in enumerate(videos, start=1):
            yield {
                "type": "jsPsychHtmlSliderResponse",
                "stimulus": f"{question.text} ({number})",
                "labels": [wording()["slider"]["low"], wording()["slider"]["high"]],
                "require_movement": True,
                "data": {**data, "video": video},
            }
    else:
        ranks = "".join(
            f'<p><label>{number}: <input type="number" name="{video}" min="1" '
            f'max="{len(videos)}" required></label></p>'
            for number, video in enumerate(videos, start=1)
        )
        yield {
            "type": "jsPsychSurveyHtmlForm",
            "preamble": question.text,
            "html": ranks,
            "data": data,
        }


def _consent(plan: Plan) -> str:
    return plan.consent or wording()["consent"]["text"].strip()


def _address(plan: Plan, video: str) -> str:
    folder = plan.hosted_at.rstrip("/")
    return f"{folder}/media/{video}.mp4" if folder else f"media/{video}.mp4"
