"""Whatever types and values a program sends to the API: a sentence comes back."""

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.config import AppConfig
from app.page.launch import launch
from tests.fuzz.clock import FOR_EVER_S, SLOWEST_S, run_by_the_clock
from tests.fuzz.damage import HUGE
from tests.soak.visitor import filled

ASKED: dict[str, dict[str, Any]] = {
    "generate": {
        "systems": ["globaldiff/global"],
        "speaker": "ann",
        "steps": "1",
        "has_videos": False,
    },
    "hearing": {"systems": []},
    "own_motion": {"has_videos": False},
    "steps": {"systems": []},  # with a system it would be measured on an example
    "study_plan": {
        "title": "A",
        "systems": ["globaldiff/global"],
        "length_s": 2,
        "participants": 4,
    },
}
"""By call, what is asked for; of every other field the page's own value."""
PROGRAM_FAULTS = ("inside the program", "Traceback")
"""Gradio itself says of a field which type it expects."""
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


@pytest.fixture(scope="module")
def client(weights: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    temp = tmp_path_factory.mktemp("page")
    page = launch(AppConfig(port=0, weights=weights, temp=temp), is_warmed_up=False)
    with httpx.Client(base_url=page.local_url, timeout=FOR_EVER_S) as client:
        yield client
    page.close()


@pytest.fixture(scope="module")
def forms(client: httpx.Client) -> dict[str, dict[str, Any]]:
    """By call, a value for each of its fields as the page names them, in its order."""
    calls = client.get("gradio_api/info").json()["named_endpoints"]
    return {name: filled(calls[f"/{name}"], asked) for name, asked in ASKED.items()}


def answer_of(client: httpx.Client, name: str, values: list[Any]) -> str:
    """The last event of a call: ``complete`` or ``error``, with its data."""
    body = json.dumps({"data": values})
    asked = client.post(
        f"gradio_api/call/{name}", content=body, headers={"Content-Type": "application/json"}
    )
    if asked.status_code != 200:
        return f"refused {asked.text}"
    return client.get(f"gradio_api/call/{name}/{asked.json()['event_id']}").text


@pytest.mark.parametrize("name", list(ASKED))
def test_wild_values(client: httpx.Client, forms: dict[str, dict[str, Any]], name: str) -> None:
    form = list(forms[name].values())

    @given(st.lists(st.tuples(st.integers(0, len(form) - 1), SENT), min_size=1, max_size=2))
    def check(changes: list[tuple[int, Any]]) -> None:
        values = list(form)
        for at, value in changes:
            values[at] = value
        before = time.process_time()  # the page's too: its threads are of this process
        answer = answer_of(client, name, values)
        assert time.process_time() - before < SLOWEST_S, "it took too long"
        assert not any(fault in answer for fault in PROGRAM_FAULTS), answer[:500]
        assert "/site-packages/" not in answer and "\x1b" not in answer, answer[:500]

    run_by_the_clock(check)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("sampler", ["euler"]),
        ("point", ["right_middle"]),
        ("body_steps", float("nan")),
        ("samples", float("nan")),
    ],
    ids=["a list as sampler", "a list as point", "steps NaN", "samples NaN"],
)
def test_wrong_types_that_were_once_faults_of_the_program(
    client: httpx.Client, forms: dict[str, dict[str, Any]], field: str, value: Any
) -> None:
    assert field in forms["generate"]
    values = list((forms["generate"] | {field: value}).values())
    answer = answer_of(client, "generate", values)
    assert f"The field {field} cannot be used" in answer, answer[:900]
    assert not any(fault in answer for fault in PROGRAM_FAULTS), answer[:900]
