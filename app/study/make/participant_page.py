"""The page for participants: its fixed files, and one file with what is special to a study."""

from __future__ import annotations

import html
import json
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from app.study.design.blinding import Blinding, blind_lists
from app.study.design.plan import Plan, questions_of, wording
from app.study.design.size import size_of
from app.study.design.trials import KIND_OF_PROTOCOL, Design
from app.study.make.media import set_time
from app.study.make.workspace import Workspace

SITE = Path(__file__).with_name("site")
SCRIPT, STYLE, INDEX, DATA = "study.js", "study.css", "index.html", "study-data.js"
DATA_START = "window.STUDY = "
_SHARED_WORDS = (
    *("attention", "buttons", "slider", "consent", "headphones", "practice", "preview"),
    *("progress", "finish", "problems"),
)


def write_page(plan: Plan, design: Design, blinding: Blinding, workspace: Workspace) -> None:
    """Write everything but the videos, and give all files of the bundle the same time."""
    for name in (SCRIPT, STYLE):
        workspace.write_text(workspace.bundle / name, (SITE / name).read_text("utf-8"))
    workspace.write_text(workspace.bundle / INDEX, index_html(plan.title, plan.post_to))
    data = json.dumps(page_data(plan, design, blinding), ensure_ascii=True, separators=(",", ":"))
    workspace.write_text(workspace.bundle / DATA, f"{DATA_START}{data};\n")
    for path in (*workspace.bundle.rglob("*"), workspace.bundle):
        set_time(path)


def index_html(title: str, post_to: str | None) -> str:
    """The page with a policy that lets it load its own files and reach one address at most."""
    parts = urlsplit(post_to) if post_to else None
    connect = f"{parts.scheme}://{parts.netloc}" if parts else "'none'"
    text = (SITE / INDEX).read_text("utf-8")
    problem = wording()["problems"]["script"]
    for mark, value in (("connect", connect), ("title", title), ("no-script", problem)):
        text = text.replace("{{" + mark + "}}", html.escape(value, quote=False))
    return text


def page_data(plan: Plan, design: Design, blinding: Blinding) -> dict[str, Any]:
    """What the page's script reads. Trials stand in the order of their random ids."""
    words = wording()
    trials = {
        trial_id: {"kind": trial.kind, **({"press": trial.press} if trial.press else {})}
        for trial_id, trial in sorted(zip(blinding.trials, design.trials, strict=True))
    }
    has_reasons = plan.has_reasons and KIND_OF_PROTOCOL[plan.protocol] == "pair"
    return {
        "study": blinding.study,
        "title": plan.title,
        "sound": plan.has_sound,
        "postTo": plan.post_to,
        "returnTo": plan.return_to,
        "minutes": size_of(plan, design).minutes,
        "consent": plan.consent,
        "trials": trials,
        "lists": blind_lists(design, blinding),
        **fixed_words(plan.protocol),
        "reasons": words["reasons"] if has_reasons else None,
    }


def fixed_words(protocol: str) -> dict[str, Any]:
    """The sentences that are the same in every study of a protocol."""
    words = wording()
    return {
        "instruction": words["protocols"][protocol]["instruction"],
        "questions": [vars(question) for question in questions_of(protocol)],
        "words": {name: words[name] for name in _SHARED_WORDS},
    }
