"""What Gradio and its server answer with a fault, or log as one, where a sentence is due."""

from __future__ import annotations

import logging
from typing import Any

from fastapi import HTTPException
from gradio import route_utils

UNKNOWN_FUNCTION = "This page has no such function; load it again, or ask /gradio_api/info for all."
_NO_TEXT = "Invalid UTF-8 sequence received from client."
_find = route_utils.get_fn


def refuse_unknown_functions() -> None:
    """Let Gradio answer to a number or name of no function with status 404."""

    def get_fn(*arguments: Any, **named: Any) -> Any:
        try:
            return _find(*arguments, **named)
        except (KeyError, route_utils.FnIndexInferError):
            raise HTTPException(404, UNKNOWN_FUNCTION) from None

    route_utils.get_fn = get_fn


def quieten_sockets() -> None:
    """Let the server close a socket that sends no text where text is due without a traceback."""
    logger = logging.getLogger("uvicorn.error")
    if _is_no_fault not in logger.filters:
        logger.addFilter(_is_no_fault)


def _is_no_fault(record: logging.LogRecord) -> bool:
    return record.msg != _NO_TEXT
