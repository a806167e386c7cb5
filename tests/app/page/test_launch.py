"""The page as it is started: its flags, its server, and what any program may ask it."""

import json
import logging
import os
import signal
import socket
import subprocess
import sys
import urllib.parse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from gradio import Blocks, http_server, queueing
from gradio.components import file as file_component
from gradio_client import Client, handle_file
from gradio_client.exceptions import AppError
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from app import text
from app.config import AppConfig
from app.errors import RunError
from app.page import gradio_changes
from app.page.launch import launch, parse_config
from tests.app.page.conftest import UPLOAD, Served, served_page
from tests.helpers import ROOT

FORM = {
    "systems": ["globaldiff/global"],
    "speaker": "ann",
    "seed": 0,
    "samples": 1,
    "steps": "1",
    "sampler": "euler",
    "post_filter": False,
    "reference": None,
    "joint": "right_middle",
    "start_frame": 0,
    "transcript": None,
}
ANSWERS: list[int] = []
"""Of the server to what a browser asks before anything else has happened."""


@pytest.fixture(scope="module")
def page(
    served: Served, weights: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Blocks]:
    """The one that listens on a port, on a machine too busy to answer itself at once. After
    ``served``, whose place for uploads is then put back."""
    start_server = http_server.start_server

    def start_and_ask(*args, **options):
        started = start_server(*args, **options)
        with httpx.Client(base_url=started[2], timeout=60) as client:
            ANSWERS.append(client.get("web/player/player.js").status_code)
            ANSWERS.append(client.post("visitor").status_code)
            ANSWERS.append(client.get("media/none/a").status_code)
        return started

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GRADIO_TEMP_DIR", "")  # launching sets it for the whole process
        patch.setattr(http_server, "start_server", start_and_ask)
        patch.setattr("gradio.networking.url_ok", lambda url: False)
        temp = tmp_path_factory.mktemp("page")
        page = launch(AppConfig(port=0, weights=weights, temp_folder=temp), preloads_models=False)
        yield page
        page.close()


def submit(address: str | None, name: str, *asked: Any) -> Any:
    """As a program does."""
    client = Client(address or "", verbose=False, download_files=False, analytics_enabled=False)
    return client.submit(*asked, api_name=name).result(timeout=110)


def test_every_route_is_there_at_once_and_clicks_of_programs_are_not_counted_up(page):
    assert ANSWERS == [200, 204, 404], "as soon as the server listens"
    for _ in range(2):
        with pytest.raises(AppError) as caught:
            submit(page.local_url, "/generate", None, *FORM.values())
        assert text.NO_SPEECH in str(caught.value)
    assert len(page._queue.event_analytics) <= 1
    assert page._queue.cached_event_analytics_summary == {"functions": {}}


def test_a_frame_that_is_no_text_ends_its_socket_and_is_no_fault(page, caplog):
    address = page.local_url.replace("http", "ws")
    logger = logging.getLogger("uvicorn.error")
    logger.addHandler(caplog.handler)
    try:
        own = {"Origin": page.local_url.rstrip("/")}
        with connect(f"{address}live/speak", additional_headers=own) as speech:
            speech.send(b"\xff\xfe", text=True)
            with pytest.raises(ConnectionClosed):
                speech.recv(60)
        assert httpx.get(f"{page.local_url}config", timeout=60).status_code == 200
    finally:
        logger.removeHandler(caplog.handler)
    assert [record for record in caplog.records if record.exc_info] == []


def test_what_a_stranger_may_ask_of_the_page(served, weights):
    client = served.visitor()
    endpoints = client.get("/gradio_api/info").json()["named_endpoints"]
    needed = {
        name: {p["parameter_name"] for p in each["parameters"] if not p["parameter_has_default"]}
        for name, each in endpoints.items()
    }
    assert (needed["/own_motion"], needed["/generate"]) == ({"motions"}, {"speech"})
    assert needed["/study"] == set(), "a program names only what a run cannot do without"
    for path in ("pyproject.toml", "renderer/assets/open_body.npz", "app/text.py"):
        assert (ROOT / path).exists()
        for written in (str(ROOT / path), path, f"../{path}"):
            answer = client.get(f"/gradio_api/file={urllib.parse.quote(written)}")
            assert answer.status_code in (403, 404), written
    answer = client.get(f"/gradio_api/file={weights / 'globaldiff-local.safetensors'}")
    assert answer.status_code in (403, 404)
    html = client.get("/").text
    assert '"analytics_enabled":false' in html.replace(" ", "")
    for elsewhere in ("fonts.googleapis.com", "fonts.gstatic.com", "cdn.jsdelivr"):
        assert f'href="https://{elsewhere}' not in html


