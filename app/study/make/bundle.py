"""What stands beside the videos: the page for participants, the same trials for other study tools,
and what the researcher keeps besides the key. Its texts are the templates beside this file."""

from __future__ import annotations

import datetime
import functools
import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import jinja2

from app.run.models import get_body, get_system
from app.run.output.provenance import describe_systems, versions
from app.study.design.blinding import Blinding, blind_lists
from app.study.design.key import Question
from app.study.design.plan import Plan, questions_of, wording
from app.study.design.trials import Design, measure_balance, size_of
from app.study.make import media
from app.study.make.motions import Source
from app.study.make.workspace import ExportOptions, Workspace
from model.storage.harmless import csv_text, markdown

SITE = Path(__file__).with_name("site")
INDEX, DATA = "index.html", "study-data.js"
FIXED = ("study.js", "study.css", "README.txt")
"""Files that are the same in every study."""
FREE_TEXTS = ("title", "consent", "researchers", "contact", "ethics", "postTo", "returnTo")
"""What the researcher wrote, as the page's script reads it."""
DATA_START = "window.STUDY = "
_SHARED_WORDS = (
    *("attention", "buttons", "slider", "consent", "headphones", "practice", "preview"),
    *("progress", "finish", "problems"),
)
Shown = Sequence[tuple[str, list[str]]]
"""Trials of a list with the blind ids of what they show."""


@functools.cache
def templates() -> jinja2.Environment:
    env = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        autoescape=jinja2.select_autoescape(["html"]),
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
    )
    env.filters["md"] = markdown
    return env


def write_bundle(plan: Plan, design: Design, blinding: Blinding, workspace: Workspace) -> None:
    """Write everything but the videos, and give all files of the bundle the same time."""
    for name in FIXED:
        workspace.write_text(workspace.bundle / name, (SITE / name).read_text("utf-8"))
    workspace.write_text(workspace.bundle / INDEX, index_html(plan.title, plan.post_to))
    data = json.dumps(page_data(plan, design, blinding), ensure_ascii=True, separators=(",", ":"))
    workspace.write_text(workspace.bundle / DATA, f"{DATA_START}{data};\n")
    for path in (*workspace.bundle.rglob("*"), workspace.bundle):
        media.set_time(path)


def index_html(title: str, post_to: str | None) -> str:
    """The page with a policy that lets it load its own files and reach one address at most."""
    parts = urlsplit(post_to) if post_to else None
    return (
        templates()
        .get_template(f"site/{INDEX}")
        .render(
            title=title,
            connect=f"{parts.scheme}://{parts.netloc}" if parts else "'none'",
            no_script=wording()["problems"]["script"],
        )
    )


def page_data(plan: Plan, design: Design, blinding: Blinding) -> dict[str, Any]:
    """What the page's script reads. Trials stand in the order of their random ids."""
    trials = {
        trial_id: {"kind": trial.kind, **({"press": trial.press} if trial.press else {})}
        for trial_id, trial in sorted(zip(blinding.trials, design.trials, strict=True))
    }
    return {
        "study": blinding.study,
        "title": plan.title,
        "sound": plan.has_sound,
        "postTo": plan.post_to,
        "returnTo": plan.return_to,
        "minutes": size_of(plan, design).minutes,
        **{name: getattr(plan, name) for name in ("consent", "researchers", "contact", "ethics")},
        "trials": trials,
        "lists": blind_lists(design, blinding),
        **fixed_words(plan.protocol),
        "reasons": wording()["reasons"] if plan.reasons and plan.protocol == "pairwise" else None,
    }


def fixed_words(protocol: str) -> dict[str, Any]:
    """The sentences that are the same in every study of a protocol."""
    words = wording()
    return {
        "instruction": words["protocols"][protocol]["instruction"],
        "questions": [vars(question) for question in questions_of(protocol)],
        "words": {name: words[name] for name in _SHARED_WORDS},
    }


