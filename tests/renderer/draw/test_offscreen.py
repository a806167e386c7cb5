"""Pictures show what the arrays say: place, side, colour, and nothing of the frame before."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from renderer.body.body import load_body
from renderer.body.skinning import VertexNormals
from renderer.draw.offscreen import Backend, GLError, OffscreenRenderer, load_opengl
from renderer.draw.probe import choose_backend
from renderer.scene.camera import Camera
from renderer.scene.camera_setup import CameraSetup, PanelCamera
from renderer.scene.studio import PosedFrame, PosedFrameBuilder, StaticBody
from renderer.video.render import RenderSettings
from tests.golden.regenerate import PICTURES, posed
from tests.renderer.drawn import render_stills

pytestmark = pytest.mark.gl

SIZE = (160, 120)
RED, GREEN = (0.9, 0.02, 0.02), (0.02, 0.9, 0.02)
CAMERA = Camera(eye=(0.0, 1.0, 4.0), target=(0.0, 1.0, 0.0), yfov_rad=0.8)
STAGE = CameraSetup((PanelCamera("front", CAMERA),), floor_m=0.0)


def box(low, high) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and outward faces of an axis-parallel box."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float32)
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [corner for a, b, c, d in sides for corner in ((a, b, c), (a, c, d))]
    low, high = np.asarray(low, np.float32), np.asarray(high, np.float32)
    return low + corners * (high - low), np.array(faces)


def gl_backend() -> Backend:
    """The OpenGL of this machine; the calling test is skipped where there is none."""
    try:
        return choose_backend()
    except GLError as error:
        pytest.skip(str(error))


@pytest.fixture
def draw() -> Callable[..., list[np.ndarray]]:
    """One picture for each set of vertices, painted red, by one renderer."""
    backend = gl_backend()

    def draw(
        vertices: list[np.ndarray], faces: np.ndarray, colors: np.ndarray | None = None
    ) -> list[np.ndarray]:
        if colors is None:
            colors = np.tile(np.array(RED, np.float32), (len(vertices[0]), 1))
        prepare = PosedFrameBuilder(faces, len(vertices[0]), STAGE)
        subject = StaticBody(faces, colors, prepare.ground.corners())
        with OffscreenRenderer(backend) as renderer:
            canvas = renderer.make_canvas(subject, *SIZE)
            return [canvas.draw(prepare(each), CAMERA).copy() for each in vertices]

    return draw


def red_pixels(picture: np.ndarray) -> np.ndarray:
    return picture[..., 0].astype(int) - picture[..., 1] > 60


@pytest.mark.parametrize(
    ("low", "high"),
    [
        ((0.4, 1.3, 0.0), (0.8, 1.6, 0.1)),  # upper right of the picture: the body's left
        ((-0.9, 0.6, 0.0), (-0.6, 0.7, 0.4)),
    ],
)
def test_a_box_covers_the_pixels_it_projects_to(draw, low, high):
    vertices, faces = box(low, high)
    (picture,) = draw([vertices], faces)
    expected = CAMERA.project(vertices, *SIZE)
    expected = [*expected.min(axis=0), *expected.max(axis=0)]
    rows, columns = np.nonzero(red_pixels(picture))
    measured = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
    np.testing.assert_allclose(measured, expected, rtol=0.0, atol=1.5)


@pytest.mark.parametrize("order", [1, -1])
def test_nearer_hides_farther_and_the_floor_what_stands_below_it(draw, order):
    parts = [box((-0.3, -0.5, 0.4), (0.3, 0.6, 0.5)), box((-0.9, 0.9, -0.6), (0.9, 1.8, -0.5))]
    parts.append(box((-0.3, 0.3, -0.9), (0.3, 1.5, -0.8)))  # behind both
    parts = parts[::order]
    vertices = np.concatenate([part for part, _ in parts])
    faces = np.concatenate([8 * k + part for k, (_, part) in enumerate(parts)])
    red = np.repeat([RED if part.max() > 0.5 and part[:, 2].max() > 0.2 else GREEN
                     for part, _ in parts], 8, axis=0)  # fmt: skip
    (picture,) = draw([vertices], faces, colors=red.astype(np.float32))
    rows = np.nonzero(red_pixels(picture)[:, 80])[0]
    expected = CAMERA.project(np.array([[0, 0.6, 0.5], [0, 0, 0.5]]), *SIZE)[:, 1]
    np.testing.assert_allclose([rows.min(), rows.max() + 1], expected, atol=2.5)
    assert picture[50, 80, 1] > picture[50, 80, 0] + 60


def test_moving_in_place_equals_drawing_anew(draw):
    first, faces = box((-0.5, 0.5, 0.0), (0.0, 1.0, 0.3))
    second = first @ np.array([[0.8, 0.6, 0], [-0.6, 0.8, 0], [0, 0, 1]], np.float32) + (0.5, 0, 0)
    moved = draw([first, second.astype(np.float32), first], faces)
    (anew,) = draw([second.astype(np.float32)], faces)
    np.testing.assert_array_equal(moved[1], anew)
    np.testing.assert_array_equal(moved[0], moved[2])
    assert (moved[0] != moved[1]).any()


def test_the_shadow_falls_on_the_floor_where_the_body_stands(draw):
    rng = np.random.default_rng(5)
    spot = np.array([0.45, 0.0, 0.7])
    plate, faces = box((-0.6, 0.0, 0.2), (-0.5, 0.1, 0.3))
    # Vertices without faces: they cast the shadow and are not drawn themselves.
    touching = (spot + rng.uniform(-0.06, 0.06, (400, 3)) * (1, 0, 1)).astype(np.float32)
    away = touching + np.array([0.0, 90.0, 0.0], np.float32)
    with_shadow, without = draw([np.concatenate([plate, x]) for x in (touching, away)], faces)
    darkened = without.astype(int).sum(axis=2) - with_shadow.astype(int).sum(axis=2)
    row, column = np.unravel_index(darkened.argmax(), darkened.shape)
    assert darkened.max() > 100
    np.testing.assert_allclose((column, row), CAMERA.project(spot, *SIZE), atol=4)
    assert (darkened > 30).mean() < 0.1


def test_normals_equal_the_slow_sum():
    rng = np.random.default_rng(3)
    vertices = rng.normal(size=(20, 3)).astype(np.float32)
    faces = rng.integers(0, 18, size=(40, 3))  # vertices 18 and 19 have no face
    expected = np.zeros((20, 3))
    for a, b, c in faces:
        cross = np.cross(vertices[b] - vertices[a], vertices[c] - vertices[a])
        for corner in (a, b, c):
            expected[corner] += cross
    length = np.linalg.norm(expected, axis=1, keepdims=True)
    expected = np.divide(expected, length, out=np.zeros_like(expected), where=length > 0)
    np.testing.assert_allclose(VertexNormals(faces, 20)(vertices), expected, atol=1e-5)


def test_a_second_backend_needs_a_process_of_its_own():
    backend = gl_backend()
    load_opengl(backend)
    with pytest.raises(GLError, match="needs a separate process"):
        load_opengl("osmesa" if backend == "egl" else "egl")


def make_subject() -> tuple[StaticBody, PosedFrame]:
    vertices, faces = box((-0.5, 0.5, 0.0), (0.0, 1.0, 0.3))
    prepare = PosedFrameBuilder(faces, len(vertices), STAGE)
    colors = np.full(vertices.shape, 0.5, np.float32)
    return StaticBody(faces, colors, prepare.ground.corners()), prepare(vertices)


def test_lights_are_added_up_in_one_order_wherever_they_lie_in_memory():
    """Else some pixels would differ by a grey level from process to process."""
    load_opengl(gl_backend())
    from renderer.draw.gl import BodyScene

    scenes = [BodyScene(*make_subject(), CAMERA, 4 / 3).scene for _ in range(20)]
    orders = {tuple(node.light.intensity for node in scene.light_nodes) for scene in scenes}
    assert len(orders) == 1 and len(orders.pop()) == 3


def tube(rings: int, around: int = 12) -> tuple[np.ndarray, np.ndarray]:
    """An open cylinder along y whose front is outside, with a seam of doubled vertices."""
    angle = np.linspace(0.0, 2 * np.pi, around + 1)
    angle[-1] = 0.0
    circle = np.stack([np.sin(angle), np.zeros(around + 1), np.cos(angle)], axis=1)
    vertices = np.concatenate([circle + np.array([0.0, 0.1 * k, 0.0]) for k in range(rings)])
    faces = []
    for k in range(rings - 1):
        for n in range(around):
            a, b = k * (around + 1) + n, k * (around + 1) + n + 1
            faces += [[a, b, b + around + 1], [a, b + around + 1, a + around + 1]]
    return vertices, np.array(faces)


def test_only_near_openings_a_mesh_is_seen_from_behind():
    load_opengl(gl_backend())
    from renderer.draw.gl import OPENING_M, faces_near_openings

    vertices, faces = tube(30)
    edge_m = OPENING_M / 4.5
    vertices *= edge_m / 0.1
    ring = np.rint(vertices[faces][..., 1] / edge_m)
    is_near = (ring.min(axis=1) <= 4) | (ring.max(axis=1) >= 29 - 4)
    np.testing.assert_array_equal(faces_near_openings(faces, vertices), is_near)


def test_stills_of_a_body_can_have_nothing_behind_them():
    body, view = load_body(), PICTURES["gesture"].view
    motion = posed(PICTURES["gesture"], body)
    settings = RenderSettings(128, 128, view=view, backend=gl_backend(), is_transparent=True)
    (picture,) = render_stills(body, motion, [0], settings)
    (solid,) = render_stills(body, motion, [0], replace(settings, is_transparent=False))
    assert picture.shape == (128, 128, 4)
    assert 0.05 < (picture[..., 3] > 0).mean() < 0.5
    inside = picture[..., 3] == 255
    np.testing.assert_array_equal(picture[inside][:, :3], solid[inside])


def test_a_second_opengl_renderer_is_refused_in_any_thread_until_the_first_has_ended():
    backend, (subject, frame) = gl_backend(), make_subject()

    def attempt() -> np.ndarray:
        with OffscreenRenderer(backend) as renderer:
            return renderer.make_canvas(subject, *SIZE).draw(frame, CAMERA).copy()

    with ThreadPoolExecutor(1) as thread:
        with OffscreenRenderer(backend) as first:
            canvas = first.make_canvas(subject, *SIZE)
            before = canvas.draw(frame, CAMERA).copy()
            for refused in (attempt, thread.submit(attempt).result):
                with pytest.raises(GLError, match=r"one at a time.*separate processes"):
                    refused()
            np.testing.assert_array_equal(canvas.draw(frame, CAMERA), before)
        np.testing.assert_array_equal(thread.submit(attempt).result(), before)


def test_a_context_that_cannot_be_had_gives_one_sentence(monkeypatch):
    backend, (subject, frame) = gl_backend(), make_subject()

    def fail(*args: object) -> None:
        raise OSError("the driver says no\nand much more")

    with monkeypatch.context() as patch:
        patch.setattr("renderer.draw.offscreen._new_platform", fail)
        with pytest.raises(
            GLError, match=r"cannot create a context \(OSError the driver says no\)"
        ):
            OffscreenRenderer(backend).__enter__()
    with OffscreenRenderer(backend) as renderer:  # nothing stays claimed
        assert renderer.make_canvas(subject, *SIZE).draw(frame, CAMERA).shape == (120, 160, 3)
