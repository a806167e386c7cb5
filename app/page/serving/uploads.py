"""Uploads that break off, or find no room, leave nothing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from gradio import route_utils
from starlette.formparsers import MultiPartException

from app import text
from app.errors import is_disk_full


class TidyParser(route_utils.GradioMultiPartParser):
    """Gradio's parser of uploads, which leaves nothing of one that breaks off or finds no room."""

    async def parse(self) -> Any:
        try:
            return await super().parse()
        except BaseException as error:
            for file in self._files_to_close_on_error:
                file.close()
                Path(file.name).unlink(missing_ok=True)
            if is_disk_full(error):
                raise MultiPartException(text.DISK_FULL) from error
            raise


def keep_uploads_tidy() -> None:
    """Let Gradio parse uploads by `TidyParser`."""
    route_utils.GradioMultiPartParser = TidyParser
