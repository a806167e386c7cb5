"""The renderer without OpenGL draws what the others draw, and survives what they survive."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from renderer.body.body import load_body
from renderer.draw import software
from renderer.draw.offscreen import Backend
from renderer.draw.probe import probe_backend
from renderer.draw.software import OPENING_EDGES, SoftwareRenderer, near_openings
from renderer.scene.camera import Z_NEAR_M, Camera
from renderer.scene.stage import Stage
from renderer.scene.studio import PosedFrame, Subject
from renderer.video.render import draw_vertices, render_stills
from renderer.video.settings import RenderSettings
from tests.golden.regenerate import PICTURES, posed

ROOT = Path(__file__).resolve().parents[3]
SIZE = (120, 80)
CAMERA = Camera(eye=(0.0, 1.0, 4.0), target=(0.0, 1.0, 0.0), yfov_rad=0.8)
STAGE = Stage(CAMERA, floor_m=0.0, centre_xz=(0.0, 0.0), extent_m=0.0)
RED, GREEN = (0.9, 0.02, 0.02), (0.02, 0.9, 0.02)

DRAW_ALL = """
import sys, numpy as np
from renderer.body.body import load_body
from renderer.video.render import RenderSettings, render_stills
from tests.golden.regenerate import PICTURES, posed
pictures = {}
for name, picture in PICTURES.items():
    body, view = load_body(look=picture.look), picture.view
    settings = RenderSettings(256, 256, view=view, backend=sys.argv[1], is_transparent=True)
    pictures[name] = render_stills(body, posed(picture, body), [0], settings)[0]
    settings = RenderSettings(256, 256, view=view, backend=sys.argv[1], antialias=False)
    pictures["draft " + name] = render_stills(body, posed(picture, body), [0], settings)[0]
