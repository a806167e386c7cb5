"""Runs that have ended, without any files but those that a test lays down."""

from pathlib import Path

from app.page.queue.jobs import Job, Tab
from app.page.results.kept_runs import EndedRun, KeptRun, KeptRuns
from app.page.results.result_parts import FiguresShown
from app.page.routes.media import MediaAddresses
from model.diagnostics import Diagnostics
from tests.app.fakes import measures
from tests.app.measured import diagnostics_of


def ended_run(folder: Path, title: str = "speech: local; seed 0", **changes) -> EndedRun:
    values = {
        "title": title,
        "settings": {"speech": "speech", "systems": "local", "seed": "0"},
        "speech_sha256": "abc",
        "line": "Done.",
        "notes": (),
        "verdict": "",
        "diagnostics": numbers(local=100.0),
        "showing": None,
        "figures": FiguresShown(MediaAddresses(), ""),
        "bundle": folder / "bundle.zip",
        "files": (),
    }
    return EndedRun(**{**values, **changes})


def numbers(reference: float | None = None, **jerk: float) -> Diagnostics:
    return diagnostics_of(
        None if reference is None else measures(reference),
        **{name: measures(value) for name, value in jerk.items()},
    )


def keep(
    runs: KeptRuns, folder: Path, cookie: str, run: EndedRun | None = None, tab: Tab = "generate"
) -> KeptRun:
    folder.mkdir(exist_ok=True)
    return runs.keep(Job("visitor", tab, folder), cookie, run or ended_run(folder))
