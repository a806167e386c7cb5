"""What is read once for all runs of a process."""

from pathlib import Path

from app.run.models import get_system, warming_up
from model.systems.registry import list_systems
from tests.model.made import make_weights


def test_reading_stops_after_each_system_so_that_work_can_come_between(tmp_path: Path) -> None:
    weights = make_weights(tmp_path)
    names = list_systems(weights)
    assert len(names) > 1
    parts = warming_up(weights, None)
    assert sum(1 for _ in parts) == 1 + len(names)
    assert all(get_system(name, weights) is get_system(name, weights) for name in names)
