"""JSON files that the viewer reads: a run from elsewhere is opened only if each is of its type."""

import json
from pathlib import Path
from typing import Any

import pytest

from app.errors import RunError
from app.run.batch.saved_run import copy_run
from app.run.output.run_folder import TIMELINE, locked_record
from app.run.plan_edits.edited_motion import plan_editor_json
from model.plan.files import read_plan_file, write_plan_file
from model.plan.plan import GesturePlan, HandPhase
from model.speech.transcript import Word
from tests.app.page.results.made_run import made_run

CURVE = {"start_s": 0.0, "step_s": 0.1, "values": [1.0]}
PLAN, EDITOR = "a.plan.json", "a.editor.json"


def curve(**changes: Any) -> dict[str, Any]:
    return {"curves": {"local": {"raw": {"jerk_m_s3": {**CURVE, **changes}}}}}


DAMAGES: list[tuple[str, dict[str, Any]]] = [
    *((TIMELINE, {key: value}) for key in ("duration_s", "fps", "peaks", "worst", "curves", "point")
      for value in ("3", True, None, [[]], {"x": 1}) if (key, value) != ("point", "3")),
    *((TIMELINE, change) for change in (
        {"peaks": [0.5]}, {"peaks": [0] * 10_000}, {"duration_s": float("nan")}, {"accents": [[1]]},
        {"words": [["a", 1, 2]]}, {"words": [[0, 1]]}, {"words_origin": "<b>"}, {"phones": {}},
        {"gestures": {"a": [[0, 1, 2]]}}, {"worst": [{"name": "local", "start_s": 1}]},
        curve(start_s="0"), curve(values=[None]), curve(values=[0.0] * 10_000),
    )),
    (PLAN, {"left": 3}), (PLAN, {"nods": [{"time_s": "x"}]}), (PLAN, {"format": 99}),
    (EDITOR, {"gestures": 1}), (EDITOR, {"words": [[0, 1]]}), (EDITOR, {"around": [0]}),
]  # fmt: skip


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """The folder of a run that can be edited."""
    folder = made_run(tmp_path / "job").folder
    rest = HandPhase(0.0, 2.0, "rest", (0.2, -0.2, 0.2))
    write_plan_file(GesturePlan(2.0, right=(rest,)), folder / PLAN)
    data = plan_editor_json(read_plan_file(folder / PLAN).plan, [Word(0.0, 1.0, "one")])
    (folder / EDITOR).write_text(json.dumps(data))
    with locked_record(folder) as record:
        record.rows[0].files |= {"plan": PLAN, "input_plan": PLAN, "editor": EDITOR}
        record.files += [PLAN, EDITOR]
    return folder


def test_a_run_is_opened_only_if_the_viewer_can_read_its_files(run: Path, tmp_path: Path) -> None:
    whole = {name: json.loads((run / name).read_text()) for name in (TIMELINE, PLAN, EDITOR)}
    for number, (name, change) in enumerate(DAMAGES):
        (run / name).write_text(json.dumps(whole[name] | change))
        with pytest.raises(RunError, match=name) as refused:
            copy_run(run, tmp_path / str(number))
        assert str(refused.value).isprintable() and len(str(refused.value)) < 500, change
        (run / name).write_text(json.dumps(whole[name]))
    for key in whole[TIMELINE]:
        (run / TIMELINE).write_text(json.dumps({**whole[TIMELINE], key: None}))
        with pytest.raises(RunError, match=f"timeline.json of this run is damaged: .*{key}"):
            copy_run(run, tmp_path / key)


def test_the_viewer_gets_every_list_of_a_plan(run: Path, tmp_path: Path) -> None:
    plan = json.loads((run / PLAN).read_text())
    (run / PLAN).write_text(json.dumps({key: plan[key] for key in ("format", "duration_s")}))
    copied = json.loads((copy_run(run, tmp_path / "copy") / PLAN).read_text())
    assert copied.keys() == plan.keys() and copied["right"] == []
