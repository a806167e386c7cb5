"""Coarser meshes move as the whole body does, and are as fine as a picture needs."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from renderer.body.body import Body, load_body
from renderer.body.lod import FACES_PER_SQUARED_HEIGHT_PX, select_lod
from tests.golden.regenerate import PICTURES, posed
from tests.renderer.body.test_body import expanded_to_smplx


@pytest.fixture(scope="module")
def licensed(tmp_path_factory: pytest.TempPathFactory) -> Body:
    path = tmp_path_factory.mktemp("smplx") / "SMPLX_NEUTRAL.npz"
    return load_body(expanded_to_smplx(load_body(), path))


def test_a_mesh_is_as_fine_as_the_picture_needs_and_no_finer():
    body = load_body()
    counts = [len(select_lod(body, height_px).faces) for height_px in (100.0, 455.0, 640.0, 2000.0)]
    assert counts == sorted(counts) and len(set(counts)) == 4 and counts[-1] == len(body.faces)
    for height_px, count in zip((100.0, 455.0, 640.0), counts, strict=False):
        assert count >= FACES_PER_SQUARED_HEIGHT_PX * height_px**2


@pytest.mark.parametrize("is_open", [True, False])
def test_part_of_a_body_moves_as_on_the_whole(licensed, is_open):
    whole = load_body(look="broad-dark") if is_open else licensed
    motion = posed(PICTURES["face"], load_body())
    betas = np.ones(10, np.float32)
    motion = replace(motion, betas=betas, expression_basis=whole.expression_basis)
    used, corners = np.unique(whole.faces[::3], return_inverse=True)
    part = whole.submesh(used, corners.reshape(-1, 3))
    (expected,), (found,) = (next(each.posed_vertices(motion)) for each in (whole, part))
    np.testing.assert_allclose(found, expected[used], atol=1e-6)
    np.testing.assert_array_equal(part.vertex_colors, whole.vertex_colors[used])
    np.testing.assert_array_equal(used[part.faces], whole.faces[::3])


def test_meshes_of_a_licensed_body_are_made_once_and_kept(licensed, tmp_path, monkeypatch):
    """Decimating takes seconds: a file in the cache is taken, and none where it cannot be kept."""
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert select_lod(licensed, 200.0) is licensed
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folder = tmp_path / "co-speech-motion" / "meshes"
    folder.mkdir(parents=True)
    faces = licensed.faces[: round(0.9 * len(licensed.faces))]
    np.savez(folder / f"{licensed.sha256}-2.npz", faces_0=faces, faces_1=faces + 100_000)
    assert len(select_lod(licensed, 200.0).faces) == len(faces)


@pytest.mark.slow
def test_a_licensed_body_gets_a_coarser_mesh(licensed, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    coarse = select_lod(licensed, 200.0)
    assert 10_000 < len(coarse.faces) <= 12_000 < len(licensed.faces)
    assert coarse.num_vertices < licensed.num_vertices
    kept = list(Path(tmp_path).rglob("*.npz"))
    assert len(kept) == 1
    assert len(select_lod(licensed, 200.0).faces) == len(coarse.faces)
