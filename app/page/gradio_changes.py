"""Changes of Gradio's internals, each with its reason.

They were written for Gradio 6.31. One that does not fit the installed version is left out, with a
warning that says what the page lacks.
"""

from __future__ import annotations

import inspect
import logging
import traceback
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from fastapi import HTTPException, Request
from fastapi.responses import JSONResponse
from pydantic import ValidationError

from app.errors import visitor_message, without_folders
from conventions.names import printable
from model.storage.json_validation import first_error_clause

if TYPE_CHECKING:
    import gradio as gr

    from app.page.visitors.job_folders import Jobs
    from app.page.visitors.quota import Quota

log = logging.getLogger(__name__)
WRITTEN_FOR = (6, 31)
"""Major and minor version."""
OTHER_VERSION = (
    "Gradio {installed} is installed; this page was written for Gradio {major}.{minor}. If "
    "something does not work, install the version in locks/run.txt."
)
DOES_NOT_FIT = "This page could not adapt Gradio {installed} ({reason}). As a result, {without}."
POLL_S = 0.02
"""Interval (s) between two checks of the queue."""
UNKNOWN_FUNCTION = (
    "There is no such function. Reload the page; for programs, /gradio_api/info lists all "
    "functions."
)
WRONG_CALL = "Invalid call: {why}"
_NAMED_CALL = "/call/v2/"
_MAX_WHY, _MAX_READ = 300, 3000
"""Maximum length of a reason (characters), when shown and when read."""
_OWN_FUNCTIONS = str(Path(__file__).parent)


def import_gradio() -> None:
    """Import Gradio, with a warning if it is another version than this page was written for."""
    with _without_stubs():
        import gradio  # noqa: F401
    installed = version("gradio")
    major, minor = WRITTEN_FOR
    if installed.split(".")[:2] != [str(major), str(minor)]:
        log.warning("%s", OTHER_VERSION.format(installed=installed, major=major, minor=minor))


@contextmanager
def _without_stubs() -> Iterator[None]:
    """Prevent Gradio from writing type stubs of its components, within the block.

    It writes all of them at every start, which takes half of the time of its import.
    """
    file_of = inspect.getfile

    def none_of_parts(thing: Any) -> str:
        if type(thing).__name__ == "ComponentMeta":
            raise OSError
        return file_of(thing)

    inspect.getfile = none_of_parts
    try:
        yield
    finally:
        inspect.getfile = file_of


def patch_gradio(root: Path, min_free_bytes: int, quota: Quota, proxies: Collection[str]) -> None:
    """Make the changes that all pages of this process share, before one is launched."""

    def parse() -> None:
        _parse_uploads(root, min_free_bytes, quota)

    def limit() -> None:
        _limit_connections(proxies)

    _attempt(limit, "an IP address can open any number of connections, and stalled ones stay open")
    _attempt(
        parse, "the only limit on uploads is 250 MB per file, and interrupted ones are not deleted"
    )
    _attempt(
        _make_no_empty_files, "each file in an API call leaves an empty temporary file for an hour"
    )
    _attempt(_find_functions, "API calls to unknown functions end in a server error")
    _attempt(_explain_wrong_calls, "invalid API calls are answered with Python errors")


def replace_gradio_queue(page: gr.Blocks, jobs: Jobs, max_waiting: int) -> None:
    """Give a page a queue of its own kind, before it is launched."""

    def replace_queue() -> None:
        _replace_queue(page, jobs, max_waiting)

    _attempt(
        replace_queue, "the queue has no limits, and runs end when a page loses its connection"
    )
    _attempt(lambda: _poll_less(page), "the idle page uses a tenth of a processor core")


def _attempt(change: Callable[[], None], without: str) -> None:
    """Make a change, or log what the page is without it."""
    try:
        change()
    except (ImportError, AttributeError, TypeError) as error:
        record = {"installed": version("gradio"), "reason": error, "without": without}
        log.warning("%s", DOES_NOT_FIT.format(**record))


@cache
def _original(module: str, name: str) -> Any:
    """Return Gradio's own attribute of a module, also after it was replaced."""
    return getattr(import_module(module), name)


def _replace(module: str, name: str, new: Any) -> None:
    """Replace an attribute of a module that must be there."""
    changed = import_module(module)
    getattr(changed, name)
    setattr(changed, name, new)


