"""Who is let in: by host name, by the page that asks, by account, and through a proxy."""

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest
from gradio_client import Client
from websockets.exceptions import InvalidStatus
from websockets.sync.client import ClientConnection, connect

from app.config import AppConfig
from app.errors import RunError
from app.page.launch import launch, parse_config
from app.page.serving.guard import HostNames
from tests.helpers import ROOT

UPLOAD = {"files": ("a.wav", b"sound")}


@contextmanager
def served(weights: Path, temp: Path, **settings) -> Iterator[httpx.Client]:
    config = AppConfig(port=0, weights=weights, temp=temp, **settings)
    page = launch(config, is_warmed_up=False)
    try:
        with httpx.Client(base_url=page.local_url, timeout=20) as client:
            yield client
    finally:
        page.close()


@pytest.fixture(scope="module")
def client(weights: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    temp = tmp_path_factory.mktemp("page")
    with served(weights, temp, host_names=("lab.example",)) as client:
        yield client


def own_host(client: httpx.Client) -> str:
    return client.base_url.netloc.decode()


def live_socket(port: int, host: str, origin: str) -> ClientConnection:
    """A WebSocket to this machine under another name."""
    return connect(
        f"ws://{host}:{port}/live/speak",
        sock=socket.create_connection(("127.0.0.1", port)),
        additional_headers={"Origin": origin},
    )


@pytest.mark.parametrize("host", ["evil.example", "", "lab.example.evil.example", "[", "\x1b[2J"])
def test_a_foreign_host_is_refused_with_the_way_out(client: httpx.Client, host: str) -> None:
    for path in ("/", "config", "gradio_api/info", "web/player/player.js"):
        answer = client.get(path, headers={"Host": host})
        assert answer.status_code == 421 and "--host-name" in answer.text
        assert answer.text.isprintable()


@pytest.mark.parametrize("host", ["lab.example", "LAB.example:8443", "localhost", "127.0.0.1:1"])
def test_its_own_names_are_answered(client: httpx.Client, host: str) -> None:
    assert client.get("config", headers={"Host": host}).status_code == 200


def test_bound_to_all_addresses_it_answers_to_addresses_and_no_names() -> None:
    assert "192.168.1.7:7860" in HostNames("0.0.0.0") and "[fe80::1]:7860" in HostNames("::")
    assert "evil.example" not in HostNames("0.0.0.0")
    assert "192.168.1.7" not in HostNames("127.0.0.1")


@pytest.mark.parametrize(
    "origin",
    ["https://evil.example", "null", "http://localhost:1", "http://lab.example@evil.example"],
)
@pytest.mark.parametrize("host", [None, "lab.example"])
def test_pages_of_other_sites_get_nothing(
    client: httpx.Client, origin: str, host: str | None
) -> None:
    headers = {"Origin": origin} | ({"Host": host} if host else {})
    preflight = {**headers, "Access-Control-Request-Method": "POST"}
    for answer in (
        client.get("config", headers=headers),
        client.post("gradio_api/upload", files=UPLOAD, headers=headers),
        client.post("gradio_api/call/generate", json={"data": []}, headers=headers),
        client.post("study/visitor", headers=headers),
        client.options("gradio_api/upload", headers=preflight),
    ):
        assert answer.status_code == 403
        assert not any(name.startswith("access-control") for name in answer.headers)


def test_a_form_of_another_site_is_refused_without_an_origin_too(client: httpx.Client) -> None:
    headers = {"Sec-Fetch-Site": "cross-site"}
    assert client.post("gradio_api/upload", files=UPLOAD, headers=headers).status_code == 403
    assert client.get("/", headers=headers).status_code == 200  # a link


def test_its_own_page_may_do_all(client: httpx.Client) -> None:
    headers = {"Origin": f"http://{own_host(client)}", "Sec-Fetch-Site": "same-origin"}
    assert client.post("gradio_api/upload", files=UPLOAD, headers=headers).status_code == 200
    headers = {"Origin": "https://lab.example", "Host": "lab.example"}
    assert client.post("gradio_api/upload", files=UPLOAD, headers=headers).status_code == 200


def test_live_speech_is_guarded_too(client: httpx.Client) -> None:
    port = client.base_url.port or 0
    with pytest.raises(InvalidStatus):
        live_socket(port, "127.0.0.1", "https://evil.example")
    with pytest.raises(InvalidStatus):
        live_socket(port, "evil.example", f"http://evil.example:{port}")
    with live_socket(port, "lab.example", f"http://lab.example:{port}") as speech:
        speech.send("{}")
        assert "Choose a system" in str(speech.recv())


def test_with_accounts_nothing_is_given_before_the_login(weights: Path, tmp_path: Path) -> None:
    file = tmp_path / "accounts.txt"
    file.write_text("# the lab\nann:her pass:word\n\n")
    accounts = parse_config(["--auth", str(file)]).accounts
    assert accounts == (("ann", "her pass:word"),)
    with served(weights, tmp_path / "page", accounts=accounts) as client:
        for path in ("config", "media/x", "live/example/0", "live/body.glb"):
            assert client.get(path).status_code == 401
        assert client.post("gradio_api/upload", files=UPLOAD).status_code == 401
        assert client.post("study/visitor").status_code == 401
        wrong = {"username": "ann", "password": "guess"}
        assert client.post("login", data=wrong).status_code == 400
        right = {"username": "ann", "password": "her pass:word"}
        assert client.post("login", data=right).status_code == 200
        for path in ("config", "live/example/0"):
            assert client.get(path).status_code == 200
        assert client.get("media/x").status_code == 404
        Client(str(client.base_url), auth=("ann", "her pass:word"), verbose=False)
    file.write_text("ann\n")
    with pytest.raises(RunError, match="NAME:PASSWORD"):
        parse_config(["--auth", str(file)])


def test_a_server_that_is_ended_leaves_nothing(weights: Path, tmp_path: Path) -> None:
    environment = {**os.environ, "TMPDIR": str(tmp_path), "OMP_NUM_THREADS": "1"}
    child = subprocess.Popen(
        [sys.executable, "app.py", "--port", "0", "--weights", str(weights)],
        cwd=ROOT, env=environment, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert child.stderr is not None
    line = next(line for line in child.stderr if "open at" in line)
    address = line.split()[-1]
    path = httpx.post(f"{address}gradio_api/upload", files=UPLOAD, timeout=20).json()[0]
    assert Path(path).read_bytes() == b"sound"
    child.send_signal(signal.SIGTERM)
    child.wait(20)
    assert [p for p in tmp_path.rglob("*") if p.is_file() and p.name != ".lock"] == []
