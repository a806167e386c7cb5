"""Whatever types and values a program sends to the API: a sentence comes back."""

import json
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import gradio as gr
import httpx
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.config import AppConfig
from app.page.launch import launch
from app.page.parts.form_values import Fields, parse_form_values
from app.page.tabs.motion import build_form, request_from_form
from app.page.tabs.own_motion import build_own_motion_form, own_motion_request
from app.page.tabs.study import build_study_tab, study_plan_toml
from app.run.requests.requests import DiagnoseRequest, GenerateRequest
from app.study.design.plan import StudyPlan
from tests.app.fakes import CATALOGUE, made_services
from tests.fuzz.clock import (
    FOR_EVER_S,
    PROGRAM_FAULTS,
    SECONDS,
    SLOWEST_S,
    is_done_or_refused,
    run_by_the_clock,
)
from tests.fuzz.damage import HUGE
from tests.soak.visitor import filled

SENT: st.SearchStrategy[Any] = st.one_of(
    st.none(),
    st.booleans(),
    st.sampled_from([-1, 1.5, 2**63, 1e308, HUGE, float("nan"), float("inf")]),
    st.sampled_from(["", "nobody", "\x1b[31m", "a" * 6000, "=", "globaldiff/global=x", "1,2"]),
    st.sampled_from([[], [[]], ["euler"], [None], {}, {"path": "/etc/passwd"}, {"path": None}]),
    st.sampled_from(
        [{"path": "a.wav", "meta": {"_type": "gradio.FileData"}}, [{"url": "file:/x"}]]
    ),
    st.dictionaries(st.text(max_size=4), st.none() | st.integers(), max_size=2),
)
"""In the place of a field's value."""


def changes(count: int) -> st.SearchStrategy[list[tuple[int, Any]]]:
    """Of one or two of so many fields."""
    return st.lists(st.tuples(st.integers(0, count - 1), SENT), min_size=1, max_size=2)


def changed(values: Sequence[Any], changes: list[tuple[int, Any]]) -> list[Any]:
    values = list(values)
    for at, value in changes:
        values[at] = value
    return values


@pytest.fixture(scope="module")
def forms(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[type, Fields, Callable]]:
    """Fields, and what makes an ask of what they give."""
    services, config = made_services(tmp_path_factory.mktemp("page")), AppConfig()
    with gr.Blocks():
        generate, own = build_form(services).fields, build_own_motion_form(services).fields
        study = build_study_tab(services)
    return {
        "generate": (
            GenerateRequest,
            generate,
            lambda told: request_from_form(told, Path("/job"), CATALOGUE, config),
        ),
        "own": (DiagnoseRequest, own, lambda told: own_motion_request(told, Path("/job"), config)),
        "study": (StudyPlan, study, study_plan_toml),
    }


FILES = {"generate": {"speech": "/a.wav"}, "own": {"motions": ["a.npz"]}}
FILES["study"] = {"speeches": ["a.wav"]}


@pytest.mark.parametrize("name", FILES)
def test_forms(forms: dict[str, tuple[type, Fields, Callable]], name: str) -> None:
    asked, form, ask = forms[name]
    usual = [FILES[name].get(key, part.value) for key, part in form.items()]

    @given(changes(len(form)))
    def check(changes: list[tuple[int, Any]]) -> None:
        values = changed(usual, changes)
        is_done_or_refused(lambda: ask(parse_form_values(asked, form, values)))

    run_by_the_clock(check)


ASKED: dict[str, dict[str, Any]] = {
    "generate": {
        "systems": ["globaldiff/global"],
        "speaker": "ann",
        "steps": "1",
        "has_video": False,
    },
    "hearing": {"systems": []},
    "own_motion": {"has_video": False},
    "steps": {"systems": []},  # with a system it would be measured on an example
    "study_plan": {
        "title": "A",
        "systems": ["globaldiff/global"],
        "length_s": 2,
        "participants": 4,
    },
}
"""By call, what is asked for; of every other field the page's own value."""


@pytest.fixture(scope="module")
def client(weights: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    temp = tmp_path_factory.mktemp("page")
    page = launch(AppConfig(port=0, weights=weights, temp_folder=temp), preloads_models=False)
    with httpx.Client(base_url=page.local_url or "", timeout=FOR_EVER_S) as client:
        yield client
    page.close()


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if SECONDS else pytest.mark.slow) for name in ASKED]
)
def test_calls(client: httpx.Client, name: str) -> None:
    calls = client.get("gradio_api/info").json()["named_endpoints"]
    form = list(filled(calls[f"/{name}"], ASKED[name]).values())
    call = f"gradio_api/call/{name}"

    @given(changes(len(form)))
    def check(changes: list[tuple[int, Any]]) -> None:
        body = json.dumps({"data": changed(form, changes)})
        before = time.process_time()  # the page's too: its threads are of this process
        asked = client.post(call, content=body, headers={"Content-Type": "application/json"})
        answer = asked.text
        if asked.status_code == 200:
            answer = client.get(f"{call}/{asked.json()['event_id']}").text
        assert time.process_time() - before < SLOWEST_S, "it took too long"
        assert not any(fault in answer for fault in PROGRAM_FAULTS), answer[:500]
        assert "/site-packages/" not in answer and "\x1b" not in answer, answer[:500]

    run_by_the_clock(check)
