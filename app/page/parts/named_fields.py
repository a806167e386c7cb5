"""The fields of a form under their names, for programs that call the page."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import MISSING, fields
from inspect import Parameter, Signature
from typing import Any, TypeVar, cast

import gradio as gr

Run = TypeVar("Run", bound=Callable[..., Any])


def named_fields(run: Run, form: type, optional: tuple[str, ...] = ()) -> Run:
    """``run`` with one parameter for each field of ``form``, a dataclass, in its order.

    Gradio names the parameters of the page's API by them, and asks only for those without a
    default and without a value on the page.

    Args:
        run: takes the request of the browser and the values of the fields; a generator or not.
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
    for field in fields(form):
        default = Parameter.empty
        if field.name in optional:
            default = None
        elif parameters[-1].default is not Parameter.empty:
            default = None if field.default is MISSING else field.default
        parameters.append(Parameter(field.name, kind, default=default))
    named.__dict__["__signature__"] = Signature(parameters)
    return cast(Run, named)
