"""Parts of Gradio: our own HTML in them, named fields for programs, how listeners are heard."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from inspect import Parameter, Signature
from typing import Any

import gradio as gr

from app.page.parts.asked import Fields


def mount(module: str, function: str) -> str:
    """JavaScript for `gr.HTML` that hands its element to a module of app/page/web."""
    return (
        f'import(new URL("web/{module}", document.baseURI))'
        f".then(({{ {function} }}) => {function}(element, props, watch));"
    )


def arrange_chips(
    field: str, about: Mapping[str, str], groups: Mapping[str, Sequence[str]]
) -> None:
    """Have the choices of a field stand in groups, each of which its title ticks as a whole, and
    say what they are when a pointer rests on them.

    Args:
        field: its id on the page.
        about: a sentence for each label.
        groups: labels that follow each other, by title.
    """
    gr.HTML(
        {"field": field, "about": dict(about), "groups": dict(groups)},
        html_template="",
        js_on_load=mount("chips.js", "mountChips"),
        apply_default_css=False,
        elem_classes="told-elsewhere",
    )


def reveal_on_click(button: gr.Button, element: gr.HTML) -> None:
    """Scroll to the part of the page that shows what a click begins.

    Called before the click is given its run: a browser does one after the other.
    """
    button.click(
        None,
        js=f'() => {{ import(new URL("web/reveal.js", document.baseURI))'
        f'.then(({{ reveal }}) => reveal("{element.elem_id}")); }}',
        api_visibility="private",
    )


def told_part(elem_id: str | None = None, module: str = "", function: str = "") -> gr.HTML:
    """HTML that is hidden until there is any, handed to a module where one is named."""
    how = {"js_on_load": mount(module, function), "apply_default_css": False} if module else {}
    return gr.HTML("", visible=False, elem_id=elem_id, **how)


def shown(html: str) -> Any:
    """An update of an HTML part that is hidden while it is empty."""
    return gr.update(value=html, visible=bool(html))


def player_part(prefix: str) -> gr.HTML:
    """A player in lock-step, whose value is a `Showing` as a dictionary; without rows it takes no
    room."""
    return gr.HTML(
        {},
        html_template='<div class="lockstep" hidden></div>',
        js_on_load=mount("player/player.js", "mountPlayer"),
        apply_default_css=False,
        elem_id=prefix + "player",
    )


def named_fields(run: Callable[..., Iterator[Any]], form: Fields) -> Callable[..., Iterator[Any]]:
    """``run`` with one parameter for each field, of which all but the first may be left out:
    Gradio names the parameters of the page's API by them.

    Args:
        run: takes the request of the browser and the values of the fields.
    """

    def named(request: gr.Request, *values: Any) -> Iterator[Any]:
        yield from run(request, *values)

    kind = Parameter.POSITIONAL_OR_KEYWORD
    defaults = [Parameter.empty, *(field.part.value for field in list(form.values())[1:])]
    parameters = [Parameter("request", kind, annotation=gr.Request)]
    parameters += [
        Parameter(name, kind, default=default) for name, default in zip(form, defaults, strict=True)
    ]
    named.__dict__["__signature__"] = Signature(parameters)
    return named


PRIVATE: dict[str, Any] = {"api_visibility": "private", "show_progress": "hidden"}
"""By the page alone: no program calls it, and nothing spins while it works."""
AT_ONCE: dict[str, Any] = {"queue": False, **PRIVATE}
"""Before all that waits."""


def in_turn(status: gr.HTML) -> dict[str, Any]:
    """Of a run: one after the other, whoever asks; its place in the queue is told on the status,
    and another click of the same button is none."""
    return {
        "show_progress": "minimal",
        "show_progress_on": status,
        "trigger_mode": "once",
        "concurrency_id": "run",
        "concurrency_limit": "default",
    }
