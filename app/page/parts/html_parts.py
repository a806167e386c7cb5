"""Parts of Gradio that hold our own HTML: how a script gets hold of one, how an empty one hides."""

from __future__ import annotations

from typing import Any

import gradio as gr


def mount(module: str, function: str) -> str:
    """JavaScript for `gr.HTML` that hands its element to a module of app/page/web."""
    return (
        f'import(new URL("web/{module}", document.baseURI))'
        f".then(({{ {function} }}) => {function}(element, props, watch));"
    )


def shown(html: str) -> Any:
    """An update of an HTML part that is hidden while it is empty."""
    return gr.update(value=html, visible=bool(html))
