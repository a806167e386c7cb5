"""Who is let in: by host name, by the page that asks, by account, and through a proxy."""

import os

import pytest
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

from app.config import AppConfig
from app.errors import RunError
from app.page.launch import parse_config
from app.page.routes.guard import HostNames, is_same_origin, security_headers
from tests.app.page.conftest import ADDRESS, UPLOAD, Served, served_page

HOSTS = {
    "127.0.0.1": True, "127.0.0.1:1": True, "localhost": True, "lab.example": True,
    "LAB.example:8443": True, "evil.example": False, "": False, "[": False, "\x1b[2J": False,
    "lab.example.evil.example": False, "192.168.1.7": False, "evil.example@lab.example": False,
    "lab.example#evil.example": False, "lab.example/evil.example": False, "a\\@lab.example": False,
    "[::1]": True, "[::1]:1": True, "[::1]evil.example": False, "localhost:evil": False,
}  # fmt: skip


@pytest.fixture
def client(served: Served) -> TestClient:
    return served.visitor()


def test_only_a_host_of_its_own_is_answered_and_others_are_told_the_way_out(client):
    for host, is_own in HOSTS.items():
        for path in ("/", "/config", "/gradio_api/info", "/web/player/player.js"):
            answer = client.get(path, headers={"Host": host})
            assert answer.status_code == (200 if is_own else 421), (host, path)
            assert is_own or ("--host-name" in answer.text and answer.text.isprintable())
    assert "192.168.1.7:7860" in HostNames("0.0.0.0") and "[fe80::1]:7860" in HostNames("::")
    assert "evil.example" not in HostNames("0.0.0.0")


@pytest.mark.parametrize("route", ["static", "assets", "svelte", "web", "gradio_api/file="])
def test_a_name_that_no_file_has_is_not_found(client, route):
    for name in ("a" * 5000, "é" * 200):
        answer = client.get(f"/{route}/{name}")
        assert answer.status_code == 404 and "255 bytes" in answer.text


@pytest.mark.parametrize(
    "origin",
    ["https://evil.example", "null", "http://localhost:1", "http://lab.example@evil.example"],
)
@pytest.mark.parametrize("host", ["127.0.0.1", "lab.example"])
def test_pages_of_other_sites_get_nothing(client, origin, host):
    headers = {"Origin": origin, "Host": host}
    preflight = {**headers, "Access-Control-Request-Method": "POST"}
    for answer in (
        client.get("/config", headers=headers),
        client.post("/gradio_api/upload", files=UPLOAD, headers=headers),
        client.post("/gradio_api/call/generate", json={"data": []}, headers=headers),
        client.post("/visitor", headers=headers),
        client.options("/gradio_api/upload", headers=preflight),
    ):
        assert answer.status_code == 403
        assert not any(name.startswith("access-control") for name in answer.headers)
    with pytest.raises(WebSocketDisconnect):
        with client.websocket_connect("/live/speak", headers=headers):
            pass


def test_its_own_page_may_do_all_and_a_link_leads_to_it(client):
    for host in ("127.0.0.1", "lab.example"):
        own = {"Origin": f"http://{host}", "Host": host, "Sec-Fetch-Site": "same-origin"}
        answer = client.post("/gradio_api/upload", files=UPLOAD, headers=own)
        assert answer.status_code == 200
        with client.websocket_connect("/live/speak", headers=own) as speech:
            speech.send_text("{}")
            assert "Choose a system" in speech.receive_text()
    cross = {"Sec-Fetch-Site": "cross-site"}
    assert client.get("/", headers=cross).status_code == 200
    assert client.post("/gradio_api/upload", files=UPLOAD, headers=cross).status_code == 403


