"""Hostile strings in names, words, notes, plans and links of studies: none runs, none is injected.

Four views in Chromium: a run on the page, the same as a file, a study for participants, its report.
"""

import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from urllib.parse import quote

import pytest
from playwright.sync_api import BrowserContext, Dialog, Page, expect

from app.config import AppConfig
from app.page.html_export import standalone_html
from app.run.bodies import PointTracker
from app.run.output.run_folder import FindingRecord, RunRecord, VerdictRecord, locked_record
from app.run.timeline import make_timeline
from app.study.analyse import AnalysisRequest, analyse
from model.plan.files import write_plan_file
from model.plan.plan import GesturePlan, HandPhase
from model.speech.audio import load_speech
from model.speech.transcript import Transcript, Word
from tests.app.fakes import made_motion
from tests.app.page.results.made_run import made_run
from tests.app.study import made
from tests.app.study.made_study import make_study
from tests.browser.conftest import WIDTHS, Fake, opened, ready, served, watched

pytestmark = [pytest.mark.browser, pytest.mark.slow]

RUN = "document.documentElement.dataset.ran=1"
TAG = "data-injected"
HOSTILE = [
    f"<script>{RUN}</script>", f"</script><script {TAG}>{RUN}</script>", f"<b {TAG}>bold</b>",
    f"<img {TAG} src=x onerror={RUN}>", f'"><img {TAG} src=x onerror="{RUN}">',
    f"'><svg {TAG} onload='{RUN}'>", f"<svg {TAG}><script>{RUN}</script></svg>",
    f"<svg {TAG}><animate onbegin={RUN} attributeName=x dur=1s>", f"<iframe {TAG} srcdoc='<b>'>",
    f"<details {TAG} open ontoggle={RUN}>", f"<style {TAG}>*{{display:none}}</style>",
    f"</style><p {TAG}>", f"</title><p {TAG}>", f"</textarea><p {TAG}>", f"<!--><p {TAG}>-->",
    f"<a {TAG} href=javascript:{RUN}>click</a>", f'" onmouseover="{RUN}" autofocus="',
    f"' onfocus='{RUN}' tabindex='0", f"` onclick=`{RUN}`", f"<base {TAG} href=//evil.example/>",
    f"<meta {TAG} http-equiv=refresh content='0;url=//evil.example'>", f"<form {TAG}><input>",
    f"<link {TAG} rel=stylesheet href=//evil.example/x.css>", f"<x {TAG} style=position:fixed>",
    f"<math {TAG}><mtext><img src=x onerror={RUN}>", f"<template {TAG}>",
    f"&lt;img {TAG} src=x&gt;",
    f"&#60;script&#62;{RUN}&#60;/script&#62;", f"javascript:{RUN}", f"data:text/html,<b {TAG}>",
    f"';{RUN};//", f'";{RUN};//', f"\\';{RUN};//", f"${{{RUN}}}", f"`;{RUN};`", f"*/{RUN}/*",
    "{{7*7}}", "{% raw %}", "{{constructor.constructor('x')()}}", "<%= 7*7 %>", "#{7*7}", "$&$1$`",
    f"[a](javascript:{RUN})", f"![a](x{TAG})", "**b** _i_ `c` | t | u |", "$x^2$ $$\\frac{1}{0}$$",
    "__proto__", "constructor", "toString", "../../etc/passwd", "%00%2e%2e%2f", "=1+1", "@SUM(A1)",
    "+cmd|' /C calc'!A0", "-2+3", "\u202eevil\u202c", "\u200b\ufeff\u2066x", "e\u0301" * 40,
    "\u0627\u0644\u0639", "日本語テキスト",
    "\U0001f469\u200d\U0001f467", "Z" * 180, "W W " * 45, "\u0430dmin", "ﷺ" * 30,
    "null", "undefined", "NaN", "-0", "1e999", "true", "[object Object]", " ", "\\", '"', "'", "<",
]  # fmt: skip
NAMES = [text for text in HOSTILE if "/" not in text and text.isprintable() and text.strip()]
SENSED = f"""() => [document.documentElement.dataset.ran,
    ...[...document.querySelectorAll('[{TAG}]')].map((each) => each.outerHTML.slice(0, 100)),
    ...[...document.querySelectorAll('iframe')].filter((each) => each.srcdoc).map(() => 'a frame'),
    ...[...document.querySelectorAll('*')].flatMap((each) => [...each.attributes])
      .filter(({{ name, value }}) => /^on/.test(name) && value.includes('dataset.ran'))
      .map(({{ name, value }}) => name + value),
].filter(Boolean)"""
"""What has run, or was injected, as an element or an attribute."""


