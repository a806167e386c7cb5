import pytest

from app.page.tabs.systems.systems import NOT_HERE, ladder
from model.systems.globaldiff.config import BEST, LADDER, SYSTEMS
from model.systems.globaldiff.ladder import EXPLAINED


def test_the_rungs_are_those_of_the_trainings_in_their_order() -> None:
    assert [rung.system for rung in EXPLAINED.rungs] == list(LADDER)
    assert BEST in ladder([BEST])


def test_systems_without_weights_are_told_apart() -> None:
    html = ladder(["globaldiff/local", "globaldiff/global"])
    assert html.count("class=absent") == 3 and html.count(NOT_HERE) == 4
    assert "absent" not in ladder(list(SYSTEMS)) and NOT_HERE not in ladder(list(SYSTEMS))


@pytest.mark.parametrize("rung", EXPLAINED.rungs, ids=lambda rung: rung.system)
def test_equations_stay_whole_inside_the_page(rung) -> None:
    assert not set("<>&$") & set(rung.equation)
    assert rung.equation.count("{") == rung.equation.count("}") > 0
    assert f"$${rung.equation}$$" in ladder([])
