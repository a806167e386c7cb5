"""The real page with tiny weights, asked within this process: no server listens on a port."""

import asyncio
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import httpx
import pytest
from fastapi import FastAPI
from gradio import http_server
from starlette.testclient import TestClient

from app.config import AppConfig
from app.page.launch import launch

ADDRESS = "http://127.0.0.1/"
UPLOAD = {"files": ("a.wav", b"sound")}


class Served:
    """A page, and the browsers of different addresses that ask it."""

    def __init__(self, app: FastAPI, client: TestClient, temp: Path) -> None:
        self.app, self.client, self.temp = app, client, temp
        self._num_visitors = 0

    def visitor(self) -> TestClient:
        """Of an address that has sent nothing yet."""
        self._num_visitors += 1
        return TestClient(self.app, ADDRESS, client=(f"10.0.0.{self._num_visitors}", 1))

    def uploads(self) -> set[Path]:
        """What lies there of all visitors."""
        return {path for path in (self.temp / "gradio").rglob("*") if path.is_file()}

    def sent(
        self, address: str, body: bytes, boundary: str, more: Mapping[str, Any]
    ) -> list[dict[str, Any]]:
        """What is answered to an upload that does not say how long it is, and then has ``more``."""
        coming = [{"type": "http.request", "body": body, "more_body": True}, dict(more)]
        answers: list[dict[str, Any]] = []

        async def receive() -> dict[str, Any]:
            return coming.pop(0) if coming else {"type": "http.disconnect"}

        async def send(message: Any) -> None:
            answers.append(message)

        scope = {
            "type": "http", "method": "POST", "path": "/gradio_api/upload", "root_path": "",
            "query_string": b"", "scheme": "http", "http_version": "1.1", "client": (address, 1),
            "headers": [
                (b"host", b"127.0.0.1"),
                (b"content-type", f"multipart/form-data; boundary={boundary}".encode()),
            ],
        }  # fmt: skip
        asyncio.run(self.app(scope, receive, send))  # type: ignore[arg-type]
        return answers


@contextmanager
def served_page(weights: Path, temp: Path, **settings: Any) -> Iterator[Served]:
    """As `launch` makes it, but for the server."""
    config = AppConfig(port=0, weights=weights, temp_folder=temp, **settings)
    clients: list[TestClient] = []
    with ExitStack() as stack, pytest.MonkeyPatch.context() as environment:

        def start_server(app: FastAPI, **_: Any) -> tuple[str, int, str, Any]:
            clients.append(stack.enter_context(TestClient(app, ADDRESS)))
            return "127.0.0.1", 80, ADDRESS, SimpleNamespace(close=lambda: None)

        environment.setenv("GRADIO_TEMP_DIR", "")  # launching sets it for the whole process
        environment.setenv("FORWARDED_ALLOW_IPS", "")
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(http_server, "start_server", start_server)
            patch.setattr(httpx, "get", lambda url, **_: clients[0].get(url))
            page = launch(config, preloads_models=False)
        yield Served(page.app, clients[0], temp)
        page.close()


@pytest.fixture(scope="session")
def served(weights: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """One page for all tests that need no other; it is swept all the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("app.page.visitors.job_folders.SWEEP_EVERY_S", 0.2)
        temp = tmp_path_factory.mktemp("page")
        with served_page(weights, temp, host_names=("lab.example",)) as page:
            yield page
