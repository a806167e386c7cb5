"""Settings of the page: from flags and environment, checked once."""

from __future__ import annotations

import ipaddress
import os
import re
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

from app.errors import RunError

PROJECT = Path(__file__).resolve().parents[1]
BUNDLED_WEIGHTS = PROJECT / "model" / "weights"
EXAMPLES = PROJECT / "examples"
LOCAL_PROXIES = ("127.0.0.1", "::1")
"""Their X-Forwarded-For and -Proto are believed without a word."""
_ORIGIN = re.compile(r"https?://(\*\.)?[a-z0-9.-]+(:[0-9]{1,5})?", re.IGNORECASE)


@dataclass(frozen=True)
class AppConfig:
    """Where the page listens, what it works with and what it allows."""

    host: str = "127.0.0.1"
    port: int = 7860
    """0 takes the first free one from 7860 on."""
    weights: Path = BUNDLED_WEIGHTS
    body: Path | None = None
    min_speech_s: float = 0.5
    max_speech_s: float = 600.0
    max_upload: str = "250mb"
    """Ten minutes of 48 kHz stereo are 115 MB; Gradio refuses more than this while uploading."""
    num_slots: int = 1
    """Runs at work at the same time; each draws two videos at once."""
    max_waiting: int = 32
    """For their turn, videos behind a stage among them."""
    keep_results_s: float = 3600.0
    """Results and uploads are deleted this long after they were made."""
    max_run_s: float = 2 * 3600.0
    max_run_bytes: int = 4 * 10**9
    """Of memory that a run may take beyond the models."""
    min_free_bytes: int = 10**9
    """Of the disk, which is never filled further."""
    host_names: tuple[str, ...] = ()
    """Names under which the page answers, besides this machine's own and `host`."""
    proxies: tuple[str, ...] = ()
    """Addresses of proxies that were named; with any, X-Forwarded-Host is believed."""
    embedders: tuple[str, ...] = ()
    """Origins of sites that may show the page in a frame."""
    accounts: tuple[tuple[str, str], ...] = ()
    """Names and passwords; without any, nobody need log in."""
    temp: Path = field(default_factory=lambda: Path(tempfile.gettempdir()) / f"cospeech-{_user()}")
    opened: Path | None = None
    """A folder of results, or its zip, that the page shows first."""

    def __post_init__(self) -> None:
        if not 0 <= self.port <= 65535:
            raise RunError(f"The port must be from 0 to 65535; got {self.port}.")
        for proxy in self.proxies:
            if not _is_network(proxy):
                raise RunError(
                    f"--proxy takes an address as 10.0.0.2 or a network as 10.0.0.0/8; got {proxy}."
                )
        for origin in self.embedders:
            if not _ORIGIN.fullmatch(origin):
                raise RunError(f"--embed-in takes a site as https://lab.example; got {origin}.")
        if self.body is not None and not self.body.is_file():
            raise RunError(f"There is no body file at {self.body}.")

    @property
    def jobs_folder(self) -> Path:
        return self.temp / "jobs"

    @property
    def private_folder(self) -> Path:
        """What waits for one visitor alone and is never served as a file."""
        return self.temp / "private"

    @property
    def cache_folder(self) -> Path:
        return self.temp / "gradio"


def default_host() -> str:
    """Hosted Gradio spaces set GRADIO_SERVER_NAME; elsewhere only this machine is served."""
    return os.environ.get("GRADIO_SERVER_NAME") or "127.0.0.1"


def default_port() -> int:
    """GRADIO_SERVER_PORT, else 7860."""
    value = os.environ.get("GRADIO_SERVER_PORT") or "7860"
    if not value.isdigit():
        raise RunError(f"GRADIO_SERVER_PORT must be a whole number; got {value!r}.")
    return int(value)


def default_body() -> Path | None:
    """The licensed SMPL-X file named by SMPLX_MODEL, if any."""
    value = os.environ.get("SMPLX_MODEL")
    return Path(value) if value else None


def _is_network(value: str) -> bool:
    try:
        ipaddress.ip_network(value)
    except ValueError:
        return False
    return True


def _user() -> str:
    return str(os.getuid()) if hasattr(os, "getuid") else os.environ.get("USERNAME", "user")
