"""A visitor over HTTP, asking as the page in a browser does."""

from __future__ import annotations

import json
import secrets
import ssl
import time
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager
from typing import Any

import httpx
from websockets.sync.client import connect

PATIENCE_S = 600.0
SILENT_S = 2.0
"""After the last frames of live speech."""


class Refused(Exception):
    """A run that ended with a sentence, which this is."""


class Visitor(AbstractContextManager["Visitor"]):
    """One open page in one browser, of an address of its own on this machine's loopback."""

    def __init__(
        self,
        address: str,
        number: int,
        tls: ssl.SSLContext | None = None,
        account: tuple[str, str] | None = None,
    ) -> None:
        """
        Args:
            address: of the page.
            number: of the visitor, from 0 on.
            tls: who is trusted, where the page has https.
            account: name and password, where the page asks for them.
        """
        self._tls = tls
        self._own = f"127.0.{1 + number // 200}.{1 + number % 200}"
        self._session = secrets.token_hex(6)
        self._client = httpx.Client(
            base_url=address,
            transport=httpx.HTTPTransport(verify=tls or True, local_address=self._own),
            headers={
                "Origin": str(httpx.URL(address).copy_with(path="/")).rstrip("/"),
                "X-Forwarded-For": "8.8.8.8",
            },
            timeout=PATIENCE_S,
        )
        if account is not None:
            login = {"username": account[0], "password": account[1]}
            self._client.post("login", data=login).raise_for_status()
        assert self._client.get("").status_code == 200
        config = self._client.get("config").json()
        self._functions = {each["api_name"]: each["id"] for each in config["dependencies"]}
        self._forms = self._client.get("gradio_api/info").json()["named_endpoints"]
        self._client.post("visitor").raise_for_status()

    def __exit__(self, *_: object) -> None:
        self._client.close()

    def upload(self, name: str, content: bytes) -> dict[str, Any]:
        """The value of a form's file field."""
        answer = self._client.post("gradio_api/upload", files={"files": (name, content)})
        answer.raise_for_status()
        path = answer.json()[0]
        return {"path": path, "orig_name": name, "meta": {"_type": "gradio.FileData"}}

    def run(self, name: str, leaves_after: int | None = None, **form: Any) -> list[str]:
        """Do a run to its end, and fetch what it offers; returns the addresses of that.

        Args:
            form: its fields by name; the others are as the page has them.
            leaves_after: so many news, go without a word.

        Raises:
            Refused: if the run ends with a sentence.
        """
        # The page holds this open; where it breaks off, the visitor has gone.
        with self._client.stream("GET", f"gradio_api/heartbeat/{self._session}"):
            outputs: list[Any] = []
            for news in self.events(name, form):
                outputs.append(news)
                if len(outputs) == leaves_after:
                    return []
        found = sorted(set(_addresses(outputs)))
        for address in found:
            with self._client.stream("GET", address) as answer:
                assert answer.status_code == 200, (address, answer.status_code)
                for _ in answer.iter_bytes():
                    pass
        return found

    def is_there(self, address: str) -> bool:
        """Whether a file is still given."""
        return self._client.get(address).status_code == 200

    def speak(
        self,
        samples: bytes,
        system: str = "gan/5",
        speaker: str = "anna",
        leaves: bool = False,
    ) -> int:
        """Speak live in the time that it takes; returns how many messages with frames came.

        Args:
            samples: 16-bit numbers of 16 kHz.
            leaves: break the connection off, as a closed lid does.
        """
        page = str(self._client.base_url).rstrip("/")
        cookies = "; ".join(f"{name}={value}" for name, value in self._client.cookies.items())
        count = 0
        with connect(
            f"{page.replace('http', 'ws', 1)}/live/speak",
            ssl=self._tls,
            additional_headers={"Origin": self._client.headers["Origin"], "Cookie": cookies},
            source_address=(self._own, 0),
            open_timeout=120,
        ) as socket:
            socket.send(json.dumps({"system": system, "speaker": speaker, "seed": 1}))
            ready = json.loads(socket.recv())
            if "end" in ready:
                raise Refused(ready["end"])
            begun = time.monotonic()
            for at in range(0, len(samples), 6_400):
                socket.send(samples[at : at + 6_400])
                time.sleep(max(0.0, begun + at / 32_000 - time.monotonic()))
            if leaves:
                socket.socket.close()
                return 0
            while True:
                try:
                    message = socket.recv(SILENT_S if count else PATIENCE_S)
                except TimeoutError:
                    return count
                if not isinstance(message, bytes):
                    raise Refused(message)
                count += 1

    def events(self, name: str, form: Mapping[str, Any]) -> Iterator[Any]:
        """What a run tells, one after the other; the last is its result."""
        data = list(filled(self._forms[f"/{name}"], form).values())
        asked = {"data": data, "fn_index": self._functions[name], "session_hash": self._session}
        self._client.post("gradio_api/queue/join", json=asked).raise_for_status()
        query = {"session_hash": self._session}
        with self._client.stream("GET", "gradio_api/queue/data", params=query) as stream:
            for line in stream.iter_lines():
                if not line.startswith("data:"):
                    continue
                news = json.loads(line[5:])
                if news["msg"] == "process_generating":
                    yield news["output"]
                elif news["msg"] == "process_completed":
                    if not news["success"]:
                        raise Refused(str(news["output"].get("error")))
                    yield news["output"]
                    return
        raise AssertionError("the run's events ended without a result")


def filled(call: Mapping[str, Any], form: Mapping[str, Any]) -> dict[str, Any]:
    """All fields of a call by name, in its order: those of the form, else as the page has them.

    Args:
        call: what ``gradio_api/info`` tells of it.
    """
    fields = {each["parameter_name"]: each.get("parameter_default") for each in call["parameters"]}
    unknown = form.keys() - fields.keys()
    assert not unknown, unknown
    return fields | dict(form)


def _addresses(value: Any) -> Iterator[str]:
    """All files for download in what a run has told, and what its player fetches."""
    if isinstance(value, dict):
        if isinstance(value.get("path"), str) and "meta" in value:
            yield f"gradio_api/file={value['path']}"
        for each in value.values():
            yield from _addresses(each)
    elif isinstance(value, list):
        for each in value:
            yield from _addresses(each)
    elif isinstance(value, str):
        for part in value.replace("&quot;", '"').split('"'):
            if part.startswith("media/"):
                yield part