def test_the_host_and_port_come_from_flags_then_environment(monkeypatch, capsys):
    monkeypatch.delenv("GRADIO_SERVER_NAME", raising=False)
    monkeypatch.delenv("GRADIO_SERVER_PORT", raising=False)
    assert (parse_config([]).host, parse_config([]).port) == ("127.0.0.1", 7860)
    monkeypatch.setenv("GRADIO_SERVER_NAME", "0.0.0.0")
    monkeypatch.setenv("GRADIO_SERVER_PORT", "7999")
    assert (parse_config([]).host, parse_config([]).port) == ("0.0.0.0", 7999)
    told = parse_config(["--port", "8000", "--max-minutes", "2", "--host-name", "lab.example"])
    assert (told.port, told.max_speech_s, told.host_names) == (8000, 120.0, ("lab.example",))
    for flags, words in (
        (["--port", "1", "--body", "/nowhere.npz"], "body file at /nowhere"),
        (["--port", "65536"], "0 to 65535; got 65536"),
    ):
        with pytest.raises(SystemExit):
            parse_config(flags)
        assert words in capsys.readouterr().err
    monkeypatch.setenv("GRADIO_SERVER_PORT", "many")
    with pytest.raises(SystemExit):
        parse_config([])
    assert "GRADIO_SERVER_PORT must be a whole number; got 'many'" in capsys.readouterr().err


def test_a_port_that_is_taken_is_told_before_anything_is_made(weights, tmp_path, monkeypatch):
    monkeypatch.setenv("GRADIO_TEMP_DIR", "")
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        config = AppConfig(port=port, weights=weights, temp_folder=tmp_path / "page")
        with pytest.raises(
            OSError, match=rf"Port {port} of 127\.0\.0\.1 is already in use.* with --port"
        ):
            launch(config, preloads_models=False)
    assert not (tmp_path / "page").exists()
    with pytest.raises(RunError, match="No trained systems"):
        launch(
            AppConfig(port=0, weights=tmp_path, temp_folder=tmp_path / "t"), preloads_models=False
        )


DEAD = "//127.0.0.1:1"
ELSEWHERE = {
    **{name: f"http:{DEAD}" for name in ("http_proxy", "HTTPS_PROXY")},
    **{name: f"socks5:{DEAD}" for name in ("ALL_PROXY", "all_proxy")},
    "MPLBACKEND": "module://matplotlib_inline.backend_inline",
}
"""What a firewall and a notebook leave in the environment of a page that is started there."""
HEAVY = {"torch", "scipy", "matplotlib", "librosa", "numba", "trimesh", "pyrender"}
HEAVY |= {"pocketsphinx", "model.speech.word_recognition"}
START = f"""
import json, signal, sys
from dataclasses import replace
from app.page import launch as starting
from app.page.worker import Worker
from app.run.requests.convert import replace_fields
from app.run.requests.requests import AnyRun

def tell(*_):
    print(json.dumps(sorted({HEAVY!r} & set(sys.modules))), flush=True)

def do(worker, task, asked, *told):
    bare = replace_fields(asked, has_figures=False) if isinstance(asked, AnyRun) else asked
    return done(worker, task, bare, *told)

def launch(config):
    page = launched(config)
    tell()
    return page

done, Worker.do = Worker.do, do
launched, starting.launch = starting.launch, launch
signal.signal(signal.SIGUSR1, tell)
starting.main(sys.argv[1:])
"""
"""A page that draws no figures, and tells what it has imported when it is asked."""


