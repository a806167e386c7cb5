"""The page without a browser: through Gradio's own client, as any program may use it."""

import socket
import subprocess
import sys
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from gradio import Blocks, http_server
from gradio_client import Client, handle_file
from gradio_client.exceptions import AppError

from app import text
from app.config import AppConfig
from app.errors import RunError
from app.page import launch as launch_module
from app.page.launch import launch, parse_config
from app.page.routes.media import GONE
from tests.helpers import ROOT

FORM = {
    "systems": ["globaldiff/global"],
    "speaker": "ann",
    "seed": 0,
    "samples": 1,
    "steps": "1",
    "sampler": "euler",
    "is_smoothed": False,
    "reference": None,
    "point": "right_middle",
    "start_frame": 0,
    "transcript": None,
    "body_steps": 0,
    "face_steps": 0,
}


def test_the_page_is_made_without_what_is_slow_to_import() -> None:
    """torch alone takes longer to import than all of the page; the warm-up does, behind it."""
    heavy = {"torch", "scipy", "matplotlib", "librosa", "numba", "trimesh", "pyrender"}
    heavy |= {"pocketsphinx", "model.speech.recognised"}
    code = f"import sys, app.page.page; print(sorted({heavy} & set(sys.modules)))"
    child = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert child.stdout.strip() == "[]"


@pytest.fixture(scope="module")
def page(weights: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Blocks]:
    """The real one with tiny weights."""
    temp = tmp_path_factory.mktemp("page")
    page = launch(AppConfig(port=0, weights=weights, temp=temp), is_warmed_up=False)
    yield page
    page.close()


@pytest.fixture(scope="module")
def address(page: Blocks) -> str:
    return page.local_url


def test_every_route_is_there_as_soon_as_the_server_listens(
    weights: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("GRADIO_TEMP_DIR", "")  # launching sets it for the whole process
    answers: list[int] = []
    start_server = http_server.start_server

    def start_and_ask(*args, **options):
        """What a browser meets that asks before anything else has happened."""
        started = start_server(*args, **options)
        with httpx.Client(base_url=started[2], timeout=10) as client:
            answers.append(client.get("web/player/player.js").status_code)
            answers.append(client.post("study/visitor").status_code)
            answers.append(client.get("media/none").status_code)
            assert client.get("media/none").text == GONE
        return started

    monkeypatch.setattr(http_server, "start_server", start_and_ask)
    page = launch(AppConfig(port=0, weights=weights, temp=tmp_path), is_warmed_up=False)
    page.close()
    assert answers == [200, 204, 404]


def test_the_page_opens_on_a_machine_too_busy_to_answer_itself_at_once(
    weights: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gradio.networking.url_ok", lambda url: False)
    page = launch(AppConfig(port=0, weights=weights, temp=tmp_path), is_warmed_up=False)
    assert httpx.get(str(page.local_url)).status_code == 200
    page.close()


@pytest.fixture
def client(address: str, tmp_path: Path) -> Client:
    return Client(address, verbose=False, download_files=str(tmp_path), analytics_enabled=False)


def submit(client: Client, speech: Path | None, **changes):
    values = {**FORM, **changes}
    sound = handle_file(str(speech)) if speech else None
    return client.submit(sound, *values.values(), api_name="/generate")


def test_bad_speech_gives_its_sentence(client: Client, bad_speech: tuple[Path, str]) -> None:
    speech, words = bad_speech
    with pytest.raises(AppError) as caught:
        submit(client, speech).result(timeout=60)
    assert words in str(caught.value)


def test_a_bad_reference_gives_its_sentence(
    client: Client, speech: Path, bad_motion: tuple[Path, str]
) -> None:
    motion, words = bad_motion
    with pytest.raises(AppError) as caught:
        submit(client, speech, reference=handle_file(str(motion))).result(timeout=60)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"systems": []}, text.NO_SYSTEM),
        ({"seed": -5}, "-5"),
        ({"seed": 1.5}, "got 1.5"),
        ({"samples": 1.5}, "got 1.5"),
        ({"speaker": "nobody"}, "nobody"),
        ({"start_frame": 5000}, "got 5000"),
    ],
)
def test_a_form_that_cannot_be_done_gives_a_sentence(
    client: Client, speech: Path, changes: dict, words: str
) -> None:
    with pytest.raises(AppError) as caught:
        submit(client, speech, **changes).result(timeout=60)
    assert words in str(caught.value)


def test_clicks_of_the_past_are_not_counted_up(client: Client, page: Blocks) -> None:
    for _ in range(3):
        with pytest.raises(AppError):
            submit(client, None).result()
    assert len(page._queue.event_analytics) <= 1
    assert page._queue.cached_event_analytics_summary == {"functions": {}}


