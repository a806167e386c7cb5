"""Settings of the page, read from flags and the environment and validated once."""

from __future__ import annotations

import ipaddress
import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

from tyro.conf import Suppress, UseAppendAction, arg

from app.errors import RunError
from app.flags import File, MinutesFlag, parsed_type

PROJECT = Path(__file__).resolve().parents[1]
BUNDLED_WEIGHTS = PROJECT / "model" / "weights"
EXAMPLES = PROJECT / "examples"
LOCAL_PROXIES = ("127.0.0.1", "::1")
"""Addresses with trusted X-Forwarded-For and X-Forwarded-Proto headers."""
REQUESTED_BACKEND = os.environ.get("MPLBACKEND", "")
"""matplotlib backend named by MPLBACKEND when the program started."""
_MODULE = "module://"
_ROOT_PATH = re.compile(r"(https?://[\w.:-]+)?(/[\w.~-]+)*/?")
_ORIGIN = re.compile(r"https?://(\*\.)?[a-z0-9.-]+(:[0-9]{1,5})?", re.IGNORECASE)
Several = UseAppendAction[tuple[str, ...]]


def use_matplotlib_file_backend() -> None:
    """Make matplotlib draw into files only; call this before it or Gradio is imported.

    Colab and Jupyter name a backend in MPLBACKEND that only their own Python has, shells one with
    windows: either ends every figure, and every click of Gradio, in an ImportError.
    """
    os.environ["MPLBACKEND"] = "agg"


def drop_missing_matplotlib_backend() -> None:
    """Remove a module from MPLBACKEND that Python lacks; see `use_matplotlib_file_backend`."""
    name = os.environ.get("MPLBACKEND", "")
    if name.startswith(_MODULE) and not _can_import(name.removeprefix(_MODULE)):
        del os.environ["MPLBACKEND"]


def matplotlib_backend_error() -> str:
    """Return why the matplotlib backend of MPLBACKEND cannot be used; empty if it can."""
    from matplotlib.backends.registry import backend_registry

    try:
        backend_registry.resolve_backend(REQUESTED_BACKEND)
        import_module(backend_registry._backend_module_name(REQUESTED_BACKEND))  # pyright: ignore[reportAttributeAccessIssue]
    except Exception as error:
        return f"{REQUESTED_BACKEND} cannot be imported: {error}"
    return ""


def _can_import(module: str) -> bool:
    try:
        return find_spec(module) is not None
    except (ImportError, ValueError):
        return False


_NO_PROXIES = {"NO_PROXY": "*", "no_proxy": "*"}


def disable_http_proxies() -> None:
    """Disable http_proxy and ALL_PROXY in this process; call this before Gradio is imported.

    A page behind a firewall could not reach itself, and a SOCKS proxy needs a package.
    """
    os.environ |= _NO_PROXIES


@contextmanager
def http_proxies_disabled() -> Iterator[None]:
    """Disable http_proxy and ALL_PROXY within the block, as `disable_http_proxies` does."""
    before = {name: os.environ.get(name) for name in _NO_PROXIES}
    os.environ |= _NO_PROXIES
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def read_accounts(path: str) -> tuple[tuple[str, str], ...]:
    """Read (name, password) pairs from a file; raises RunError if it has none or cannot be read."""
    try:
        lines = [line.strip() for line in Path(path).read_text("utf-8").splitlines()]
    except (OSError, UnicodeDecodeError) as error:
        raise RunError(f"The accounts file {path} cannot be read: {error}.") from error
    pairs = [tuple(line.partition(":")[::2]) for line in lines if line and line[0] != "#"]
    if not pairs or not all(name and password for name, password in pairs):
        raise RunError(
            f"Every line of {path} must have the form NAME:PASSWORD (# starts a comment), and at "
            "least one account is needed."
        )
    return tuple((name, password) for name, password in pairs)


def default_host() -> str:
    """Return GRADIO_SERVER_NAME, which hosted Gradio spaces set; otherwise 127.0.0.1."""
    return os.environ.get("GRADIO_SERVER_NAME") or "127.0.0.1"


def default_port() -> int:
    """Return GRADIO_SERVER_PORT, or 7860 without one."""
    value = os.environ.get("GRADIO_SERVER_PORT") or "7860"
    if not value.isdigit():
        raise RunError(f"GRADIO_SERVER_PORT must be a whole number; got {value!r}.")
    return int(value)


def default_root_path() -> str:
    """Return GRADIO_ROOT_PATH, or an empty path without one."""
    return os.environ.get("GRADIO_ROOT_PATH") or ""


def body_from_environment() -> Path | None:
    """Return the path of the licensed SMPL-X file in SMPLX_MODEL, or None."""
    value = os.environ.get("SMPLX_MODEL")
    return Path(value) if value else None


