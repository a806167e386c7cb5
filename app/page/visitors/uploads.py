"""Limits on uploads; interrupted ones, and those without disk space, leave no files."""

from __future__ import annotations

import asyncio
import shutil
from collections.abc import AsyncGenerator
from pathlib import Path
from typing import Any, ClassVar

from gradio import route_utils
from starlette.datastructures import FormData
from starlette.formparsers import MultiPartException

from app import text
from app.errors import RunError, is_disk_full
from app.page.visitors.quota import Quota
from app.page.visitors.visitors import CONNECTION

MAX_FILES = 250
"""Maximum number of files in one request."""
MAX_BODY_BYTES = 2 * 10**9
"""Maximum size of one request (bytes)."""
MAX_FIELD_BYTES = 1 << 16
"""Maximum size (bytes) of a field that is not a file, which is held in memory."""
_CHECK_BYTES = 1 << 24
"""Number of uploaded bytes between two checks of the disk."""
_PARTS_AT_ONCE, _PIECE_BYTES = 16, 2048
TOO_MANY_AT_ONCE = "At most {limit} files can be uploaded at once; upload the others afterwards."
TOO_MUCH_AT_ONCE = "At most {limit:.0f} GB can be uploaded at once; upload the others afterwards."
FIELD_TOO_LONG = "A form field of this upload is larger than the limit of {limit} bytes."


class LimitedUploadParser(route_utils.GradioMultiPartParser):
    """Gradio's upload parser with limits, which removes interrupted uploads."""

    root: ClassVar[Path]
    """Folder of uploads."""
    min_free_bytes: ClassVar[int]
    """Disk space (bytes) that always stays free."""
    quota: ClassVar[Quota]
    _num_files = _num_bytes = _checked_bytes = _expected_bytes = 0
    _owner = ""

    def on_headers_finished(self) -> None:
        super().on_headers_finished()
        if self._current_part.file is not None:
            self._num_files += 1
            if self._num_files > MAX_FILES:
                raise MultiPartException(TOO_MANY_AT_ONCE.format(limit=MAX_FILES))

    def on_part_data(self, data: bytes, start: int, end: int) -> None:
        part = self._current_part
        if part.file is None and len(part.data) + end - start > MAX_FIELD_BYTES:
            raise MultiPartException(FIELD_TOO_LONG.format(limit=MAX_FIELD_BYTES))
        super().on_part_data(data, start, end)

    async def parse(self) -> Any:
        stated = self.headers.get("content-length", "0")
        self._owner = self.quota.owner_of(CONNECTION.get())
        stream, self.stream = self.stream, self._within_limits(self.stream)
        try:
            self._see_room(int(stated) if stated.isdecimal() else 0)
            form = await super().parse()
            self._count(form)
            return form
        except BaseException as error:
            for file in self._files_to_close_on_error:
                file.close()
                Path(file.name).unlink(missing_ok=True)
            if is_disk_full(error):
                error = MultiPartException(text.DISK_FULL)
            if isinstance(error, MultiPartException):
                async for _ in stream:  # a browser that still sends would miss the answer
                    pass
            raise error
        finally:
            self.quota.drop_upload(self._owner, self.root, str(id(self)))

    def _count(self, form: FormData) -> None:
        """Add the files to the quota of their owner, at the paths to which Gradio moves them."""
        for _, file in form.multi_items():
            if isinstance(file, route_utils.GradioUploadFile):
                folder = Path(self.upload_dir or self.root) / file.sha.hexdigest()
                self.quota.set_upload(self._owner, folder, file.filename or "", file.size or 0)

    def _see_room(self, num_bytes: int) -> None:
        """Check that more bytes fit the request, disk and quota; raises MultiPartException."""
        if self._num_bytes + num_bytes > MAX_BODY_BYTES:
            raise MultiPartException(TOO_MUCH_AT_ONCE.format(limit=MAX_BODY_BYTES / 1e9))
        if shutil.disk_usage(self.root).free < self.min_free_bytes + num_bytes:
            raise MultiPartException(text.DISK_FULL)
        self._expected_bytes = max(self._expected_bytes, self._num_bytes + num_bytes)
        self.quota.set_upload(self._owner, self.root, str(id(self)), self._expected_bytes)
        try:
            self.quota.require_space(self._owner)
        except RunError as error:
            raise MultiPartException(str(error)) from error
        self._checked_bytes = self._num_bytes

    async def _within_limits(
        self, stream: AsyncGenerator[bytes, None]
    ) -> AsyncGenerator[bytes, None]:
        """Yield the stream with limits, in small pieces if it has many small parts.

        Other tasks get their turn between the pieces.
        """
        async for chunk in stream:
            self._num_bytes += len(chunk)
            is_due = self._num_bytes - self._checked_bytes > _CHECK_BYTES
            if is_due or self._num_bytes > self._expected_bytes:  # of unstated length
                self._see_room(0)
            if chunk.count(b"\r\n--") <= _PARTS_AT_ONCE:
                yield chunk
                continue
            for at in range(0, len(chunk), _PIECE_BYTES):
                yield chunk[at : at + _PIECE_BYTES]
                await asyncio.sleep(0)