class Sense:
    """Requests to other hosts, and dialogs, of the pages of a browser."""

    def __init__(self, context: BrowserContext) -> None:
        self.others: list[str] = []
        context.on("request", lambda asked: self._note(asked.url))
        context.on("dialog", self._dismiss)

    def _dismiss(self, dialog: Dialog) -> None:
        self.others.append(dialog.message)
        dialog.dismiss()

    def _note(self, url: str) -> None:
        if url.startswith("http") and "//127.0.0.1" not in url:
            self.others.append(url)

    def expect_harmless(self, page: Page, at: str = "") -> None:
        assert page.evaluate(SENSED) == [], at
        assert self.others == [], at
        width, window = page.evaluate(WIDTHS)
        assert width <= window, at


@pytest.fixture
def context(visitor: Callable[..., BrowserContext]) -> BrowserContext:
    return visitor()


@pytest.fixture
def sense(context: BrowserContext) -> Sense:
    return Sense(context)


def hostile_run(folder: Path, names: Sequence[str]) -> Path:
    """The folder of a run with the strings in every text that it has."""
    words = tuple(Word(0.02 * k, 0.02 * k + 0.02, text) for k, text in enumerate(HOSTILE))
    jerk = {name: 100.0 + k for k, name in enumerate(names)}
    run = made_run(folder, HOSTILE[0], jerk=jerk, said=Transcript(words)).folder
    motions = {name: made_motion(60) for name in names}
    made_line = json.loads((run / "timeline.json").read_text())
    drawn = make_timeline(load_speech(run / "speech.wav"), motions, "raw", PointTracker())
    (run / "timeline.json").write_text(json.dumps(made_line | drawn))
    phases = [HandPhase(0.0, 0.2, "rest", (0.2, -0.2, 0.2))]
    for k, text in enumerate(HOSTILE[:20]):
        at, place = 0.2 + 0.08 * k, (0.2, 0.0, 0.3)
        phases.append(HandPhase(at, at + 0.04, "preparation", place, "beat", text[:40]))
        phases.append(HandPhase(at + 0.04, at + 0.08, "stroke", place, "beat", text[:40]))
    plan = GesturePlan(2.0, right=(*phases, HandPhase(1.8, 2.0, "rest", (0.2, -0.2, 0.2))))
    write_plan_file(plan, run / "plan.json")
    with locked_record(run) as record:
        fill(record)
    return run


def fill(record: RunRecord) -> None:
    record.notes = list(HOSTILE)
    record.message = " ".join(HOSTILE[:30])
    record.settings = {text: text for text in HOSTILE[:50] if text.strip()}
    record.figure_captions = {text: text for text in HOSTILE if text.strip()}
    record.verdict = VerdictRecord(jerk_sentence=HOSTILE[1], comparison=HOSTILE[3])
    rows = [row.name for row in record.rows]
    record.findings = [
        FindingRecord(
            motion_name=rows[k % len(rows)], kind=text[:80], sentence=text, worst_time_s=0.5
        )
        for k, text in enumerate(HOSTILE)
    ]
    for row, text in zip(record.rows, HOSTILE, strict=False):
        about = {"kind": text, "value": text, "reason": text, "confidence": "unsure"}
        about["alternatives"] = HOSTILE[:40]
        row.label, row.assumptions = text, [about]  # type: ignore[list-item]