@dataclass(frozen=True)
class AppConfig:
    """Settings of the page: address, models and limits."""

    host: str = field(default_factory=default_host)
    """Address to listen on."""
    port: int = field(default_factory=default_port)
    """Port to listen on; 0 takes the first free one from 7860 on."""
    body: File = field(default_factory=body_from_environment)
    """A character (.vrm, .glb) or licensed SMPLX_NEUTRAL*.npz; by default $SMPLX_MODEL, else the
    bundled body."""
    weights: Annotated[Path, arg(metavar="DIR")] = BUNDLED_WEIGHTS
    """Folder of trained systems."""
    host_names: Annotated[Several, arg(name="host-name", metavar="NAME")] = ()
    """Further host name of the page, besides this machine's names and --host; may be repeated."""
    trusted_proxies: Annotated[Several, arg(name="proxy", metavar="ADDRESS")] = ()
    """Address of a proxy with trusted X-Forwarded headers; may be repeated. By default a proxy on
    this machine is trusted, except for X-Forwarded-Host."""
    root_path: Annotated[str, arg(metavar="PATH")] = field(default_factory=default_root_path)
    """Path under which a proxy serves the page, such as /lab; the proxy may keep or strip it;
    by default $GRADIO_ROOT_PATH."""
    frame_ancestors: Annotated[Several, arg(name="embed-in", metavar="ORIGIN")] = ()
    """Site that may show the page in a frame, such as https://lab.example; may be repeated. By
    default only the page's own site may, and in a Hugging Face Space also Hugging Face's sites."""
    accounts: Annotated[
        tuple[tuple[str, str], ...], parsed_type(read_accounts, "FILE", "none"), arg(name="auth")
    ] = ()
    """File with lines of NAME:PASSWORD; visitors must log in with one of them."""
    run_to_open: Annotated[File, arg(name="open", metavar="FOLDER")] = None
    """Run folder of `generate` or `diagnose`, or its zip, to show when the page opens."""
    max_speech_s: MinutesFlag = 600.0
    """Maximum length of a speech."""
    min_speech_s: Suppress[float] = 0.5
    max_upload_size: Suppress[str] = "250mb"
    """Upload limit of Gradio. Ten minutes of 48 kHz stereo are 115 MB."""
    max_queue_size: Suppress[int] = 32
    """Maximum length of the queue, including background videos and excluding checks of uploads."""
    result_lifetime_s: Suppress[float] = 3600.0
    """Age (s) at which results and uploads are deleted."""
    max_stored_bytes_per_address: Suppress[int] = 4 * 10**9
    """Maximum disk space (bytes) for the uploads and runs of one IP address."""
    max_run_s: Suppress[float] = 2 * 3600.0
    max_run_memory_bytes: Suppress[int] = 4 * 10**9
    """Memory (bytes) that a run may use in addition to the models."""
    min_free_bytes: Suppress[int] = 10**9
    """Disk space (bytes) that always stays free."""
    temp_folder: Suppress[Path] = field(
        default_factory=lambda: Path(tempfile.gettempdir()) / f"cospeech-{_user()}"
    )

    def __post_init__(self) -> None:
        if not 0 <= self.port <= 65535:
            raise RunError(f"The port must be from 0 to 65535; got {self.port}.")
        for proxy in self.trusted_proxies:
            if not _is_network(proxy):
                raise RunError(
                    "--proxy takes an address such as 10.0.0.2 or a network such as 10.0.0.0/8; "
                    f"got {proxy}."
                )
        if not _ROOT_PATH.fullmatch(self.root_path):
            raise RunError(
                "--root-path takes a path such as /lab or https://lab.example/lab; got "
                f"{self.root_path!r}."
            )
        for origin in self.frame_ancestors:
            if not _ORIGIN.fullmatch(origin):
                raise RunError(
                    f"--embed-in takes a site such as https://lab.example; got {origin}."
                )
        if self.body is not None and not self.body.is_file():
            raise RunError(f"There is no body file at {self.body}.")

    @property
    def jobs_folder(self) -> Path:
        return self.temp_folder / "jobs"

    @property
    def private_folder(self) -> Path:
        """Folder of files that wait for a single visitor and are never served by path."""
        return self.temp_folder / "private"

    @property
    def cache_folder(self) -> Path:
        return self.temp_folder / "gradio"


def _is_network(value: str) -> bool:
    try:
        ipaddress.ip_network(value)
    except ValueError:
        return False
    return True


def _user() -> str:
    return str(os.getuid()) if hasattr(os, "getuid") else os.environ.get("USERNAME", "user")
