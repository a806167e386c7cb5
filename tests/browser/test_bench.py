"""What `make bench` measures in a browser, over a pipeline that needs no model."""

from pathlib import Path

import pytest
from playwright.sync_api import Browser

from app.bench import browser as bench_browser
from tests.browser.conftest import FAKED_SYSTEMS, Windows, watched

pytestmark = pytest.mark.browser


def test_a_click_is_timed_to_movement_measures_and_figures_and_pictures_are_counted(
    browser: Browser,
    windowed_address: str,
    windows: Windows,
    speech: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(bench_browser, "_FIRST_S", 0.5)
    monkeypatch.setattr(bench_browser, "_LATER_S", 1.0)
    windows.let(8)
    windows.may_draw.set()
    page = watched(bench_browser.opened_page(browser, windowed_address))
    for systems in (FAKED_SYSTEMS[:1], FAKED_SYSTEMS[:2]):
        waits = bench_browser.run_waits(page, speech, systems)
        assert 0 < waits.moves and 0 < waits.whole <= waits.all
        assert 0 < waits.measured <= waits.done
        assert page.evaluate("document.querySelector('.lockstep').stage.names") == [*systems]

    slow, level = bench_browser.pictures_per_second(page, level=0)
    assert level["mesh"] == 0 and slow > 0
    found, _ = bench_browser.pictures_per_second(page)
    assert found > 0
    assert "2 whole bodies" in bench_browser.gpu_sentence(page, 2)
    page.context.close()
