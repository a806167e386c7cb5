"""Equal noise on two bodies, from the page: what is asked for, and what is shown of it."""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import gradio as gr
import pytest

from app.page.tabs.systems.mechanism import MechanismParts, MechanismRunner
from app.run.examples import CLEAN
from app.run.experiments.mechanism import NAMES, MechanismRequest
from app.run.requests.request import Artefact
from app.run.videos.own_videos import OnFile
from model.motion.motion import save_motion
from tests.app.fakes import made_motion, made_services

VISITOR = SimpleNamespace(session_hash="visitor", cookies={})


def updates_of(show, tmp_path: Path, *values) -> list[dict]:
    with gr.Blocks():
        parts = MechanismParts(*(gr.HTML() for _ in range(4)))
    names = {getattr(parts, name): name for name in parts.__dataclass_fields__}
    runner = MechanismRunner(made_services(tmp_path, {"show_mechanism": show}), parts)
    found = []
    try:
        for update in runner.run(VISITOR, *values):  # type: ignore[arg-type]
            found.append({names[part]: value for part, value in update.items()})
    except gr.Error as error:
        found.append({"error": str(error.message)})
    return found


@pytest.mark.parametrize("needs_video", [False, True])
def test_both_bodies_play_and_what_they_show_is_told(tmp_path: Path, needs_video: bool) -> None:
    asked: list[MechanismRequest] = []

    def show(
        request: MechanismRequest, on_progress: Callable[[float], None], on_file: OnFile
    ) -> tuple[Path | None, tuple[str, ...]]:
        asked.append(request)
        for name in NAMES:
            path = request.out.with_name(f"{name}.npz")
            save_motion(made_motion(10), path)
            on_file(Artefact("motion", name, path))
        on_progress(0.5)
        request.out.write_bytes(b"0")
        return request.out if request.has_video else None, ("Moved by <1> cm.",)

    *_, last = updates_of(show, tmp_path, 0.05, None, needs_video)
    assert (asked[0].motion, asked[0].noise_rad) == (CLEAN, 0.05) and CLEAN.is_file()
    assert asked[0].is_played and asked[0].has_video == needs_video
    rows = last["player"]["rows"]
    assert [row["label"] for row in rows] == list(NAMES) and all("frames" in row for row in rows)
    assert last["player"]["plays"] and last["player"]["audio"] and last["player"]["timeline"]
    assert ("<video" in last["says"]["value"]) == needs_video
    assert "Moved by &lt;1&gt; cm." in last["says"]["value"]
    assert "Noise of 0.05 rad" in last["status"]


def test_what_cannot_be_drawn_is_told(tmp_path: Path) -> None:
    from app.run.experiments.mechanism import show_mechanism

    *_, shown, raised = updates_of(show_mechanism, tmp_path, 3.0, None, False)
    assert "0.005 to 0.1 rad; got 3" in raised["error"]
    assert not shown["says"]["visible"] and "got 3" in shown["message"]["value"]
