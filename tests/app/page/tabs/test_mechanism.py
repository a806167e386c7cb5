"""Equal noise on two bodies, from the page: what is asked for, and what is shown of it."""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import gradio as gr

from app.config import AppConfig
from app.page.serving.jobs import JobBook
from app.page.serving.media import MediaDesk
from app.page.tabs.mechanism import MechanismParts, MechanismRunner
from app.run.mechanism import MechanismRequest
from app.run.planted import CLEAN

VISITOR = SimpleNamespace(session_hash="visitor", cookies={})


def updates_of(show, tmp_path: Path, *values) -> list[dict]:
    with gr.Blocks():
        parts = MechanismParts(gr.HTML(), gr.HTML(), gr.HTML())
    names = {getattr(parts, name): name for name in parts.__dataclass_fields__}
    runner = MechanismRunner(show, AppConfig(), JobBook(tmp_path), MediaDesk(), parts)
    found = []
    try:
        for update in runner.run(VISITOR, *values):  # type: ignore[arg-type]
            found.append({names[part]: value for part, value in update.items()})
    except gr.Error as error:
        found.append({"error": str(error.message)})
    return found


def test_the_video_and_its_numbers_are_shown(tmp_path: Path) -> None:
    asked: list[MechanismRequest] = []

    def show(request: MechanismRequest, on_progress: Callable[[float], None]):
        asked.append(request)
        on_progress(0.5)
        request.out.write_bytes(b"0")
        return request.out, ("Moved by <1> cm.",)

    *_, last = updates_of(show, tmp_path, 0.05, None)
    assert (asked[0].motion, asked[0].noise_rad) == (CLEAN, 0.05) and CLEAN.is_file()
    assert "<video" in last["video"]["value"] and 'src="media/' in last["video"]["value"]
    assert "Moved by &lt;1&gt; cm." in last["video"]["value"]
    assert "Noise of 0.05 rad" in last["status"]


def test_what_cannot_be_drawn_is_told(tmp_path: Path) -> None:
    from app.run.mechanism import show_mechanism

    *_, shown, raised = updates_of(show_mechanism, tmp_path, 3.0, None)
    assert "0.005 to 0.1 rad; got 3" in raised["error"]
    assert not shown["video"]["visible"] and "got 3" in shown["message"]["value"]
