"""Who is asking."""

from __future__ import annotations

import secrets

import gradio as gr


def visitor_of(request: gr.Request) -> str:
    """Gradio's name for one open page; a caller without one is a visitor of its own."""
    return request.session_hash or secrets.token_hex(8)
