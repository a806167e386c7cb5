"""Study files other than videos, from the templates in this folder: page, tables, records."""

from __future__ import annotations

import datetime
import functools
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import jinja2

from app.run.models import get_body, get_system
from app.run.output.provenance import describe_systems, software_versions
from app.study.design.blinding import lists_with_ids, stimulus_ids
from app.study.design.key import Stimulus, StudyKey
from app.study.design.plan import StudyPlan, load_wording, protocol_questions
from app.study.design.trials import Design, measure_balance, study_minutes_and_summary
from app.study.make import media
from app.study.make.export_folders import ExportFolders
from app.study.make.motions import ClipInputs
from model.storage.escaping import csv_text, escape_markdown
from model.storage.json_validation import type_adapter

SITE = Path(__file__).with_name("site")
INDEX, DATA = "index.html", "study-data.js"
_WEB = SITE.parents[2] / "page" / "web"
SHARED_FILES = {
    **{name: SITE / name for name in ("study.js", "study.css", "README.txt")},
    **{name: _WEB / name for name in ("inter.woff2", "inter-OFL.txt")},
}
"""Files that are the same in every study, by name; the typeface is the page's."""
FREE_TEXTS = (
    *("title", "consent", "researchers", "contact", "ethics", "postTo", "returnTo"),
    "panelIds",
)
"""Fields of the page's data that the researcher wrote."""
DATA_START = "window.STUDY = "
_SHARED_WORDS = (
    *("attention", "buttons", "slider", "consent", "headphones", "practice", "preview"),
    *("progress", "finish", "problems"),
)


@functools.cache
def templates() -> jinja2.Environment:
    env = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        autoescape=jinja2.select_autoescape(["html"]),
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
    )
    env.filters["md"] = escape_markdown
    return env


def finish_bundle(plan: StudyPlan, design: Design, key: StudyKey, folders: ExportFolders) -> None:
    """Write all files but the videos, then set the same time on all files, videos included."""
    for name, source in SHARED_FILES.items():
        folders.write(folders.bundle / name, source.read_bytes())
    folders.write(folders.bundle / INDEX, index_html(plan.title, plan.post_to))
    data = json.dumps(page_data(plan, design, key), ensure_ascii=True, separators=(",", ":"))
    folders.write(folders.bundle / DATA, f"{DATA_START}{data};\n")
    for path in (*folders.bundle.rglob("*"), folders.bundle):
        media.set_fixed_mtime(path)


def index_html(title: str, post_to: str | None) -> str:
    """Return the page, with a policy that allows its own files and at most one address."""
    parts = urlsplit(post_to) if post_to else None
    return (
        templates()
        .get_template(f"site/{INDEX}")
        .render(
            title=title,
            connect=f"{parts.scheme}://{parts.netloc}" if parts else "'none'",
            no_script=load_wording()["problems"]["script"],
        )
    )


def page_data(plan: StudyPlan, design: Design, key: StudyKey) -> dict[str, Any]:
    """Return the JSON for the page's script; trials are sorted by their random ids."""
    trials = {
        trial_id: {
            "kind": trial.kind,
            **({"press": trial.required_answer} if trial.required_answer else {}),
        }
        for trial_id, trial in sorted(zip(key.trials, design.trials, strict=True))
    }
    return {
        "study": key.study_id,
        "title": plan.title,
        "sound": plan.has_sound,
        "postTo": plan.post_to,
        "returnTo": plan.return_to,
        "panelIds": plan.panel_id_names,
        "minutes": study_minutes_and_summary(plan, design)[0],
        **{name: getattr(plan, name) for name in ("consent", "researchers", "contact", "ethics")},
        "trials": trials,
        "lists": lists_with_ids(design, key),
        **shared_wording(plan.protocol),
        "reasons": load_wording()["reasons"]
        if plan.asks_reasons and plan.protocol == "pairwise"
        else None,
    }


def shared_wording(protocol: str) -> dict[str, Any]:
    """Return the sentences that are the same in every study of a protocol."""
    words = load_wording()
    return {
        "instruction": words["protocols"][protocol]["instruction"],
        "questions": [vars(question) for question in protocol_questions(protocol)],
        "words": {name: words[name] for name in _SHARED_WORDS},
    }


