"""What a page shows that is opened by an address: a run in the tab that it came from."""

import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gradio as gr
import pytest
from starlette.datastructures import QueryParams

from app import text
from app.page.parts import markup
from app.page.queue.in_turn import Updates
from app.page.results.kept_runs import KeptRuns
from app.page.results.result_parts import ResultParts, build_results
from app.page.tabs.motion_run import Opening
from tests.app.fakes import made_services
from tests.app.page.results.made_run import ended_run, keep

HOUR_S = 3600.0


@pytest.fixture
def runs() -> KeptRuns:
    return KeptRuns(HOUR_S)


@pytest.fixture
def places() -> dict[str, ResultParts]:
    with gr.Blocks():
        return {"generate": build_results(), "own_motion": build_results("own-")}


@pytest.fixture
def fields() -> dict[str, gr.Number]:
    with gr.Blocks():
        return {"seed": gr.Number(0), "samples": gr.Number(1)}


@pytest.fixture
def opening(
    runs: KeptRuns,
    places: dict[str, ResultParts],
    fields: dict[str, gr.Number],
    tmp_path: Path,
) -> Opening:
    with gr.Blocks():
        return Opening(made_services(tmp_path, kept=runs), gr.Tabs(), places, fields)


def opened(opening: Opening, cookie: str = "", *tokens: str) -> Updates:
    query = QueryParams([("run", token) for token in tokens])
    request = SimpleNamespace(query_params=query, cookies={"study_visitor": cookie})
    return opening.opened(request)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("tab", "place"), [("generate", "generate"), ("live", "generate"), ("own_motion", "own_motion")]
)
def test_a_link_opens_the_run_in_its_own_tab(
    opening: Opening, runs: KeptRuns, places: dict, tmp_path: Path, tab: Any, place: str
) -> None:
    run = keep(runs, tmp_path / "job", "mine", ended_run(tmp_path), tab)
    updates = opened(opening, "of a stranger", run.token)
    tabs, *_ = opening.outputs
    assert updates[tabs].selected == place
    assert updates[places[place].status] == markup.sentence_status("Done.")
    assert "data-measure" in updates[places[place].numbers]["value"]
    other = next(parts for name, parts in places.items() if name != place)
    assert other.status not in updates and run.token not in updates[other.runs]["value"]


def test_two_runs_open_beside_each_other(
    opening: Opening, runs: KeptRuns, places: dict, tmp_path: Path
) -> None:
    first = keep(runs, tmp_path / "1", "mine", ended_run(tmp_path, "first"))
    second = keep(runs, tmp_path / "2", "mine", ended_run(tmp_path, "second"), "own_motion")
    updates = opened(opening, "mine", second.token, first.token)
    parts = places["generate"]
    assert text.PAIR_SAME_SETTINGS in updates[parts.verdict]["value"]
    assert "local (B)" in updates[parts.numbers]["value"]
    listed = updates[parts.runs]["value"]
    assert f"?run={first.token}&amp;run={second.token}" in listed and text.PAIR_LINK in listed
    assert listed.count(" checked") == 2
    alone = opened(opening, "mine", second.token)[places["own_motion"].runs]["value"]
    assert text.COMPARE_LAST in alone  # the same speech, and the run before it
    gone = opened(opening, "mine", first.token, "x")
    assert "deleted after" in gone[parts.message]["value"] and parts.numbers not in gone


def test_every_tab_lists_the_visitors_runs(
    opening: Opening, runs: KeptRuns, places: dict, tmp_path: Path
) -> None:
    run = keep(runs, tmp_path / "job", "mine")
    for parts in places.values():
        assert run.token in opened(opening, "mine")[parts.runs]["value"]
        assert not opened(opening, "yours")[parts.runs]["visible"]


def test_of_a_run_that_is_gone_a_sentence_says_so(
    opening: Opening, runs: KeptRuns, places: dict, tmp_path: Path
) -> None:
    run = keep(runs, tmp_path / "job", "mine")
    shutil.rmtree(run.job.folder)
    updates = opened(opening, "mine", run.token)
    assert "deleted after 60 minutes" in updates[places["generate"].message]["value"]
    assert places["generate"].status not in updates


def test_a_link_fills_in_the_form_that_asked_for_the_run(
    opening: Opening, runs: KeptRuns, fields: dict[str, gr.Number], tmp_path: Path
) -> None:
    run = keep(runs, tmp_path / "job", "mine", ended_run(tmp_path, form={"seed": 7}))
    updates = opened(opening, "of a stranger", run.token)
    assert updates[fields["seed"]]["value"] == 7 and fields["samples"] not in updates
    assert set(fields.values()) <= set(opening.outputs)
