import numpy as np
import pytest

from model.plan.files import annotated_plan
from model.plan.plan import Blink, Brow, Look, Nod, PlanError, Planted, Smile, Stand

GRID = """File type = "ooTextFile"
Object class = "TextGrid"

xmin = 0
xmax = 3.0000
tiers? <exists>
size = {count}
item []:
{tiers}"""


def interval_tier(name: str, *intervals: tuple[float, float, str]) -> str:
    lines = [f'        class = "IntervalTier"\n        name = "{name}"']
    lines += [
        f'            xmin = {start}\n            xmax = {end}\n            text = "{label}"'
        for start, end, label in intervals
    ]
    return "\n".join(lines)


def point_tier(name: str, *points: tuple[float, str]) -> str:
    lines = [f'        class = "TextTier"\n        name = "{name}"']
    lines += [f'            number = {at}\n            mark = "{mark}"' for at, mark in points]
    return "\n".join(lines)


def grid(*tiers: str) -> str:
    items = "\n".join(f"    item [{k}]:\n{tier}" for k, tier in enumerate(tiers, 1))
    return GRID.format(count=len(tiers), tiers=items)


HANDS = (
    interval_tier("gesture_left", (0, 3, "rest")),
    point_tier("goal_left", (0.0, "0.200 -0.300 0.100")),
    interval_tier(
        "gesture_right", (0, 1, "rest"), (1, 1.5, "preparation offer"), (1.5, 2, "stroke offer"),
        (2, 2.4, ""), (2.4, 3, "retraction"),
    ),
    point_tier(
        "goal_right", (0.0, "0.2 -0.3 0.1"), (1.5, "0.2 0.1 0.3"), (2.0, "0.1 0 0.4"),
        (3.0, "0.2 -0.3 0.1"),
    ),
    point_tier("apex", (2.0, "offer right whole"), (2.0, "offer left other")),
)  # fmt: skip


def test_hands_have_phases_goals_kinds_and_words(tmp_path):
    path = tmp_path / "a.TextGrid"
    path.write_text(grid(*HANDS))
    plan = annotated_plan(path)
    assert plan.duration_s == 3.0
    told = [(p.phase, p.start_s, p.end_s, p.kind, p.word) for p in plan.right]
    assert told == [
        ("rest", 0, 1, "", ""),
        ("preparation", 1, 1.5, "offer", ""),
        ("stroke", 1.5, 2, "offer", "whole"),
        ("retraction", 2.4, 3, "", ""),
    ]
    goals = [(0.2, -0.3, 0.1), (0.2, 0.1, 0.3), (0.1, 0.0, 0.4), (0.2, -0.3, 0.1)]
    np.testing.assert_allclose([p.goal for p in plan.right], goals)
    assert [p.phase for p in plan.left] == ["rest"]


def test_the_rest_of_the_body_is_told(tmp_path):
    path = tmp_path / "a.TextGrid"
    tiers = (
        point_tier("nods", (1.2, "4.500")),
        interval_tier("gaze", (0, 1, "0.0 1.5"), (1, 3, "-12.5 4.0")),
        point_tier("brows", (1.0, "0.700 0.120")),
        interval_tier("smile", (0, 1, ""), (1, 2, "0.300")),
        point_tier("blinks", (0.5, "0.130")),
        interval_tier("weight", (0, 2, "left"), (2, 3, "both")),
        interval_tier("foot_left", (0, 3, "planted")),
        interval_tier("foot_right", (0, 1, "planted"), (1, 1.5, ""), (1.5, 3, "planted")),
    )
    path.write_text(grid(*HANDS, *tiers))
    plan = annotated_plan(path)
    assert plan.nods == (Nod(1.2, 4.5),)
    assert plan.looks == (Look(0.0, 1.0, 0.0, 1.5), Look(1.0, 3.0, -12.5, 4.0))
    assert plan.brows == (Brow(1.0, 0.7),) and plan.smiles == (Smile(1.0, 2.0, 0.3),)
    assert plan.blinks == (Blink(0.5),)
    assert plan.stands == (Stand(0.0, 2.0, "left"), Stand(2.0, 3.0, "both"))
    assert plan.planted == (
        Planted(0.0, 3.0, "left"),
        Planted(0.0, 1.0, "right"),
        Planted(1.5, 3.0, "right"),
    )


def test_a_grid_without_goals_is_no_plan(tmp_path):
    path = tmp_path / "a.TextGrid"
    path.write_text(grid(interval_tier("words", (0, 1, "so"))))
    with pytest.raises(PlanError, match="has no tier gesture_left"):
        annotated_plan(path)
