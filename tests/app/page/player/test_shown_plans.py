import json
from pathlib import Path

from app.page.player.shown_plans import found_plans, planned
from model.motion.motion import save_motion
from model.plan.plan import GesturePlan, HandPhase, Nod, read_plan
from tests.app.fakes import made_motion

PLAN = GesturePlan(
    2.0,
    right=(HandPhase(0.5, 1.0, "stroke", (0.2, -0.1, 0.3), "offer", "never"),),
    nods=(Nod(1.25, 6.0),),
)


def test_a_plan_that_was_performed_is_shown_as_it_was_written(tmp_path: Path) -> None:
    written = tmp_path / "system.plan.json"
    PLAN.write(written)
    shown = planned(written, "family/system", tmp_path)
    written.unlink()  # the run's own folder moves
    told = json.loads(shown.read_text())
    assert told.pop("origin") == "planned"
    again = tmp_path / "again.json"
    again.write_text(json.dumps(told))
    assert read_plan(again) == PLAN


def test_of_other_motion_it_is_found_and_says_so(tmp_path: Path) -> None:
    paths = {name: tmp_path / f"{number}.npz" for number, name in enumerate(("a/b", "reference"))}
    for path in paths.values():
        save_motion(made_motion(45), path)
    found = found_plans(paths, tmp_path)
    assert found.keys() == paths.keys() and len(set(found.values())) == 2
    for path in found.values():
        told = json.loads(path.read_text())
        assert told["origin"] == "found" and told["duration_s"] == 1.5
        phases = told["right"]
        assert (phases[0]["start_s"], phases[-1]["end_s"]) == (0.0, 1.5)
