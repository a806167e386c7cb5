"""Names of the code: only the words of the field, and docstrings that name what exists."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[1]
ROOMS = ("app", "conventions", "model", "processes", "renderer", "tools")
GIVEN_UP = frozenset(
    "told found heard said asked kept given seen known settled ear deaf whose".split()
)
GIVEN_UP_IN_PUBLIC = GIVEN_UP | set("made shown who what beside apart alike judge judges".split())
ALLOWED = frozenset({"connection_made", "apart_deg"})
"""A name of asyncio, and a former name in the notebook's API."""
ALLOWED_AT = frozenset(
    {
        ("app/notebook.py", "said"),  # a former name
        ("app/run/output/viewer_files.py", "heard_accents"),  # a key of timeline.json
        ("model/networks/speech_codes.py", "told"),  # parts of networks: names in files of weights
        ("model/systems/planned/network.py", "heard"),
        ("model/systems/planned/network.py", "seen"),
    }
)


def names_in(tree: ast.AST) -> Iterator[str]:
    """Functions, classes, parameters, fields and variables."""
    for node in ast.walk(tree):
        match node:
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
                yield name
            case ast.ClassDef(name=name) | ast.arg(arg=name):
                yield name
            case ast.Name(id=name, ctx=ast.Store()) | ast.Attribute(attr=name, ctx=ast.Store()):
                yield name


def public_names(tree: ast.AST) -> Iterator[str]:
    """Functions, classes, parameters and fields that others use."""
    for node in ast.walk(tree):
        match node:
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
                yield name
                yield from (each.arg for each in (*node.args.args, *node.args.kwonlyargs))
            case ast.ClassDef(name=name):
                yield name
            case ast.AnnAssign(target=ast.Name(id=name)):
                yield name


def words_of(name: str) -> set[str]:
    """``find_ThePlan``: find, the, plan."""
    return {word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+", name)}


def test_no_name_has_a_word_that_was_given_up():
    left = []
    for path in (path for room in ROOMS for path in (PROJECT / room).rglob("*.py")):
        where, tree = path.relative_to(PROJECT).as_posix(), ast.parse(path.read_text("utf-8"))
        public = {name for name in public_names(tree) if not name.startswith("_")}
        wrong = {name for name in public if words_of(name) & GIVEN_UP_IN_PUBLIC}
        wrong |= {name for name in names_in(tree) if words_of(name) & GIVEN_UP}
        left += [f"{where}: {name}" for name in wrong - ALLOWED if (where, name) not in ALLOWED_AT]
    assert not left, "take a term of the glossary in CONTRIBUTING instead"


FOREIGN = frozenset("Examples elst js stsd stts tkhd toml udta".split())
"""Names in docstrings that are not of the code: of Gradio, of boxes in mp4 files, of file types."""


def test_docstrings_refer_to_names_that_exist():
    trees = {
        path: ast.parse(path.read_text("utf-8"))
        for path in (path for room in ROOMS for path in (PROJECT / room).rglob("*.py"))
    }
    owners = {part for path in trees for part in path.relative_to(PROJECT).with_suffix("").parts}
    names: set[str] = set()
    for node in (node for tree in trees.values() for node in ast.walk(tree)):
        match node:
            case ast.ClassDef(name=name) | ast.alias(asname=str(name)) | ast.alias(name=name):
                owners.update(name.split("."))
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
                names.add(name)
            case ast.Name(id=name) | ast.arg(arg=name) | ast.Attribute(attr=name):
                names.add(name)
            case ast.ImportFrom(module=str(name)):
                owners.update(name.split("."))
    missing = [
        f"{path.relative_to(PROJECT)}:{node.lineno}: {reference}"
        for path, tree in trees.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
        for reference in re.findall(r"(?<!`)`([A-Za-z_][\w.]*)`(?!`)", node.value.value)
        for (*before, last) in [reference.split(".")]
        if not (owners.issuperset(before) and last in names | owners) and last not in FOREIGN
    ]
    assert not missing
