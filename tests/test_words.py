"""Names of the code: words that are not the field's become fewer (CONTRIBUTING, how we write)."""

import ast
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[1]
ROOMS = ("app", "conventions", "model", "processes", "renderer", "tools")
WORDS = frozenset(
    "told found heard said asked kept given seen known settled made shown ear deaf whose who what "
    "beside apart alike judge judges".split()
)


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


def count_words() -> Counter[str]:
    found: Counter[str] = Counter()
    for path in (path for room in ROOMS for path in (PROJECT / room).rglob("*.py")):
        names = public_names(ast.parse(path.read_text("utf-8")))
        found.update(
            word for name in names if not name.startswith("_") for word in words_of(name) & WORDS
        )
    return found


MOST: dict[str, int] = {
    "alike": 1,
    "apart": 4,
    "asked": 10,
    "beside": 1,
    "found": 15,
    "given": 6,
    "heard": 5,
    "judge": 2,
    "kept": 18,
    "known": 1,
    "made": 14,
    "said": 2,
    "seen": 6,
    "shown": 11,
    "told": 29,
    "what": 2,
}
"""How often each stands in public names today; lower a number where names were changed."""


def test_no_new_name_has_a_word_that_is_to_go():
    found = count_words()
    grown = {word: count for word, count in found.items() if count > MOST.get(word, 0)}
    assert not grown, "take a term of the glossary in CONTRIBUTING for the new name"
