"""A run as one page that plays anywhere, for whoever has no server of this program."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fastapi.routing import APIRoute

from app.page.alone import Scene, player_alone
from app.page.results.kept_runs import RUN_ROUTE
from app.page.results.run_file import PAGE_ENDING, saving_route
from app.run.pieces import MAX_FRAMES
from model.storage.files import written_atomically

if TYPE_CHECKING:
    from pathlib import Path

    from app.page.results.ended_run import EndedRun
    from app.page.results.kept_runs import KeptRuns


def save_page(run: EndedRun, out: Path) -> Path:
    """Write what a run that has ended shows, whole or not at all: its bodies, its sound, time line
    and plans. Takes of edited plans are not among them.

    Raises:
        RunError: of motion that no browser plays.
    """
    from model.motion.motion import load_motion
    from model.plan.plan import read_plan

    assert run.showing is not None
    sound = run.showing.sound()
    scene = Scene(
        motions={
            name: load_motion(path).part(slice(MAX_FRAMES))
            for name, path in run.showing.drawn().items()
        },
        timeline=run.showing.timeline(),
        sound=None if sound is None else sound.read_bytes(),
        plans={
            name: read_plan(path) for name, path in run.showing.performed.items() if path.is_file()
        },
        findings=run.diagnostics.findings,
        title=run.title,
    )
    with written_atomically(out) as part:
        part.write_text(player_alone(scene), encoding="utf-8")
    return out


def run_page_routes(kept: KeptRuns) -> list[APIRoute]:
    """Serve runs as such pages."""
    path, media_type = RUN_ROUTE + "/{token}/page", "application/octet-stream"
    return [saving_route(kept, path, PAGE_ENDING, media_type, save_page)]