def write_records(
    plan: StudyPlan,
    design: Design,
    key: StudyKey,
    sources: Sequence[ClipInputs],
    weights: Path,
    body: Path | None,
    folders: ExportFolders,
) -> None:
    """Write the researcher's records other than the key."""
    balance = measure_balance(design)
    lists = lists_with_ids(design, key)
    manifest = {
        "study": key.study_id,
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
            blind: {
                **type_adapter(Stimulus).dump_python(stimulus, by_alias=True),
                "bytes": folders.video(blind).stat().st_size,
            }
            for stimulus, blind in stimulus_ids(key).items()
        },
        "lists": {
            str(number): [{"trial": trial, "shown": shown} for trial, shown in pages]
            for number, pages in enumerate(lists)
        },
        "balance": asdict(balance),
    }
    private = folders.private
    folders.write_json(private / "manifest.json", manifest)
    folders.write_json(private / "provenance.json", _provenance(plan, sources, weights, body))
    about = {
        "plan": plan,
        "balance": balance,
        "effort": study_minutes_and_summary(plan, design)[1],
        "questions": protocol_questions(plan.protocol),
        "num_trials": sum(trial.kind != "attention" for trial in design.trials),
        "per_person": len(design.lists[0]) - design.num_checks,
        "num_checks": design.num_checks,
        "max_failed": design.max_failed(plan),
    }
    for name, template in (("README.md", "researcher"), ("preregistration.md", "preregistration")):
        text = templates().get_template(f"{template}.md.j2").render(about)
        folders.write(private / name, text)
    for name, table in genea_tables(plan, design, key).items():
        folders.write(private / "adapters" / "genea" / name, table)


def _provenance(
    plan: StudyPlan, sources: Sequence[ClipInputs], weights: Path, body: Path | None
) -> dict[str, Any]:
    drawn = get_body(body)
    names = {system.system for system in plan.conditions if system.system is not None}
    settings = ("system", "seed", "speaker", "steps", "sampler", "post_filter", "style")
    return {
        "made_at": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "versions": software_versions(),
        "weights": describe_systems([get_system(name, weights) for name in sorted(names)]),
        "systems": {
            system.name: {
                "generator": {name: asdict(system)[name] for name in settings}
                if system.motion is None
                else None,
                "motions": _file_names(system.motion),
                "plans": _file_names(system.plan),
            }
            for system in plan.conditions
        },
        "files_sha256": {source.clip.name: dict(source.file_sha256s) for source in sources},
        "drawing": {
            "body": drawn.name,
            "body_sha256": drawn.sha256,
            "views": list(plan.views),
            "size": plan.video_size_px,
            "face": plan.face,
        },
        "encoding": {
            "bits_per_second": media.bit_rate(plan.video_size_px),
            "loudness_lufs": media.TARGET_LUFS if plan.has_sound else None,
        },
    }


def _file_names(files: Any) -> dict[str, str] | None:
    return None if files is None else {clip: path.name for clip, path in files.items()}


def genea_tables(plan: StudyPlan, design: Design, key: StudyKey) -> dict[str, str]:
    """Return tables of blind ids for the GENEA leaderboard (github.com/GENEALeaderboard), by name.

    One row per trial; the trial's id replaces the clip's name. The table of mismatched speech
    reveals to the GENEA server which video is which, as it must. Studies that rank or rate more
    than two videos have no such table.
    """
    name, header = {
        "pairwise": ("pairwise.csv", ["clip_name", "system_1", "system_2"]),
        "matched": ("mismatch.csv", ["clip_name", "system", "mismatch_type", "mismatch_data"]),
    }.get(plan.protocol, ("", []))
    table, videos = [], stimulus_ids(key)
    for trial, planned in zip(key.trials, design.trials, strict=True):
        if planned.kind == "pair":
            table.append([trial, *(videos[each] for each in planned.stimuli)])
        elif planned.kind == "match":
            right, wrong = sorted(planned.stimuli, key=lambda one: not one.has_own_speech)
            table.append([trial, videos[right], "speech", videos[wrong]])
    return {name: csv_text([header, *sorted(table)], line_end="\n")} if name else {}
