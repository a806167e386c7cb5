"""The executed notebook of the documents still runs, and says what it said."""

import ast
import json
import re
from typing import Any

import pytest

from tests.helpers import ROOT

pytestmark = pytest.mark.slow
CELLS = json.loads((ROOT / "docs" / "notebook.ipynb").read_text("utf-8"))["cells"]
NUMBER = re.compile(r"-?\d+(\.\d+)?(e[+-]?\d+)?")


def ran(source: str, names: dict[str, Any]) -> Any:
    """The value of the cell's last line, as Jupyter shows it."""
    tree = ast.parse(source)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, "cell", "exec"), names)
    return (
        None if last is None else eval(compile(ast.Expression(last.value), "cell", "eval"), names)
    )


def words(text: str) -> str:
    """What does not depend on the processor."""
    return "".join(NUMBER.sub("#", text).split())


def test_it_runs_from_top_to_bottom(monkeypatch):
    monkeypatch.chdir(ROOT)
    names: dict[str, Any] = {}
    shown = 0
    for cell in CELLS:
        if cell["cell_type"] != "code":
            continue
        value = ran("".join(cell["source"]), names)
        told = [output["data"] for output in cell["outputs"]]
        assert len(told) == 1, "every cell of the notebook shows something, and was executed"
        if "text/html" in told[0]:
            html = "".join(told[0]["text/html"])
            assert words(value._repr_html_())[:400] == words(html)[:400]
        elif "image/png" not in told[0]:
            shown += 1
            assert words("".join(told[0]["text/plain"])) == words(repr(value))
    assert shown > 5
    both = names["both"]
    assert list(both) == ["globaldiff/local", "globaldiff/global", "workbench/planned"]
    assert all(motion.num_frames == 180 for motion in both.values())