def test_without_speech_the_page_asks_for_it(client: Client) -> None:
    with pytest.raises(AppError) as caught:
        submit(client, None).result(timeout=60)
    assert text.NO_SPEECH in str(caught.value)


def test_a_program_must_name_only_what_a_run_cannot_do_without(client: Client) -> None:
    with pytest.raises(AppError, match="at least one motion"):
        client.predict(motions=[], api_name="/own_motion")
    endpoints = client.view_api(return_format="dict", print_info=False)["named_endpoints"]
    needed = {
        name: {p["parameter_name"] for p in each["parameters"] if not p["parameter_has_default"]}
        for name, each in endpoints.items()
    }
    assert (needed["/own_motion"], needed["/generate"]) == ({"motions"}, {"speech"})
    assert needed["/study"] == set()


@pytest.mark.gl
def test_a_run_ends_with_every_file(client: Client, speech: Path) -> None:
    result = submit(client, speech).result(timeout=180)
    status = next(part for part in result if isinstance(part, str) and "Done in" in part)
    assert "37 frames" in status
    files = next(part for part in result if isinstance(part, list) and len(part) > 5)
    names = {Path(str(file)).name for file in files}
    assert {"globaldiff-global.npz", "diagnostics.csv", "figure6.png"} <= names


@pytest.mark.parametrize(
    "path",
    [
        "pyproject.toml",
        "requirements.txt",
        "renderer/assets/open_body.npz",
        "app/text.py",
        ".git/HEAD",
    ],
)
def test_files_of_the_program_are_not_served(address: str, path: str) -> None:
    assert (ROOT / path).exists()
    for written in (str(ROOT / path), path, f"../{path}"):
        url = f"{address}gradio_api/file={urllib.parse.quote(written)}"
        with pytest.raises(urllib.error.HTTPError) as caught:
            urllib.request.urlopen(url, timeout=10)
        assert caught.value.code in (403, 404)


def test_weights_are_not_served(address: str, weights: Path) -> None:
    url = f"{address}gradio_api/file={weights / 'globaldiff-local.safetensors'}"
    with pytest.raises(urllib.error.HTTPError) as caught:
        urllib.request.urlopen(url, timeout=10)
    assert caught.value.code in (403, 404)


def test_the_page_tells_no_one_and_loads_nothing_from_elsewhere(address: str) -> None:
    html = urllib.request.urlopen(address, timeout=10).read().decode()
    assert '"analytics_enabled":false' in html.replace(" ", "")
    for elsewhere in ("fonts.googleapis.com", "fonts.gstatic.com", "cdn.jsdelivr"):
        assert f'href="https://{elsewhere}' not in html


def test_the_host_and_port_come_from_flags_then_environment(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("GRADIO_SERVER_NAME", raising=False)
    monkeypatch.delenv("GRADIO_SERVER_PORT", raising=False)
    assert (parse_config([]).host, parse_config([]).port) == ("127.0.0.1", 7860)
    monkeypatch.setenv("GRADIO_SERVER_NAME", "0.0.0.0")
    monkeypatch.setenv("GRADIO_SERVER_PORT", "7999")
    assert (parse_config([]).host, parse_config([]).port) == ("0.0.0.0", 7999)
    assert parse_config(["--port", "8000"]).port == 8000
    monkeypatch.setenv("GRADIO_SERVER_PORT", "many")
    with pytest.raises(RunError, match="many"):
        parse_config([])
    monkeypatch.delenv("GRADIO_SERVER_PORT")
    with pytest.raises(RunError, match="body"):
        parse_config(["--port", "1", "--body", "/nowhere.npz"])


def test_a_port_that_is_taken_is_told_before_anything_is_made(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(OSError, match=rf"Port {port} of 127\.0\.0\.1 is taken.* with --port"):
            launch(AppConfig(port=port, temp=tmp_path / "page"))
    assert not (tmp_path / "page").exists()


def test_a_port_that_another_page_takes_meanwhile_is_told_alike(
    weights: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked, check = [], launch_module.check_port

    def free_at_first(config: AppConfig) -> None:
        asked.append(config)
        if len(asked) > 1:
            check(config)

    monkeypatch.setattr(launch_module, "check_port", free_at_first)
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(OSError, match=rf"Port {port} of 127\.0\.0\.1 is taken"):
            launch(AppConfig(port=port, weights=weights, temp=tmp_path), is_warmed_up=False)


def test_no_weights_gives_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="No trained systems"):
        launch(AppConfig(port=0, weights=tmp_path, temp=tmp_path / "t"), is_warmed_up=False)
