"""Plans as markers of animation software."""

import csv

from model.plan.files import Marker, markers_csv, markers_of
from tests.model.plan.made import made_plan


def test_every_movement_and_event_is_a_marker_in_time() -> None:
    markers = markers_of(made_plan())
    names = [marker.name for marker in markers]
    assert [marker.time_s for marker in markers] == sorted(marker.time_s for marker in markers)
    assert names.count("right stroke (offer) on whole") == 1 and "left rest" not in names
    assert Marker(1.5, "right stroke (offer) on whole") in markers
    assert {"nod 4°", "look 14° 5°", "brows", "blink", "right retraction"} <= set(names)
    assert len(markers) == 7 + 2 + 3 + 1 + 2
    assert Marker(1.9, "").frame == 57


def test_the_table_holds_frames_and_names_with_commas() -> None:
    rows = list(csv.DictReader(markers_csv(made_plan()).splitlines()))
    assert [(row["frame"], row["time_s"]) for row in rows[:2]] == [
        ("0", "0.0000"),
        ("24", "0.8000"),
    ]
    assert rows[1]["name"] == "blink" and len(rows) == 15
