#!/usr/bin/env python
"""Write app/page/web/messages.d.ts: what the server writes as JSON, for the page's modules.

With --check, nothing is written, and the exit status is 1 if the file is stale.
"""

import ast
import inspect
import json
import sys
import types
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, NotRequired, Union, get_args, get_origin, get_type_hints

from typing_extensions import TypeAliasType, is_typeddict

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from app.page.parts.messages import PlayerValue  # noqa: E402
from app.page.routes.media import viewer_constants  # noqa: E402
from app.run.output.viewer_files import PlanEditorData, Timeline  # noqa: E402
from model.plan.plan import GesturePlan  # noqa: E402

FILE = ROOT / "app" / "page" / "web" / "messages.d.ts"
HEAD = """/** What the server writes as JSON for the page's modules, made by .ci/messages.py from
 * the types of the Python modules. Only the checks read this file. */

export type Vector = [number, number, number];
"""
WORDS = {int: "number", float: "number", str: "string", bool: "boolean", type(None): "null"}
LISTS: tuple[Any, ...] = (list, Sequence)
"""Types whose first argument is that of their items."""


def declarations() -> str:
    """Return the content of the file."""
    done: set[str] = set()
    interfaces = []
    todo: list[Any] = [PlayerValue, Timeline, PlanEditorData, GesturePlan]
    while todo:
        kind = todo.pop(0)
        if kind.__name__ not in done:
            done.add(kind.__name__)
            interfaces.append("\n".join(declared(kind, todo)))
    constants = f"export interface ViewerConstants {of_value(json.loads(viewer_constants()))}"
    return "\n".join([HEAD, *interfaces, constants]) + "\n"


def declared(kind: Any, todo: list[Any]) -> Iterator[str]:
    """Yield the lines of an interface or alias; other named types in it are added to ``todo``."""
    if isinstance(kind, TypeAliasType):
        yield f"export type {kind.__name__} = {of_type(kind.__value__, todo)};\n"
        return
    texts = docs_of(kind)
    if "" in texts:
        yield f"/** {texts['']} */"
    yield f"export interface {kind.__name__} {{"
    optional = () if not is_typeddict(kind) or kind.__total__ else kind.__optional_keys__
    for name, hint in get_type_hints(kind, include_extras=True).items():
        if name.startswith("_"):
            continue
        if name in texts:
            yield f"  /** {texts[name]} */"
        is_optional = get_origin(hint) is NotRequired or name in optional
        yield f"  {name}{'?' * is_optional}: {of_type(hint, todo)};"
    yield "}\n"


def docs_of(kind: type) -> dict[str, str]:
    """Return the docstrings of a class's fields, and of the class under ""."""
    found = {"": " ".join(inspect.cleandoc(kind.__doc__ or "").split())}
    for base in reversed(kind.__mro__[:-1]):
        if base in (dict, object) or not (source := source_of(base)):
            continue
        body = source.body
        for field, text in pairwise(body):
            match field, text:
                case (
                    ast.AnnAssign(target=ast.Name(id=name)),
                    ast.Expr(value=ast.Constant(value=str(words))),
                ):
                    found[name] = " ".join(words.split())
    return {name: words for name, words in found.items() if words}


def source_of(kind: type) -> ast.ClassDef | None:
    """Return the syntax tree of a class; None if it was made by a call."""
    tree = ast.parse(Path(inspect.getfile(sys.modules[kind.__module__])).read_text())
    classes = (node for node in ast.walk(tree) if isinstance(node, ast.ClassDef))
    return next((node for node in classes if node.name == kind.__name__), None)


def of_type(hint: Any, todo: list[Any]) -> str:
    """Return a Python type in TypeScript."""
    origin, inner = get_origin(hint), get_args(hint)
    if hint in WORDS:
        return WORDS[hint]
    if hint in (Any, object):
        return "unknown"
    if origin in (Annotated, NotRequired):
        return of_type(inner[0], todo)
    if origin is Literal:
        return " | ".join(map(json.dumps, inner))
    if origin in (Union, types.UnionType):
        return " | ".join(of_type(each, todo) for each in inner)
    if origin in LISTS or (origin is tuple and inner[-1] is Ellipsis):
        item = of_type(inner[0], todo)
        return f"({item})[]" if " | " in item else f"{item}[]"
    if origin is tuple:
        return f"[{', '.join(of_type(each, todo) for each in inner)}]"
    if origin in (dict, Mapping):
        return f"Record<{of_type(inner[0], todo)}, {of_type(inner[1], todo)}>"
    todo.append(hint)
    return hint.__name__


def of_value(value: Any, indent: str = "") -> str:
    """Return the TypeScript type of a JSON value."""
    match value:
        case bool():
            return "boolean"
        case int() | float():
            return "number"
        case str():
            return "string"
        case [int() | float(), int() | float(), int() | float()]:
            return "Vector"
        case [first, second] if not isinstance(first, str | dict | list):
            return f"[{of_value(first)}, {of_value(second)}]"
        case list():
            return f"{of_value(value[0], indent)}[]"
        case dict() if is_table(value):
            return f"Record<string, {of_value(next(iter(value.values())), indent)}>"
    more = f"{indent}  "
    lines = (f"{more}{name}: {of_value(each, more)};" for name, each in value.items())
    return "\n".join(["{", *lines, f"{indent}}}"])


def is_table(value: Mapping[str, Any]) -> bool:
    """Check whether keys are data: values of one type that are many, or objects or lists."""
    kinds = {of_value(each) for each in value.values()}
    return len(kinds) == 1 and (len(value) > 3 or kinds.isdisjoint(WORDS.values()))


def main() -> int:
    text = declarations()
    if "--check" not in sys.argv:
        FILE.write_text(text)
    elif not FILE.is_file() or FILE.read_text() != text:
        sys.stderr.write(
            f"{FILE.relative_to(ROOT)} is stale; run .venv/bin/python .ci/messages.py\n"
        )
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
