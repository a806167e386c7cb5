"""What the page's handlers share: who is asking, and how a part without content takes no room."""

from __future__ import annotations

import secrets
from typing import Any

import gradio as gr


def visitor_of(request: gr.Request) -> str:
    """Gradio's name for one open page; a caller without one is a visitor of its own."""
    return request.session_hash or secrets.token_hex(8)


def shown(html: str) -> Any:
    """An update of an HTML part that is hidden while it is empty."""
    return gr.update(value=html, visible=bool(html))