def write_records(
    plan: Plan,
    design: Design,
    blinding: Blinding,
    sources: Sequence[Source],
    options: ExportOptions,
    workspace: Workspace,
) -> None:
    """Write adapters, ``manifest.json``, ``provenance.json``, ``README.md`` and
    ``preregistration.md``."""
    balance = measure_balance(design)
    lists = blind_lists(design, blinding)
    manifest = {
        "study": blinding.study,
        "title": plan.title,
        "protocol": plan.protocol,
        "clips": {
            source.clip.name: {
                "speech": source.clip.speech.name if source.clip.speech else None,
                "start_s": source.clip.start_s,
                "frames": source.num_frames,
            }
            for source in sources
        },
        "videos": {
            blind: {**asdict(stimulus), "bytes": workspace.video(blind).stat().st_size}
            for stimulus, blind in sorted(blinding.videos.items(), key=lambda item: item[1])
        },
        "lists": {
            str(number): [{"trial": trial, "shown": shown} for trial, shown in pages]
            for number, pages in enumerate(lists)
        },
        "balance": asdict(balance),
    }
    private = workspace.private
    workspace.write_json(private / "manifest.json", manifest)
    workspace.write_json(private / "provenance.json", _provenance(plan, sources, options))
    about = {
        "plan": plan,
        "balance": balance,
        "size": size_of(plan, design).sentence(),
        "questions": questions_of(plan.protocol),
        "num_trials": sum(trial.kind != "attention" for trial in design.trials),
        "per_person": len(design.lists[0]) - plan.attention_checks,
    }
    for name, template in (("README.md", "researcher"), ("preregistration.md", "preregistration")):
        text = templates().get_template(f"{template}.md.j2").render(about)
        workspace.write_text(private / name, text)
    for number, pages in enumerate(lists):
        shown = [(trial, videos) for trial, videos in pages if videos]  # no checks
        for tool, made in (("hemvip", hemvip_config), ("jspsych", jspsych_timeline)):
            name = {"hemvip": "subj", "jspsych": "timeline"}[tool]
            path = private / "adapters" / tool / f"{name}_{number:03d}.json"
            workspace.write_json(path, made(plan, shown))
    for name, table in genea_tables(plan, design, blinding).items():
        workspace.write_text(private / "adapters" / "genea" / name, table)


def _provenance(plan: Plan, sources: Sequence[Source], options: ExportOptions) -> dict[str, Any]:
    names = {system.system for system in plan.systems if system.system is not None}
    body = get_body(options.body)
    settings = ("system", "seed", "speaker", "steps", "sampler", "post_filter", "style")
    return {
        "made_at": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "versions": versions(),
        "weights": describe_systems([get_system(name, options.weights) for name in sorted(names)]),
        "systems": {
            system.name: {
                "generator": {name: asdict(system)[name] for name in settings}
                if system.motion is None
                else None,
                "motions": _file_names(system.motion),
                "plans": _file_names(system.plan),
            }
            for system in plan.systems
        },
        "files_sha256": {source.clip.name: dict(source.files) for source in sources},
        "drawing": {
            "body": body.name,
            "body_sha256": body.sha256,
            "views": list(plan.views),
            "size": plan.size,
            "face": plan.face,
        },
        "encoding": {
            "bits_per_second": media.bit_rate(plan.size),
            "loudness_lufs": media.TARGET_LUFS if plan.has_sound else None,
        },
    }


def _file_names(files: Any) -> dict[str, str] | None:
    return None if files is None else {clip: path.name for clip, path in files.items()}


# Configurations of other study tools, with the same blind ids as everywhere. They stay with the
# researcher: HEMVIP and the GENEA tools have their own servers and pages. Attention checks are not
# part of them, as each of these tools wants special videos for its own.