@pytest.mark.parametrize("part", range(4))
def test_a_run_on_the_page_and_as_a_file(
    part: int, context: BrowserContext, sense: Sense, fake: Fake, weights: Path, tmp_path: Path
) -> None:
    run = hostile_run(tmp_path / "job", NAMES[part::4][:14])
    config = AppConfig(port=0, weights=weights, temp_folder=tmp_path / "page", run_to_open=run)
    with served(config, **fake.does) as address:
        page = opened(context, address)
        expect(page.locator("#player")).to_contain_text(HOSTILE[1])
        page.locator("#player .stage").first.wait_for()
        page.evaluate("for (const each of document.querySelectorAll('details')) each.open = true")
        sense.expect_harmless(page)
    alone = tmp_path / "alone.html"
    alone.write_text(standalone_html(run))
    page = watched(context.new_page())
    page.goto(alone.as_uri())
    expect(page.locator(".lockstep")).to_contain_text(HOSTILE[1])
    page.locator(".stage").first.wait_for()
    sense.expect_harmless(page)


@pytest.mark.parametrize("part", range(4))
def test_parameters_of_links_of_the_page(
    part: int, context: BrowserContext, sense: Sense, fake_address: str
) -> None:
    page = opened(context, fake_address)
    for text in HOSTILE[part::4]:
        value = quote(text, safe="")
        query = "&".join(f"{key}={value}" for key in ("run", "link", "speech", "systems", "seed"))
        page.goto(f"{fake_address}?{query}&{value}#{value}")
        sense.expect_harmless(ready(page), text)


@pytest.fixture
def study(tmp_path: Path) -> Path:
    """The participants' part of a study whose texts are hostile."""
    long = json.dumps(" ".join(text for text in HOSTILE if text.isprintable())[:2000])
    texts = "\n".join(f"{key} = {long}" for key in ("title", "researchers", "contact", "ethics"))
    ids = 'panel_ids = ["PROLIFIC_PID"]\nattention_checks = 0'
    names = [f"<b {TAG}>{name}<i>" for name in "ab"]
    settings = f'protocol = "pairwise"\n{ids}\nconsent = {long}\n{texts}'
    clips = ["clip", "$x^2$"]
    return make_study(tmp_path, names, clips, settings) / "participant_bundle"


def test_a_study_and_parameters_of_its_links(
    context: BrowserContext, sense: Sense, study: Path
) -> None:
    page = watched(context.new_page())
    for text in HOSTILE:
        value = quote(text, safe="")
        query = f"?p=0&PROLIFIC_PID={value}&{value}={value}&preview={value}#{value}"
        page.goto(f"{(study / 'index.html').as_uri()}{query}")
        expect(page.locator("#main")).not_to_be_empty()
        sense.expect_harmless(page, text)
        page.goto(f"{(study / 'index.html').as_uri()}?p={value}&t={value}")
        expect(page.locator("#main")).not_to_be_empty()
        sense.expect_harmless(page, text)


def hostile_answers(folder: Path, names: Sequence[str], start: int) -> AnalysisRequest:
    key = made.made_key()
    files = made.made_files(key, 4)
    for number, file in enumerate(files):
        file["participant"] = HOSTILE[start + number]
        if number == 3:  # left out, and named in the report
            file["panel"] = {"PROLIFIC_PID": HOSTILE[start]}
    path, answers = made.written_study(folder, key, [])
    for number, file in enumerate(files):
        (answers / f"{NAMES[start + number]}.json").write_text(json.dumps(file))
    document = json.loads(path.read_text())
    new = dict(zip(made.SYSTEMS, names, strict=True))
    document |= {"title": " ".join(HOSTILE)[:2000], "systems": list(new.values())}
    document["panel_ids"] = ["PROLIFIC_PID"]
    for video in document["videos"].values():
        video["system"] = new[video["system"]]
    path.write_text(json.dumps(document))
    return AnalysisRequest([answers], path, folder / "report")


@pytest.fixture
def reports(tmp_path: Path) -> Iterator[Path]:
    return (
        analyse(hostile_answers(tmp_path / str(start), NAMES[start : start + 3], start))[0]
        for start in range(0, len(NAMES) - 4, 4)
    )


@pytest.mark.filterwarnings("ignore:Glyph .* missing from font")  # drawn as a box
def test_reports_of_studies(context: BrowserContext, sense: Sense, reports: Iterator[Path]) -> None:
    page = watched(context.new_page())
    for report in reports:
        page.goto(report.as_uri())
        page.locator("h1").first.wait_for()
        sense.expect_harmless(page, str(report))
