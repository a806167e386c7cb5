"""The open body's builds as a browser reads them."""

import numpy as np
import pytest

from conventions.views import BUILDS
from renderer.body.body_file import OPEN_BODY_PATH, read_body_file
from renderer.body.skinning import VertexNormals
from renderer.files.glb import STEP_M, builds_bytes


def test_every_build_comes_back_within_a_step() -> None:
    first = read_body_file(OPEN_BODY_PATH)
    normals_of = VertexNormals(first.faces, len(first.template))
    read = np.frombuffer(builds_bytes(), "<i2").reshape(len(BUILDS) - 1, 2, *first.template.shape)
    for build, (offsets, normals) in zip(BUILDS[1:], read, strict=True):
        expected = read_body_file(OPEN_BODY_PATH, build).template
        assert np.abs(expected - first.template).max() > 0.01, "it is another one"
        np.testing.assert_allclose(first.template + STEP_M * offsets, expected, atol=STEP_M)
        np.testing.assert_allclose(normals / 32_767, normals_of(expected), atol=2e-5)


def test_what_would_not_fit_is_no_build(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("renderer.files.glb.STEP_M", 1e-7)
    with pytest.raises(ValueError, match="out of range"):
        builds_bytes()
