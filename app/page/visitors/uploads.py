"""Uploads that break off, or find no room, leave nothing; and each of their files is counted as it
begins."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, Callable
from contextvars import ContextVar
from pathlib import Path
from typing import Any

from gradio import route_utils
from starlette.formparsers import MultiPartException

from app import text
from app.errors import is_disk_full

MAX_FILES = 250
"""In one request."""
MAX_FIELD_BYTES = 1 << 16
"""Of a field that is no file, which is held in memory."""
_PARTS_AT_ONCE, _PIECE_BYTES = 16, 2048
TOO_MANY_AT_ONCE = "At most {limit} files can be uploaded at once; send the others after them."
FIELD_TOO_LONG = "A field that is no file may have {limit} bytes, and one of this upload has more."

NO_ROOM: ContextVar[Callable[[], str]] = ContextVar("NO_ROOM", default=str)
"""Called for each file of the upload that is being read; returns why it finds no room, or nothing.
Set by who lets the upload in."""


class TidyParser(route_utils.GradioMultiPartParser):
    """Gradio's parser of uploads, which leaves nothing of one that breaks off or finds no room."""

    def on_headers_finished(self) -> None:
        super().on_headers_finished()
        if self._current_part.file is not None:
            refusal = NO_ROOM.get()()
            if refusal:
                raise MultiPartException(refusal)

    def on_part_data(self, data: bytes, start: int, end: int) -> None:
        part = self._current_part
        if part.file is None and len(part.data) + end - start > MAX_FIELD_BYTES:
            raise MultiPartException(FIELD_TOO_LONG.format(limit=MAX_FIELD_BYTES))
        super().on_part_data(data, start, end)

    async def parse(self) -> Any:
        self.stream = _in_pieces(self.stream)
        try:
            return await super().parse()
        except BaseException as error:
            for file in self._files_to_close_on_error:
                file.close()
                Path(file.name).unlink(missing_ok=True)
            if is_disk_full(error):
                raise MultiPartException(text.DISK_FULL) from error
            raise


async def _in_pieces(stream: AsyncGenerator[bytes, None]) -> AsyncGenerator[bytes, None]:
    """What comes, and of many small parts a few at a time: others have their turn in between."""
    async for chunk in stream:
        if chunk.count(b"\r\n--") <= _PARTS_AT_ONCE:
            yield chunk
            continue
        for at in range(0, len(chunk), _PIECE_BYTES):
            yield chunk[at : at + _PIECE_BYTES]
            await asyncio.sleep(0)


def keep_uploads_tidy() -> None:
    """Let Gradio parse uploads by `TidyParser`."""
    route_utils.GradioMultiPartParser = TidyParser
