"""The renderer without OpenGL draws what the others draw, and survives what they survive."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from renderer.body.body import load_body
from renderer.draw.software import OPENING_EDGES, SoftwareRenderer, near_openings
from renderer.scene.camera import Z_NEAR_M, Camera
from renderer.scene.stage import Stage
from renderer.scene.studio import PosedFrame, Subject
from renderer.video.render import draw_vertices, render_stills
from renderer.video.settings import RenderSettings
from tests.golden.regenerate import PICTURES, posed
from tests.renderer.draw.test_offscreen import make_subject

SIZE = (120, 80)
CAMERA = Camera(eye=(0.0, 1.0, 4.0), target=(0.0, 1.0, 0.0), yfov_rad=0.8)
STAGE = Stage(CAMERA, floor_m=0.0, centre_xz=(0.0, 0.0), extent_m=0.0)
FACES = np.array([[0, 1, 2], [0, 2, 3]])


def draw(vertices: np.ndarray, colors: np.ndarray, faces: np.ndarray) -> np.ndarray:
    settings = RenderSettings(*SIZE, antialias=False, backend="software")
    chunks = [vertices[None].astype(np.float32)]
    (picture,) = draw_vertices(chunks, faces, colors, settings=settings, stage=STAGE)
    return picture.copy()


def test_colours_follow_the_surface_in_perspective():
    """Half way between a near and a far edge the colour is that of the middle of the plank."""
    vertices = np.array([[-0.3, 0.6, 2.0], [0.3, 0.6, 2.0], [0.3, 1.9, -6.0], [-0.3, 1.9, -6.0]])
    shades = np.array([[0.0], [0.0], [0.9], [0.9]], np.float32).repeat(3, axis=1)
    normals = np.tile(np.array([[0.0, 1.0, 0.0]], np.float32), (4, 1))
    subject = Subject(FACES, shades, np.zeros((4, 3), np.float32), is_transparent=True)
    frame = PosedFrame(vertices.astype(np.float32), normals, np.zeros((2, 2, 3), np.uint8))
    near, far = vertices[[0, 1]].mean(axis=0), vertices[[2, 3]].mean(axis=0)
    along = near + np.array([[0.25], [0.5], [0.75]]) * (far - near)
    columns, rows = CAMERA.project(along, 800, 800).astype(int).T
    with SoftwareRenderer(subject, 800, 800, "none") as renderer:
        quarter, half, three_quarters = renderer.draw(frame, CAMERA)[rows, columns, 0].astype(int)
    assert half == pytest.approx((quarter + three_quarters) / 2, abs=2.5)
    assert three_quarters - quarter > 40
    assert abs(rows[1] - (rows[0] + rows[2]) / 2) > 10, "the middle would be there without it"


@pytest.mark.parametrize(
    "corner",
    [(np.nan, 1.0, 0.0), (0.0, 1.0, -np.inf), (1e30, 1e30, 1e30), (0.0, 1.0, 4.0 - Z_NEAR_M / 2)],
)
def test_a_triangle_that_cannot_be_drawn_spoils_no_other(corner):
    square = [[-0.3, 0.7, 0.0], [0.3, 0.7, 0.0], [0.3, 1.3, 0.0], [-0.3, 1.3, 0.0]]
    colors = np.repeat(np.array([[0.9, 0.02, 0.02], [0.02, 0.9, 0.02]], np.float32), 4, axis=0)
    alone = draw(np.array(square), colors[:4], FACES)
    vertices = np.concatenate([square, [corner, (0.1, 1.0, 0.1), (0.2, 1.2, 0.1)]])
    with np.errstate(all="ignore"):
        picture = draw(vertices, colors[:7], np.concatenate([FACES, [[4, 5, 6]]]))
    body = alone[..., 0].astype(int) - alone[..., 1] > 60
    np.testing.assert_array_equal(picture[body], alone[body])
    assert not (picture[..., 1].astype(int) - picture[..., 0] > 60).any(), "green is drawn"


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
    vertices, faces = tube(30)
    height = vertices[faces][..., 1]
    reach = 0.1 * (OPENING_EDGES + 1)
    is_near = (height.min(axis=1) < reach - 1e-6) | (height.max(axis=1) > 2.9 - reach + 1e-6)
    np.testing.assert_array_equal(near_openings(faces, vertices), is_near)


def test_renderers_draw_side_by_side_in_threads():
    subject, frame = make_subject()
    with (
        SoftwareRenderer(subject, *SIZE) as first,
        SoftwareRenderer(subject, *SIZE) as second,
        ThreadPoolExecutor(2) as threads,
    ):
        pictures = threads.map(lambda each: each.draw(frame, CAMERA), (first, second))
        np.testing.assert_array_equal(*pictures)


def test_stills_of_a_body_can_have_nothing_behind_them():
    body, view = load_body(), PICTURES["gesture"].view
    motion = posed(PICTURES["gesture"], body)
    settings = RenderSettings(128, 128, view=view, backend="software", is_transparent=True)
    (picture,) = render_stills(body, motion, [0], settings)
    (solid,) = render_stills(body, motion, [0], replace(settings, is_transparent=False))
    assert picture.shape == (128, 128, 4)
    assert 0.05 < (picture[..., 3] > 0).mean() < 0.5
    inside = picture[..., 3] == 255
    np.testing.assert_array_equal(picture[inside][:, :3], solid[inside])
