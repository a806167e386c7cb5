"""Coarser meshes: of small surfaces, and those that are kept beside the open body."""

from __future__ import annotations

import numpy as np

from renderer.body.body import load_body
from renderer.body.look import coarser_faces
from tools.bake.coarser import NUM_FACES, Surface, coarser, importance


def sheet(size: int) -> Surface:
    """A flat square of ``size`` x ``size`` cells that faces +z; its right half is of another
    colour."""
    x, y = np.meshgrid(np.arange(size + 1.0), np.arange(size + 1.0), indexing="ij")
    grid = np.arange(x.size).reshape(x.shape)
    a, b, c, d = (
        part.ravel() for part in (grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:])
    )
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    vertices = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], 1)
    colors = np.repeat((vertices[:, :1] > size / 2).astype(float), 3, 1)
    return Surface(vertices, faces, colors, np.ones((x.size, 1)), np.ones(x.size))


def areas(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Of each face, as a vector along its normal."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.cross(b - a, c - a) / 2


def test_a_flat_sheet_keeps_its_outline_and_no_face_turns_over() -> None:
    surface = sheet(8)
    (faces,) = coarser(surface, [40])
    assert len(faces) <= 40
    of_faces = areas(surface.vertices, faces)
    assert (of_faces[:, 2] > 0).all()
    np.testing.assert_allclose(of_faces[:, 2].sum(), 64)
    corners = {0, 8, 72, 80}
    assert corners <= set(faces.ravel().tolist())


def test_the_line_between_two_colours_stays_where_it_is() -> None:
    surface = sheet(8)
    (faces,) = coarser(surface, [40])
    share = surface.colors[faces, 0].sum(1) / 3
    mixed = faces[(share > 0) & (share < 1)]
    assert len(mixed) and np.isin(surface.vertices[mixed, 0], (4.0, 5.0)).all()


def test_hands_head_and_above_all_the_face_that_moves_matter_most() -> None:
    names = ("pelvis", "left_index1", "head", "right_wrist")
    plain, finger, head, lips = importance(
        names, np.array([0, 1, 2, 2]), np.array([False, False, False, True])
    )
    assert plain < head < finger < lips


def test_the_meshes_beside_the_body_have_its_surface_and_none_of_its_faces_turned() -> None:
    body = load_body()
    vertices = body.template.astype(np.float64)
    whole = np.linalg.norm(areas(vertices, body.faces), axis=1).sum()
    meshes = coarser_faces()
    assert len(meshes) == len(NUM_FACES)
    normals = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(normals, body.faces[:, k], areas(vertices, body.faces))
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    limits = ((0.97, 0.01), (0.95, 0.01), (0.92, 0.01), (0.85, 0.02))  # the last casts shadows
    for count, faces, (least, most) in zip(NUM_FACES, meshes, limits, strict=True):
        assert 0.9 * count < len(faces) <= count
        of_faces = areas(vertices, faces)
        sizes = np.linalg.norm(of_faces, axis=1)
        assert sizes.sum() > least * whole, "it has holes"
        along = (of_faces * normals[faces].mean(1)).sum(1)
        assert sizes[along < 0].sum() < most * whole, "faces turned over"