def _parse_uploads(root: Path, min_free_bytes: int, quota: Quota) -> None:
    """Limit number and size of uploads, and delete interrupted ones, which Gradio keeps."""
    from app.page.visitors.uploads import LimitedUploadParser

    LimitedUploadParser.root = root
    LimitedUploadParser.min_free_bytes = min_free_bytes
    LimitedUploadParser.quota = quota
    _replace("gradio.route_utils", "GradioMultiPartParser", LimitedUploadParser)


def _limit_connections(proxies: Collection[str]) -> None:
    """Limit the connections of an address, and end those whose client has stalled."""
    from app.page.routes.connections import limit_connections

    module, name = "uvicorn.protocols.http.auto", "AutoHTTPProtocol"
    _replace(module, name, limit_connections(_original(module, name), proxies))


def _make_no_empty_files() -> None:
    """Prevent the empty file that Gradio makes for each file of a call and never uses."""
    unused = SimpleNamespace(NamedTemporaryFile=lambda **_: SimpleNamespace())
    _replace("gradio.components.file", "tempfile", unused)


def _find_functions() -> None:
    """Answer to unknown functions with status 404, where Gradio fails with a KeyError."""
    find = _original("gradio.route_utils", "get_fn")
    unknown = (KeyError, _original("gradio.route_utils", "FnIndexInferError"))

    def get_fn(*arguments: Any, **named: Any) -> Any:
        try:
            return find(*arguments, **named)
        except unknown:
            raise HTTPException(404, UNKNOWN_FUNCTION) from None

    _replace("gradio.route_utils", "get_fn", get_fn)


async def answer_wrong_call(request: Request, error: Exception) -> JSONResponse:
    """Answer to a call by names of a function and its arguments that Gradio cannot find."""
    if _NAMED_CALL not in request.url.path:
        raise error
    if isinstance(error, KeyError):
        return JSONResponse({"detail": UNKNOWN_FUNCTION}, status_code=404)
    message = WRONG_CALL.format(why=printable(str(error)[:_MAX_WHY]))
    return JSONResponse({"detail": message}, status_code=400)


def _explain_wrong_calls() -> None:
    """Answer to invalid calls with a sentence, where Gradio sends the text of any exception."""
    import gradio as gr

    call = _original("gradio.route_utils", "call_process_api")

    async def call_process_api(*arguments: Any, **named: Any) -> Any:
        try:
            return await call(*arguments, **named)
        except HTTPException:
            raise
        except gr.Error as error:
            if not error.print_exception:  # already converted to a sentence
                raise
            raise _wrong_call(str(error.message)) from None
        except Exception as error:
            _, *frames = traceback.extract_tb(error.__traceback__)
            if any(frame.filename.startswith(_OWN_FUNCTIONS) for frame in frames):
                raise gr.Error(visitor_message(error), print_exception=False) from None
            message = (
                first_error_clause(error)
                if isinstance(error, ValidationError)
                else str(error)[:_MAX_READ]
            )
            raise _wrong_call(f"{type(error).__name__}: {message}") from None

    _replace("gradio.route_utils", "call_process_api", call_process_api)


def _wrong_call(reason: str) -> gr.Error:
    import gradio as gr

    shortened = printable(without_folders(reason[:_MAX_READ]))[:_MAX_WHY]
    log.warning("an invalid API call: %s", shortened)
    return gr.Error(WRONG_CALL.format(why=shortened), print_exception=False)


def _replace_queue(page: gr.Blocks, jobs: Jobs, max_waiting: int) -> None:
    """Limit who waits, and start only events with a listener."""
    from app.page.visitors.turns import LimitedQueue

    # `Blocks.queue` would build the whole app again.
    page._queue = LimitedQueue(
        jobs,
        max_waiting,
        live_updates=True,
        concurrency_count=page.max_threads,
        update_intervals=1,
        blocks=page,
        default_concurrency_limit=1,
    )


def _poll_less(page: gr.Blocks) -> None:
    """Check the queue less often than Gradio's thousand times a second, a tenth of an idle core."""
    page._queue.sleep_when_free, page._queue.progress_update_sleep_when_free = POLL_S, 1.0