def hemvip_config(plan: Plan, shown: Shown) -> dict[str, Any]:
    """One participant's experiment for HEMVIP (github.com/jonepatr/hemvip): pages of sliders, also
    in place of a ranking, which it has not, or of left, right and equal; each stimulus a pair of
    condition and address."""
    words = wording()
    pages = [
        {
            "type": "videopc" if plan.protocol in ("pairwise", "matched") else "video",
            "id": f"{trial}-{question.id}",
            "name": f"Page {number} of {len(shown)}",
            "content": words["protocols"][plan.protocol]["instruction"],
            "question": question.text,
            "stimuli": [[video, _address(plan, video)] for video in videos],
        }
        for number, (trial, videos) in enumerate(shown, start=1)
        for question in questions_of(plan.protocol)
    ]
    first = {"type": "generic", "id": "consent", "name": plan.title, "content": _consent(plan)}
    last = {
        "type": "finish",
        "name": words["finish"]["heading"],
        "content": words["finish"]["text"],
    }
    return {
        "testname": plan.title,
        "stopOnErrors": True,
        "remoteService": "/save",
        "pages": [first, *pages, {**last, "showResults": False, "writeResults": True}],
    }


def genea_tables(plan: Plan, design: Design, blinding: Blinding) -> dict[str, str]:
    """Pairs of blind ids for the GENEA leaderboard (github.com/GENEALeaderboard), one row for each
    trial; the trial's id takes the clip's place.

    The table of mismatched speech tells the GENEA server which video is which, as it must.
    Studies that rank or rate more than two videos have no such table.
    """
    name, header = {
        "pairwise": ("pairwise.csv", ["clip_name", "system_1", "system_2"]),
        "matched": ("mismatch.csv", ["clip_name", "system", "mismatch_type", "mismatch_data"]),
    }.get(plan.protocol, ("", []))
    table = []
    for trial, planned in zip(blinding.trials, design.trials, strict=True):
        if planned.kind == "pair":
            table.append([trial, *(blinding.videos[each] for each in planned.stimuli)])
        elif planned.kind == "match":
            right, wrong = sorted(planned.stimuli, key=lambda one: one.speech != one.clip)
            table.append([trial, blinding.videos[right], "speech", blinding.videos[wrong]])
    return {name: csv_text([header, *sorted(table)], line_end="\n")} if name else {}


def jspsych_timeline(plan: Plan, shown: Shown) -> list[dict[str, Any]]:
    """One participant's timeline for jsPsych 8, types being the plugins' global variables: each
    video alone to its end, then the questions."""
    buttons = wording()["buttons"]
    films = sorted({_address(plan, video) for _, videos in shown for video in videos})
    agree = {"stimulus": _consent(plan), "choices": [wording()["consent"]["agree"]]}
    timeline: list[dict[str, Any]] = [
        {"type": "jsPsychPreload", "video": films},
        {"type": "jsPsychHtmlButtonResponse", **agree},
    ]
    for trial, videos in shown:
        timeline += [
            {
                "type": "jsPsychVideoButtonResponse",
                "stimulus": [_address(plan, video)],
                "choices": [buttons["next"]],
                "response_allowed_while_playing": False,
                "data": {"trial": trial, "video": video, "shown": videos},
            }
            for video in videos
        ]
        for question in questions_of(plan.protocol):
            data = {"trial": trial, "question": question.id, "shown": videos}
            timeline += _jspsych_questions(question, videos, data)
    return timeline


def _jspsych_questions(
    question: Question, videos: Sequence[str], data: dict[str, Any]
) -> Iterator[dict[str, Any]]:
    words = wording()
    buttons = words["buttons"]
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
                "labels": [words["slider"]["low"], words["slider"]["high"]],
                "require_movement": True,
                "data": {**data, "video": video},
            }
    else:
        ranks = "".join(
            f'<p><label>{number}: <input type="number" name="{video}" min="1" '
            f'max="{len(videos)}" required></label></p>'
            for number, video in enumerate(videos, start=1)
        )
        asked = {"preamble": question.text, "html": ranks, "data": data}
        yield {"type": "jsPsychSurveyHtmlForm", **asked}


def _consent(plan: Plan) -> str:
    return plan.consent or wording()["consent"]["text"].strip()


def _address(plan: Plan, video: str) -> str:
    folder = (plan.hosted_at or "").rstrip("/")
    return f"{folder}/media/{video}.mp4" if folder else f"media/{video}.mp4"
