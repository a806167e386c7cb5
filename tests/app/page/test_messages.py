"""Messages of the server for the page's modules: their types, and messages.d.ts."""

import json
import runpy
from typing import Any

import pytest
from pydantic import TypeAdapter

from app.page.parts.messages import PlayerValue
from app.page.results.run_view import RunView, example_player_value
from app.page.routes.media import SharedFolders
from app.run.examples import FIRST_LOOK
from app.run.output.run_folder import TIMELINE
from app.run.output.viewer_files import PlanEditorData, Timeline
from app.run.plan_edits.edited_motion import plan_editor_json
from model.plan.files import read_plan_file
from model.speech.transcript import Word
from tests.helpers import ROOT


def player_value() -> dict[str, Any]:
    run_view = RunView(FIRST_LOOK, lambda path: f"file/{path.name}")
    run_view.set_editor_state("moved", is_working=True)
    return run_view.player_value()


def editor_data() -> dict[str, Any]:
    plan = read_plan_file(FIRST_LOOK / "viewer" / "A.plan.json").plan
    return plan_editor_json(plan, [Word(0.0, 1.0, "one")])


@pytest.mark.parametrize(
    ("kind", "make"),
    [
        (PlayerValue, player_value),
        (PlayerValue, lambda: example_player_value(SharedFolders())),
        (Timeline, lambda: json.loads((FIRST_LOOK / TIMELINE).read_text())),
        (PlanEditorData, editor_data),
    ],
)
def test_what_is_written_is_of_the_declared_type_with_no_further_keys(kind, make):
    adapter, written = TypeAdapter(kind), json.loads(json.dumps(make()))
    assert adapter.dump_python(adapter.validate_python(written), mode="json") == written


def test_messages_are_declared_as_the_types_are():
    tool = runpy.run_path(str(ROOT / ".ci" / "messages.py"))
    assert tool["FILE"].read_text() == tool["declarations"](), (
        "run .venv/bin/python .ci/messages.py"
    )