def test_origins_are_compared_whole():
    assert is_same_origin("https://a.example:7860", "A.example:7860")
    for origin, host in (
        ("http://a.example:7860@evil.example", "a.example:7860"),
        ("http://a.example.evil.example", "a.example"),
        ("http://a.example:81", "a.example"),
        ("null", "a.example"),
        ("http://[", "a.example"),
        ("//a.example", "a.example"),
        ("javascript://a.example", "a.example"),
        ("", ""),
        (None, None),
    ):
        assert not is_same_origin(origin, host), origin


def test_with_accounts_nothing_is_given_before_the_login(weights, tmp_path, capsys):
    file = tmp_path / "accounts.txt"
    file.write_text("# the lab\nann:her pass:word\n\n")
    accounts = parse_config(["--auth", str(file)]).accounts
    assert accounts == (("ann", "her pass:word"),)
    with served_page(weights, tmp_path / "page", accounts=accounts) as page:
        client = page.client
        for path in ("/config", "/media/x", "/live/example/0", "/live/body.glb", "/web/../media/x"):
            assert client.get(path).status_code == 401, path
        for path in ("/gradio_api/upload", "/visitor"):
            assert client.post(path, files=UPLOAD).status_code == 401, path
        wrong, right = ({"username": "ann", "password": p} for p in ("guess", "her pass:word"))
        assert client.post("/login", data=wrong).status_code == 400
        assert client.post("/login", data=right).status_code == 200
        for path, status in (
            ("/config", 200),
            ("/live/example/three_reasons.wav", 200),
            ("/media/x", 404),
        ):
            assert client.get(path).status_code == status
    file.write_text("ann\n")
    with pytest.raises(SystemExit):
        parse_config(["--auth", str(file)])
    assert "NAME:PASSWORD" in capsys.readouterr().err


def test_no_other_site_shows_the_page_in_a_frame(client, monkeypatch):
    for path in ("/", "/config", "/web/player/player.js", "/media/x"):
        headers = client.get(path).headers
        assert "frame-ancestors 'self'" in headers["content-security-policy"].split(", ")
        assert headers["x-frame-options"] == "SAMEORIGIN"
        assert headers["x-content-type-options"] == "nosniff"
    refused = client.get("/", headers={"Host": "evil.example"})
    assert refused.headers["content-security-policy"] == "frame-ancestors 'self'"
    told = dict(security_headers(("https://lab.example",)))
    assert told[b"content-security-policy"] == b"frame-ancestors 'self' https://lab.example"
    assert b"x-frame-options" not in told
    monkeypatch.setenv("SPACE_HOST", "us-page.hf.space")
    told = dict(security_headers())
    assert told[b"content-security-policy"].endswith(b"https://huggingface.co https://*.hf.space")
    assert b"x-frame-options" not in told
    assert "us-page.hf.space" in HostNames("0.0.0.0")


def test_a_claim_of_another_address_is_believed_of_a_proxy_that_was_named_and_of_names_of_its_own(
    client, weights, tmp_path
):
    def root(client: TestClient, **headers: str) -> str:
        named = {name.replace("_", "-"): value for name, value in headers.items()}
        return client.get("/config", headers=named).json()["root"]

    for host in ("evil.example", "lab.example"):  # its own, too: no proxy was named
        for claim in (
            {"X_Forwarded_Host": host},
            {"X_Forwarded_Host": host, "X_Forwarded_Proto": "https"},
            {"X_Gradio_Server": f"https://{host}"},
        ):
            assert root(client, **claim) == ADDRESS.rstrip("/"), claim
    proxies = parse_config(["--proxy", "10.0.0.2", "--proxy", "10.1.0.0/16"]).trusted_proxies
    names = {"trusted_proxies": proxies, "host_names": ("lab.example",)}
    with served_page(weights, tmp_path, **names) as page:
        assert os.environ["FORWARDED_ALLOW_IPS"] == "127.0.0.1,::1,10.0.0.2,10.1.0.0/16"
        claim = {"X_Forwarded_Host": "lab.example", "X_Forwarded_Proto": "https"}
        assert root(page.client, **claim) == "https://lab.example"
        assert "evil" not in root(page.client, X_Forwarded_Host="evil.example")
        assert "evil" not in root(page.client, X_Gradio_Server="https://evil.example")
    for flag, value in (("--proxy", "lab.example"), ("--embed-in", "lab.example"),
                        ("--embed-in", "https://a; b")):  # fmt: skip
        with pytest.raises(RunError, match=f"{flag} takes .*; got {value}"):
            is_proxy = flag == "--proxy"
            AppConfig(trusted_proxies=(value,)) if is_proxy else AppConfig(frame_ancestors=(value,))


