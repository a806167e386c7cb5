"""Who is let in: by host name, by the page that asks, by account, and through a proxy."""

import itertools
import logging
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
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from app.config import AppConfig
from app.errors import RunError
from app.page.launch import launch, parse_config
from app.page.routes.guard import Framing, HostNames
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


def test_no_other_site_shows_the_page_in_a_frame(
    client: httpx.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    for path in ("/", "config", "web/player/player.js", "media/x"):
        headers = client.get(path).headers
        assert "frame-ancestors 'self'" in headers["content-security-policy"].split(", ")
        assert headers["x-frame-options"] == "SAMEORIGIN"
    refused = client.get("/", headers={"Host": "evil.example"})
    assert refused.headers["content-security-policy"] == "frame-ancestors 'self'"
    told = dict(Framing(("https://lab.example",)).headers)
    assert told == {b"content-security-policy": b"frame-ancestors 'self' https://lab.example"}
    monkeypatch.setenv("SPACE_HOST", "us-page.hf.space")
    told = dict(Framing().headers)
    assert told[b"content-security-policy"].endswith(b"https://huggingface.co https://*.hf.space")
    assert b"x-frame-options" not in told


@pytest.mark.parametrize("name", ["X-Forwarded-Host", "X-Gradio-Server"])
def test_nobody_can_claim_another_address_for_the_page(client: httpx.Client, name: str) -> None:
    for host in ("evil.example", "lab.example"):  # its own, too: no proxy was named
        value = host if name == "X-Forwarded-Host" else f"https://{host}"
        root = client.get("config", headers={name: value}).json()["root"]
        assert root == str(client.base_url).rstrip("/")


def test_a_proxy_that_was_named_is_believed_what_the_page_answers_to(
    weights: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("FORWARDED_ALLOW_IPS", raising=False)
    config = parse_config(["--proxy", "10.0.0.2", "--proxy", "10.1.0.0/16"])
    assert config.proxies == ("10.0.0.2", "10.1.0.0/16")
    names = {"proxies": config.proxies, "host_names": ("lab.example",)}
    with served(weights, tmp_path, **names) as client:
        assert os.environ["FORWARDED_ALLOW_IPS"] == "127.0.0.1,::1,10.0.0.2,10.1.0.0/16"
        forwarded = {"X-Forwarded-Host": "lab.example", "X-Forwarded-Proto": "https"}
        assert client.get("config", headers=forwarded).json()["root"] == "https://lab.example"
        forwarded = {"X-Forwarded-Host": "evil.example"}
        assert "evil" not in client.get("config", headers=forwarded).json()["root"]


@pytest.mark.parametrize(
    ("flag", "value"),
    [("--proxy", "lab.example"), ("--embed-in", "lab.example"), ("--embed-in", "https://a; b")],
)
def test_what_is_no_proxy_and_no_site_is_told(flag: str, value: str) -> None:
    with pytest.raises(RunError, match=f"{flag} takes .*; got {value}"):
        parse_config([flag, value])


@pytest.mark.parametrize("number", [99_999, -1])
def test_a_function_that_is_not_there_is_told(client: httpx.Client, number: int) -> None:
    asked = {"data": [], "fn_index": number, "session_hash": "a"}
    for path, body in (("queue/join", asked), ("call/nothing", {"data": []})):
        answer = client.post(f"gradio_api/{path}", json=body)
        assert answer.status_code == 404 and "no such function" in answer.text


@pytest.mark.parametrize("page", ["%00", "", "https://evil.example/", "x"])
def test_pages_of_others_are_not_fetched(client: httpx.Client, page: str) -> None:
    answer = client.get(f"gradio_api/proxy={page}")
    assert answer.status_code == 404 and "their own address" in answer.text


def test_a_frame_that_is_no_text_ends_its_socket_and_is_no_fault(client: httpx.Client) -> None:
    logged: list[logging.LogRecord] = []

    class Noted(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            logged.append(record)

    noted = Noted()
    logging.getLogger("uvicorn.error").addHandler(noted)
    port = client.base_url.port or 0
    try:
        with live_socket(port, "127.0.0.1", f"http://127.0.0.1:{port}") as speech:
            speech.send(b"\xff\xfe", text=True)
            with pytest.raises(ConnectionClosed):
                speech.recv(10)
        assert client.get("config").status_code == 200
    finally:
        logging.getLogger("uvicorn.error").removeHandler(noted)
    assert [record for record in logged if record.exc_info] == []


def test_whoever_asks_it_to_end_again_and_again_leaves_nothing_either(
    weights: Path, tmp_path: Path
) -> None:
    environment = {**os.environ, "TMPDIR": str(tmp_path), "OMP_NUM_THREADS": "1"}
    child = subprocess.Popen(
        [sys.executable, "app.py", "--port", "0", "--weights", str(weights)],
        cwd=ROOT,
        env=environment,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert child.stderr is not None
    line = next(line for line in child.stderr if "open at" in line)
    address = line.split()[-1]
    path = Path(httpx.post(f"{address}gradio_api/upload", files=UPLOAD, timeout=20).json()[0])
    for number in range(12_560):
        (path.parent / str(number)).touch()
    for again in itertools.count():
        child.send_signal((signal.SIGTERM, signal.SIGINT)[again % 2])
        try:
            child.wait(0.02)
            break
        except subprocess.TimeoutExpired:
            assert again < 1500
    assert [p for p in tmp_path.rglob("*") if p.is_file() and p.name != ".lock"] == []
    # torch's own finalizers may complain where the end comes amid its import.
    assert str(ROOT / "app") not in child.stderr.read()


def test_a_server_that_is_ended_leaves_nothing(weights: Path, tmp_path: Path) -> None:
    environment = {**os.environ, "TMPDIR": str(tmp_path), "OMP_NUM_THREADS": "1"}
    child = subprocess.Popen(
        [sys.executable, "app.py", "--port", "0", "--weights", str(weights)],
        cwd=ROOT,
        env=environment,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert child.stderr is not None
    line = next(line for line in child.stderr if "open at" in line)
    address = line.split()[-1]
    path = httpx.post(f"{address}gradio_api/upload", files=UPLOAD, timeout=20).json()[0]
    assert Path(path).read_bytes() == b"sound"
    child.send_signal(signal.SIGTERM)
    child.wait(20)
    assert [p for p in tmp_path.rglob("*") if p.is_file() and p.name != ".lock"] == []
