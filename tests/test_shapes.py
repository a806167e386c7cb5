"""Shapes of annotations are checked in tests, or a mistake in one would be seen by nobody."""

import ast
from collections.abc import Iterator

import jaxtyping
import pytest
import torch

from model.motion.rotations import matrix_from_axis_angle
from renderer.body.body import BodyMotion
from tests.test_words import PROJECT, ROOMS


@pytest.mark.parametrize("again", range(2))
def test_the_first_calls_of_each_test_are_checked(again):
    with pytest.raises(jaxtyping.TypeCheckError, match=r"parameters of model\.motion\.rotations"):
        matrix_from_axis_angle(torch.zeros(2, 4))
    for _ in range(5):
        assert matrix_from_axis_angle(torch.zeros(2, 3)).shape == (2, 3, 3)
    with pytest.raises(jaxtyping.TypeCheckError):
        BodyMotion(*["no array"] * 5)


def arrays_without_shape(annotation: ast.expr) -> Iterator[str]:
    """Arrays of an annotation that are not in a type of jaxtyping, such as `Float[Tensor, "T"]`."""
    match annotation:
        case ast.Subscript(value=ast.Name(id=name)) if hasattr(jaxtyping, name):
            return
        case ast.Name(id="Tensor") | ast.Attribute(attr="Tensor" | "ndarray"):
            yield ast.unparse(annotation)
    for part in ast.iter_child_nodes(annotation):
        if isinstance(part, ast.expr):
            yield from arrays_without_shape(part)


def test_every_array_parameter_has_a_shape():
    bare = [
        f"{path.relative_to(PROJECT)}:{node.lineno} {node.arg}"
        for room in ROOMS
        for path in sorted((PROJECT / room).rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.arg)
        and node.annotation
        and any(arrays_without_shape(node.annotation))
    ]
    assert bare == []
