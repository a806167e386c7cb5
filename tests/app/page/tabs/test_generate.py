from app.page.tabs.generate import default_systems
from model.systems.globaldiff.config import BEST, SYSTEMS


def test_at_first_a_few_systems_are_ticked_that_show_most() -> None:
    first = [BEST, "globaldiff/local", "globaldiff/global"]
    assert default_systems(list(SYSTEMS)) == first
    assert default_systems(first[:2]) == first[:2]
    assert default_systems(["a", "globaldiff/global", "b", "c"]) == ["a", "globaldiff/global", "b"]
