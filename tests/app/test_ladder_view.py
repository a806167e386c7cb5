import xml.etree.ElementTree as ElementTree

import pytest

from app.ladder_view import RUNGS, ladder
from app.parts import default_systems
from model.ladder import SYSTEMS


def test_the_rungs_are_those_of_the_trainings_in_their_order() -> None:
    assert [rung.system for rung in RUNGS] == list(SYSTEMS)


def test_systems_without_weights_are_told_apart() -> None:
    html = ladder(["globaldiff/local", "globaldiff/global"])
    assert html.count("class=absent") == 3
    assert "absent" not in ladder(list(SYSTEMS))


@pytest.mark.parametrize("rung", RUNGS, ids=lambda rung: rung.system)
def test_equations_are_whole(rung) -> None:
    """Every fraction, index and accent has as many parts as MathML wants."""
    parts = {"mfrac": 2, "msub": 2, "msup": 2, "msubsup": 3, "mover": 2, "munder": 2}
    for element in ElementTree.fromstring(rung.equation).iter():
        assert len(element) == parts.get(element.tag, len(element))
        assert len(element) or (element.text or "").strip()


def test_at_first_a_few_systems_are_ticked_that_show_most() -> None:
    ends = ["globaldiff/local", "globaldiff/global", "globaldiff/full"]
    assert default_systems(list(SYSTEMS)) == ends
    assert default_systems(ends[:2]) == ends[:2]
    assert default_systems(["a", "globaldiff/full", "b", "c"]) == ["a", "globaldiff/full", "b"]