@pytest.mark.timeout(400)  # two runs, whose worker may have librosa to compile before them
def test_a_page_reads_files_and_computes_nothing_and_leaves_nothing_however_it_is_ended(
    weights, speech, tmp_path
):
    """torch alone takes longer to import than all of the page. Runs and their sentences come from a
    process of their own. Proxies that lead nowhere, and a backend of matplotlib that cannot be
    imported, change nothing."""
    list_ = tmp_path / "list.wav"
    list_.write_text("eggs, milk, bread\n" * 50)
    temp = tmp_path / "temp"
    temp.mkdir()
    child = subprocess.Popen(
        [sys.executable, "-c", START, "--port", "0", "--weights", str(weights)],
        cwd=ROOT,
        env={**os.environ, **ELSEWHERE, "TMPDIR": str(temp), "OMP_NUM_THREADS": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert child.stdout is not None and child.stderr is not None
    try:
        of_gradio = {"matplotlib", "scipy"}  # which it imports at the first click
        assert {*json.loads(child.stdout.readline())} <= of_gradio
        line = next(line for line in child.stderr if "open at" in line)
        address = line.split()[-1]
        with pytest.raises(AppError, match="not a sound file"):
            submit(address, "/generate", handle_file(str(list_)), *FORM.values())
        told = submit(address, "/generate", handle_file(str(speech)), *FORM.values())
        assert "Done in" in str(told)
        (motion,) = temp.rglob("results/globaldiff-global.npz")
        told = submit(address, "/own_motion", [handle_file(str(motion))])
        assert "Measured 1 motion" in str(told)
        child.send_signal(signal.SIGUSR1)
        assert {*json.loads(child.stdout.readline())} <= of_gradio
        answer = httpx.post(f"{address}gradio_api/upload", files=UPLOAD, timeout=60)
        path = Path(answer.json()[0])
        assert path.read_bytes() == b"sound" and temp in path.parents
        for number in range(2000):
            (path.parent / str(number)).touch()
        for again in range(3000):  # whoever asks again keeps it from nothing
            child.send_signal((signal.SIGTERM, signal.SIGINT)[again % 2])
            try:
                child.wait(0.02)
                break
            except subprocess.TimeoutExpired:
                pass
        _, told = child.communicate(timeout=60)
    finally:
        child.kill()
    assert child.returncode == 0
    assert [p for p in temp.rglob("*") if p.is_file() and p.name != ".lock"] == []
    assert str(ROOT / "app") not in told


def test_changes_that_do_not_fit_a_gradio_are_logged_and_the_page_is_served_without_them(
    weights, tmp_path, monkeypatch, caplog
):
    with served_page(weights, tmp_path / "as locked"):
        assert "Gradio" not in caplog.text
    monkeypatch.setattr(gradio_changes, "version", lambda name: "6.40.0")
    monkeypatch.delattr(file_component, "tempfile")
    monkeypatch.delitem(sys.modules, "app.page.visitors.turns", raising=False)
    monkeypatch.delattr(queueing, "EventQueue")
    with served_page(weights, tmp_path / "other") as page:
        assert page.client.get("/config").status_code == 200
    assert "Gradio 6.40.0 is installed; this page was written for Gradio 6.31" in caplog.text
    assert "leaves an empty temporary file for an hour" in caplog.text
    assert "the queue has no limits" in caplog.text and "functions end" not in caplog.text


def test_the_queue_is_bounded_and_a_page_at_rest_seldom_looks_who_waits(served):
    waiting = served.app.get_blocks()._queue
    assert (waiting.max_queue_size, waiting.default_concurrency_limit) == (
        AppConfig().max_queue_size,
        1,
    )
    assert waiting.sleep_when_free >= 0.01


STUCK = """
import atexit, signal, threading
from app.page import launch
launch.END_WITHIN_S = 0.1
atexit.register(lambda: threading.Event().wait())
signal.signal(signal.SIGTERM, launch._exit_on_signal)
print("ready", flush=True)
while True:
    threading.Event().wait(0.1)
"""


def test_what_cannot_be_tidied_up_in_time_does_not_keep_it_from_ending():
    command = [sys.executable, "-c", STUCK]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as child:
        try:
            assert child.stdout is not None and child.stdout.readline() == "ready\n"
            child.send_signal(signal.SIGTERM)
            child.send_signal(signal.SIGTERM)
            assert child.wait(60) == 1
        finally:
            child.kill()
