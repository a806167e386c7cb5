"""Runs behind links: found by their token for as long as their files are there, listed for one."""

import shutil
from pathlib import Path

from app.page.results.kept_runs import KeptRuns
from tests.app.page.results.made_run import ended_run, keep

HOUR_S = 3600.0


def test_a_run_is_found_by_its_token_until_its_files_are_gone(tmp_path: Path) -> None:
    runs = KeptRuns(HOUR_S)
    first, second = (keep(runs, tmp_path / name, "mine") for name in "ab")
    assert first.token != second.token and len(first.token) >= 43  # 256 bits
    assert runs.find(first.token) == first
    assert runs.find("") is None and runs.find(first.token[:-1]) is None
    shutil.rmtree(first.job.folder)
    assert runs.find(first.token) is None
    assert runs.of("mine") == [second]


def test_a_browser_is_told_of_its_own_runs_alone(tmp_path: Path) -> None:
    runs = KeptRuns(HOUR_S)
    mine, yours, nobodys = (
        keep(runs, tmp_path / name, cookie, ended_run(tmp_path, "a < b"))
        for name, cookie in (("a", "mine"), ("b", "yours"), ("c", ""))
    )
    assert runs.of("mine") == [mine] and runs.of("") == []
    told = runs.html("mine", mine)
    assert mine.token in told and "a &lt; b" in told and "60 minutes" in told
    assert yours.token not in told and nobodys.token not in told
    assert nobodys.token in runs.html("", nobodys)  # its own link, and no list
    assert runs.html("of a stranger") == ""
