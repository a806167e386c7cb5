"""Limit on the disk space of the uploads and runs of one address.

If a trusted proxy does not forward addresses, all visitors have the proxy's: each browser then has
a separate quota.
"""

from __future__ import annotations

import ipaddress
import math
import os
import threading
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from app.errors import RunError

if TYPE_CHECKING:
    import gradio as gr
    from starlette.requests import HTTPConnection

QUOTA_FULL = (
    "Uploads and runs from your IP address would take {used:.1f} GB; the limit is {limit:g} GB. "
    "They are deleted {minutes:.0f} minutes after their last use. Try again later, or use the "
    "command line, which has no such limit."
)


class Quota:
    """Thread-safe record of the disk space that each owner uses."""

    def __init__(
        self, max_bytes: float = math.inf, keep_s: float = 3600.0, proxies: Collection[str] = ()
    ) -> None:
        """Configure the limit; ``keep_s`` is the lifetime of files, for the error message."""
        self.max_bytes = max_bytes
        self._minutes = keep_s / 60
        self._proxies = [ipaddress.ip_network(proxy, strict=False) for proxy in proxies]
        self._bytes: dict[str, dict[tuple[Path, str], int]] = {}
        """Sizes by owner, then by folder and file name (empty for the folder of a run)."""
        self._lock = threading.Lock()

    def owner_of(self, request: gr.Request | HTTPConnection) -> str:
        """Return the address of a request; if that is a trusted proxy's, the browser's cookie."""
        # Imports Gradio, which must not happen before the page has set its environment.
        from app.page.visitors.visitors import client_network_of, cookie_of

        address = client_network_of(request)
        with suppress(ValueError):
            host = ipaddress.ip_address(address)
            if any(host in proxy for proxy in self._proxies):
                return cookie_of(request) or address
        return address

    def require_space(self, owner: str, num_bytes: int = 0) -> None:
        """Check that an owner may use more disk space; raises RunError beyond the limit."""
        with self._lock:
            used = sum(self._bytes.get(owner, {}).values()) + num_bytes
        if used > self.max_bytes:
            raise RunError(
                QUOTA_FULL.format(
                    used=used / 1e9, limit=self.max_bytes / 1e9, minutes=self._minutes
                )
            )

    def set_upload(self, owner: str, folder: Path, name: str, num_bytes: int) -> None:
        """Record the size of one file; the same file again replaces the record."""
        with self._lock:
            self._bytes.setdefault(owner, {})[folder, name] = num_bytes

    def drop_upload(self, owner: str, folder: Path, name: str) -> None:
        """Remove the record of one file."""
        with self._lock:
            self._bytes.get(owner, {}).pop((folder, name), None)

    def measure_runs(self, owner: str, *folders: Path) -> None:
        """Update the sizes of an owner's run folders, and add these folders."""
        with self._lock:
            run_folders = [folder for folder, name in self._bytes.get(owner, {}) if not name]
        sizes = {(folder, ""): _folder_bytes(folder) for folder in {*run_folders, *folders}}
        with self._lock:
            self._bytes.setdefault(owner, {}).update(sizes)

    def forget_deleted(self) -> None:
        """Remove the records of deleted folders."""
        with self._lock:
            folders = {folder for of in self._bytes.values() for folder, _ in of}
        gone = {folder for folder in folders if not folder.exists()}
        with self._lock:
            for owner, of in list(self._bytes.items()):
                left = {key: size for key, size in of.items() if key[0] not in gone}
                self._bytes[owner] = left
                if not left:
                    del self._bytes[owner]


def _folder_bytes(folder: Path) -> int:
    """Return the total size of the files below a folder; files may be deleted meanwhile."""
    total = 0
    for parent, _, names in os.walk(folder):
        for name in names:
            with suppress(OSError):
                total += os.lstat(os.path.join(parent, name)).st_size
    return total