def test_all_is_found_below_a_root_path_whether_a_proxy_removes_it_or_not(weights, tmp_path):
    """And asks for a login there, too."""
    with served_page(weights, tmp_path / "1", root_path="/lab/") as page:
        for before in ("", "/lab"):
            for path in ("/web/player/player.js", "/stage/facts.json", "/theme.css", "/config"):
                assert page.client.get(before + path).status_code == 200, before + path
            assert page.client.post(f"{before}/visitor").status_code == 204
            assert page.client.get(f"{before}/config").json()["root"] == f"{ADDRESS}lab"
            own = {"Origin": ADDRESS.rstrip("/"), "Host": "127.0.0.1"}
            with page.client.websocket_connect(f"{before}/live/speak", headers=own):
                pass
        assert page.client.get("/laboratory/web/player/player.js").status_code == 404
    accounts = (("ann", "word"),)
    with served_page(weights, tmp_path / "2", root_path="/lab", accounts=accounts) as page:
        for path in ("/media/x/a", "/lab/media/x/a", "/lab/visitor"):
            assert page.client.get(path).status_code == 401, path
    for wrong in ("lab", "/lab?x", "https://", "//evil"):
        with pytest.raises(RunError, match="--root-path takes a path"):
            AppConfig(root_path=wrong)


def test_what_the_page_has_not_is_told_in_a_sentence(client):
    for path, body in (
        ("queue/join", {"data": [], "fn_index": 99_999, "session_hash": "a"}),
        ("queue/join", {"data": [], "fn_index": -1, "session_hash": "a"}),
        ("call/nothing", {"data": []}),
    ):
        answer = client.post(f"/gradio_api/{path}", json=body)
        assert answer.status_code == 404 and "There is no such function" in answer.text
    for page in ("%00", "", "https://evil.example/", "x"):
        answer = client.get(f"/gradio_api/proxy={page}")
        assert answer.status_code == 404 and "does not load pages" in answer.text
    for path in ("component_server", "component_server/", "process_recording"):
        answer = client.post(f"/gradio_api/{path}", files={"video": ("a.wav", b"sound")})
        assert answer.status_code == 404 and "with the forms" in answer.text


def test_a_wrong_call_is_told_without_folders_and_costs_a_line_of_the_log(served, caplog, capsys):
    client = served.client  # in the loop of the queue: what waits in another is not woken
    outside = {"path": "/etc/passwd", "meta": {"_type": "gradio.FileData"}}
    ours = {"path": str(served.temp / "jobs" / "x"), "meta": {"_type": "gradio.FileData"}}
    for name, data in (
        ("mechanism", []),
        ("mechanism", [{"a": 1}, 3, None]),
        ("own_motion", [[outside]]),
        ("own_motion", [[ours]]),
        ("study_plan", ["t", "no such protocol", [ours]]),
    ):
        caplog.clear()
        event = client.post(f"/gradio_api/call/{name}", json={"data": data}).json()["event_id"]
        answer = client.get(f"/gradio_api/call/{name}/{event}").text
        assert "event: error" in answer and str(served.temp) not in answer
        (line,) = caplog.messages
        assert "an invalid API call" in line and "\n" not in line and len(line) < 400
    assert "Traceback" not in capsys.readouterr().err