np.savez(sys.argv[2], **pictures)
"""


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, np.ndarray]]:
    """By backend, the golden poses as it draws them; each in a process of its own."""
    folder = tmp_path_factory.mktemp("backends")
    backends: tuple[Backend, ...] = ("egl", "osmesa", "software")
    found = {}
    for name in backends:
        if probe_backend(name).works:
            command = [sys.executable, "-c", DRAW_ALL, name, str(folder / f"{name}.npz")]
            subprocess.run(command, cwd=ROOT, check=True)
            with np.load(folder / f"{name}.npz") as pictures:
                found[name] = dict(pictures)
    assert "software" in found, probe_backend("software").error
    return found


@pytest.mark.gl
@pytest.mark.parametrize("other", ["egl", "osmesa"])
@pytest.mark.parametrize("name", PICTURES)
def test_backends_draw_one_and_the_same_body(drawn, name, other):
    if other not in drawn:
        pytest.skip(f"{other} does not work here")
    ours, theirs = drawn["software"][name], drawn[other][name]
    bodies = [picture[..., 3] > 127 for picture in (ours, theirs)]
    assert (bodies[0] & bodies[1]).sum() / (bodies[0] | bodies[1]).sum() > 0.98
    both = bodies[0] & bodies[1]
    # Same light: a shader that changes alone is found here.
    assert np.abs(ours[both].astype(int) - theirs[both]).mean() < 1.0
    draft = [drawn[backend][f"draft {name}"].astype(int) for backend in ("software", other)]
    assert np.abs(draft[0] - draft[1]).mean() < 0.5


def draw(vertices: np.ndarray, colors: np.ndarray, faces: np.ndarray, **changes) -> np.ndarray:
    settings = replace(RenderSettings(*SIZE, antialias=False, backend="software"), **changes)
    (picture,) = draw_vertices(
        [vertices[None].astype(np.float32)], faces, colors, settings=settings, stage=STAGE
    )
    return picture.copy()


def plate(z: float, colour, half: float = 0.3) -> tuple[np.ndarray, np.ndarray]:
    """A square that faces the camera, and its colours."""
    corners = np.array([[-half, 1 - half, z], [half, 1 - half, z], [half, 1 + half, z]])
    square = np.concatenate([corners, [[-half, 1 + half, z]]])
    return square, np.tile(np.array(colour, np.float32), (4, 1))


FACES = np.array([[0, 1, 2], [0, 2, 3]])


def test_nearer_hides_farther_in_whatever_order_they_come():
    near, far = plate(0.5, RED), plate(-0.5, GREEN, half=0.9)
    for first, second in ((near, far), (far, near)):
        vertices = np.concatenate([first[0], second[0]])
        colors = np.concatenate([first[1], second[1]])
        picture = draw(vertices, colors, np.concatenate([FACES, FACES + 4])).astype(int)
        middle, beside = picture[40, 60], picture[40, 60 + 18]
        assert middle[0] > middle[1] + 60 and beside[1] > beside[0] + 60


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
    [
        (np.nan, 1.0, 0.0),
        (0.0, np.nan, np.nan),
        (np.inf, 1.0, 0.0),
        (0.0, 1.0, -np.inf),
        (1e30, 1e30, 1e30),
        (0.0, 1.0, 4.0),  # in the eye
        (0.0, 1.0, 9.0),  # behind it
        (0.0, 1.0, 4.0 - 0.5 * Z_NEAR_M),
    ],
)
def test_a_triangle_that_cannot_be_drawn_spoils_no_other(corner):
    good, colors = plate(0.0, RED)
    alone = draw(good, colors, FACES)
    vertices = np.concatenate([good, [corner, (0.1, 1.0, 0.1), (0.2, 1.2, 0.1)]])
    colors = np.concatenate([colors, np.tile(np.float32(GREEN), (3, 1))])
    faces = np.concatenate([FACES, [[4, 5, 6]]])
    with np.errstate(all="ignore"):
        picture = draw(vertices, colors, faces)
    body = alone[..., 0].astype(int) - alone[..., 1] > 60
    np.testing.assert_array_equal(picture[body], alone[body])
    assert not (picture[..., 1].astype(int) - picture[..., 0] > 60).any(), "green is drawn"


def test_what_lies_outside_the_picture_is_cut_off():
    vertices, colors = plate(0.0, RED, half=50.0)
    assert (draw(vertices, colors, FACES)[..., 0] > 100).all()
    aside = draw(vertices + np.array([200.0, 0.0, 0.0]), colors, FACES)
    assert not (aside[..., 0].astype(int) - aside[..., 1] > 60).any()


def test_the_floor_hides_what_stands_below_it():
    vertices, colors = plate(0.0, RED)
    picture = draw(vertices - np.array([0.0, 1.0, 0.0]), colors, FACES)
    rows = np.nonzero((picture[..., 0].astype(int) - picture[..., 1] > 60).any(axis=1))[0]
    expected = CAMERA.project(np.array([[0.0, 0.3, 0.0], [0.0, 0.0, 0.0]]), *SIZE)[:, 1]
    np.testing.assert_allclose([rows.min(), rows.max() + 1], expected, atol=1.5)


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
            c, d = a + around + 1, b + around + 1
            faces += [[a, b, d], [a, d, c]]
    return vertices, np.array(faces)


def test_only_near_openings_a_mesh_is_seen_from_behind():
    vertices, faces = tube(30)
    has_back = near_openings(faces, vertices)
    height = vertices[faces][..., 1]
    reach = 0.1 * (OPENING_EDGES + 1)
    is_near = (height.min(axis=1) < reach - 1e-6) | (height.max(axis=1) > 2.9 - reach + 1e-6)
    np.testing.assert_array_equal(has_back, is_near)
    lids = [[n, n + 1, 0] for n in range(1, 11)]
    lids += [[13 * 29 + n + 1, 13 * 29 + n, 13 * 29] for n in range(1, 11)]
    assert not near_openings(np.concatenate([faces, lids]), vertices).any()


@pytest.mark.parametrize("view", ["front", "three_quarter", "right_hand"])
def test_backs_that_are_left_out_are_not_missed(monkeypatch, view):
    body, picture = load_body(), PICTURES["gesture"]
    settings = RenderSettings(256, 256, view=view, backend="software")
    drawn = []
    for edges in (OPENING_EDGES, 300):  # farther than any vertex is from an opening
        monkeypatch.setattr(software, "OPENING_EDGES", edges)
        drawn.append(render_stills(body, posed(picture, body), [0], settings)[0].astype(int))
    differs = np.abs(drawn[0] - drawn[1]).max(axis=2) > 2
    assert differs.mean() < 1e-4


def test_it_steps_in_where_there_is_no_opengl(tmp_path):
    code = "from renderer.draw.probe import choose_backend; print(choose_backend())"
    assert run_without_opengl(tmp_path, code).strip() == "software"


def run_without_opengl(folder: Path, code: str, **environment: str) -> str:
    for library in ("libEGL.so", "libGL.so", "libOSMesa.so"):
        for version in ("", ".1", ".6", ".8"):
            (folder / f"{library}{version}").write_text("not a library")
    child = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        env={**os.environ, "LD_LIBRARY_PATH": str(folder), **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    return child.stdout + child.stderr


COMPILE = """
from renderer.draw import rasteriser
import numpy as np
rasteriser.make_ready()
rasteriser.project(np.zeros((1, 3), np.float32), np.ones(3), np.eye(3), 1.0, np.ones(2),
                   np.zeros((1, 3)))
print("drawn")
"""


def test_machine_code_is_kept_in_the_users_cache_and_nowhere_else(tmp_path):
    before = {path for path in (ROOT / "renderer").rglob("*.nb[ci]")}
    environment = {"XDG_CACHE_HOME": str(tmp_path), "NUMBA_CACHE_DIR": ""}
    assert "drawn" in run_without_opengl(tmp_path, COMPILE, **environment)
    assert list((tmp_path / "co-speech-motion").rglob("rasteriser.project*.nbc"))
    assert {path for path in (ROOT / "renderer").rglob("*.nb[ci]")} == before == set()


def test_a_cache_that_cannot_be_written_is_done_without(tmp_path):
    (tmp_path / "file").write_text("")
    environment = {
        **{"XDG_CACHE_HOME": str(tmp_path / "file"), "NUMBA_CACHE_DIR": ""},
        "TMPDIR": str(tmp_path / "none"),
    }
    assert "drawn" in run_without_opengl(tmp_path, COMPILE, **environment)


def test_stills_of_a_body_can_have_nothing_behind_them():
    body, view = load_body(), PICTURES["gesture"].view
    motion = posed(PICTURES["gesture"], body)
    settings = RenderSettings(128, 128, view=view, backend="software", is_transparent=True)
    (picture,) = render_stills(body, motion, [0], settings)
    settings = replace(settings, is_transparent=False)
    (solid,) = render_stills(body, motion, [0], settings)
    assert picture.shape == (128, 128, 4)
    assert 0.05 < (picture[..., 3] > 0).mean() < 0.5
    inside = picture[..., 3] == 255
    np.testing.assert_array_equal(picture[inside][:, :3], solid[inside])
