"""Browsers that ask the page's handlers, and what these then show."""

from types import SimpleNamespace
from typing import Any

import gradio as gr

from app.page.visitors.visitors import COOKIE


def browser(cookie: str = "", session: str = "visitor", query: Any = None) -> Any:
    """All that is read of a request; without a cookie it keeps none."""
    return SimpleNamespace(
        session_hash=session,
        cookies={COOKIE: cookie} if cookie else {},
        client=None,
        headers={},
        query_params=query,
    )


VISITOR = browser()


def updates_of(
    runner: Any, parts: Any, *values: Any, visitor: Any = VISITOR
) -> list[dict[Any, Any]]:
    """What a click shows, by the name of each part; an error that ends it is the last."""
    names = {part: name for name, part in vars(parts).items()}
    found: list[dict[Any, Any]] = []
    try:
        for update in runner.run(visitor, *values):
            found.append({names.get(part, part): value for part, value in update.items()})
    except gr.Error as error:
        found.append({"error": str(error.message)})
    return found
