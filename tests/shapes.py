"""Shapes and types of annotations, checked in the first calls that a test makes of a function.

Every call costs several times one that is not checked, and making the check 3 ms.
"""

import dataclasses
import functools
import inspect
import os
from collections.abc import Callable
from typing import Any

import jaxtyping

ALL = "CHECK_SHAPES" in os.environ  # `make slow`
CALLS = 10**9 if ALL else 2
_check = jaxtyping.jaxtyped
_test, _calls = 0, CALLS


def begin_test(is_checked: bool) -> None:
    global _test, _calls
    _test += 1
    _calls = CALLS if is_checked or ALL else 0


def _jaxtyped(*, typechecker: Any) -> Callable[[Any], Any]:
    def decorate(thing: Any) -> Any:
        if inspect.isclass(thing):
            if dataclasses.is_dataclass(thing) and "__init__" in vars(thing):
                thing.__init__ = decorate(thing.__init__)
            return thing
        if "<locals>" in thing.__qualname__ and not ALL:  # another each time
            return thing
        checked, test, calls = None, -1, 0

        @functools.wraps(thing)
        def call(*args, **kwargs):
            nonlocal checked, test, calls
            if test != _test:
                test, calls = _test, 0
            if calls >= _calls:
                return thing(*args, **kwargs)
            calls += 1
            checked = checked or _check(thing, typechecker=typechecker)
            return checked(*args, **kwargs)

        return call

    return decorate


jaxtyping.jaxtyped = _jaxtyped  # what the import hook of its plugin writes before each function
