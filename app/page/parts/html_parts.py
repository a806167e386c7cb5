"""Parts of Gradio: our own HTML in them, named fields for programs, how listeners are heard."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, fields
from inspect import Parameter, Signature
from typing import Any, TypeVar, cast

import gradio as gr

from app import text
from app.page.parts import markup
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


def results_parts(
    prefix: str,
) -> tuple[gr.HTML, gr.HTML, gr.Column, gr.Button, gr.File]:
    """Figures, numbers and downloads of a run, hidden until there are any.

    Args:
        prefix: of their ids on the page, with its hyphen.
    """
    figures, numbers = (
        gr.HTML(
            "",
            visible=False,
            js_on_load=mount(module, function),
            apply_default_css=False,
            elem_id=prefix + name,
        )
        for name, module, function in (
            ("figures", "figures.js", "mountFigures"),
            ("numbers", "measures.js", "mountMeasures"),
        )
    )
    with gr.Column(visible=False) as downloads:
        gr.HTML(markup.heading(text.DOWNLOADS_HEADING))
        bundle = gr.Button(text.ZIP_LABEL, variant="primary", elem_id=prefix + "bundle")
        with gr.Accordion(text.FILES_LABEL, open=False, elem_id=prefix + "files-fold"):
            files = gr.File(
                show_label=False,
                file_count="multiple",
                interactive=False,
                elem_id=prefix + "files",
            )
    return figures, numbers, downloads, bundle, files


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


Run = TypeVar("Run", bound=Callable[..., Any])


def named_fields(run: Run, form: type | Fields, optional: tuple[str, ...] = ()) -> Run:
    """``run`` with one parameter for each field of ``form``, in its order.

    Gradio names the parameters of the page's API by them, and asks only for those without a
    default and without a value on the page.

    Args:
        run: takes the request of the browser and the values of the fields; a generator or not.
        form: a dataclass, or fields, of which all but the first may be left out.
        optional: fields that may be left out though the dataclass has no default for them.
    """

    if inspect.isgeneratorfunction(run):

        def named(request: gr.Request, *values: Any) -> Any:
            yield from run(request, *values)
    else:

        def named(request: gr.Request, *values: Any) -> Any:
            return run(request, *values)

    kind = Parameter.POSITIONAL_OR_KEYWORD
    parameters = [Parameter("request", kind, annotation=gr.Request)]
    if not isinstance(form, type):
        defaults = [Parameter.empty, *(field.part.value for field in list(form.values())[1:])]
        parameters += [
            Parameter(name, kind, default=default)
            for name, default in zip(form, defaults, strict=True)
        ]
    for field in fields(form) if isinstance(form, type) else ():
        default = Parameter.empty
        if field.name in optional:
            default = None
        elif parameters[-1].default is not Parameter.empty:
            default = None if field.default is MISSING else field.default
        parameters.append(Parameter(field.name, kind, default=default))
    named.__dict__["__signature__"] = Signature(parameters)
    return cast(Run, named)


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
