"""The viewer of GLB files, on a page of its own in a real Chromium."""

import base64
import threading
import uuid
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, Page
from scipy.spatial.transform import Rotation

from app.run.models import get_system
from app.run.pictures.export import body_motion
from model.generation.windows import GenerateOptions, generate_motion
from model.speech.audio import load_speech
from renderer.body.body import Body, BodyMotion, load_body
from renderer.draw.probe import choose_backend
from renderer.files.glb import glb_bytes
from renderer.video.render import RenderSettings, render_stills
from tests.browser.conftest import PATIENCE_MS
from tests.helpers import ROOT
from tests.model.made import make_weights
from tests.renderer.stage.test_camera import waving_motion

pytestmark = [pytest.mark.browser, pytest.mark.gl]

SIZE_PX = 192
BACKGROUND = np.round(255 * np.array([0.894, 0.902, 0.918]))
PAGE = f"""<!doctype html><meta charset="utf-8"><title>GlbView</title>
<link rel="icon" href="data:,">
<canvas width="{SIZE_PX}" height="{SIZE_PX}"></canvas>
<script type="module">
  import {{ GlbView }} from "./glb_view.js";
  const canvas = document.querySelector("canvas");
  window.view = new GlbView(canvas);
  window.picture = (seconds) => {{
    view.seek(seconds);
    const gl = canvas.getContext("webgl2");
    const pixels = new Uint8Array(4 * canvas.width * canvas.height);
    gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    return btoa(Array.from(pixels, (byte) => String.fromCharCode(byte)).join(""));
  }};
</script>"""


class _Quiet(SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: object) -> None:
        pass


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the server shows."""
    folder = tmp_path_factory.mktemp("viewer")
    (folder / "index.html").write_text(PAGE)
    for module in (ROOT / "app" / "page" / "web" / "body").glob("*.js"):
        (folder / module.name).write_bytes(module.read_bytes())
    return folder


@pytest.fixture(scope="module")
def page(browser: Browser, folder: Path) -> Iterator[Page]:
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(_Quiet, directory=str(folder)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    page = browser.new_page()
    page.set_default_timeout(PATIENCE_MS)
    page.goto(f"http://127.0.0.1:{server.server_port}/")
    page.wait_for_function("window.view")
    yield page
    page.close()
    server.shutdown()
    server.server_close()


@pytest.fixture(scope="module")
def body() -> Body:
    return load_body()


@pytest.fixture
def show(page: Page, folder: Path, body: Body) -> Callable[[BodyMotion], str]:
    """Load a motion into the viewer; gives the file's name, which no cache knows yet."""

    def load(motion: BodyMotion) -> str:
        name = f"{uuid.uuid4().hex}.glb"
        (folder / name).write_bytes(glb_bytes(body, motion))
        page.evaluate("name => view.load(name)", name)
        return name

    return load


def picture(page: Page, seconds: float) -> np.ndarray:
    """(H, W, 3) uint8, upper row first."""
    pixels = np.frombuffer(base64.b64decode(page.evaluate("picture", seconds)), np.uint8)
    return pixels.reshape(SIZE_PX, SIZE_PX, 4)[::-1, :, :3]


def covered(picture: np.ndarray) -> np.ndarray:
    """Where something stands before the background."""
    return np.abs(picture - BACKGROUND).max(axis=-1) > 12


def overlap(one: np.ndarray, other: np.ndarray) -> float:
    """Intersection over union."""
    return float((one & other).sum() / (one | other).sum())


def video_pictures(body: Body, motion: BodyMotion, frames: list[int]) -> tuple[np.ndarray, ...]:
    """Of the body alone, as videos show it: colours, and where it stands."""
    settings = RenderSettings(SIZE_PX, SIZE_PX, is_transparent=True, backend=choose_backend())
    stills = render_stills(body, motion, frames, settings)
    return stills[..., :3], stills[..., 3] > 127


@pytest.mark.parametrize("walk_m", [0.0, 4.0], ids=["standing", "followed by the camera"])
def test_it_shows_the_body_as_the_videos_do(
    page: Page, show: Callable[[BodyMotion], str], body: Body, walk_m: float
) -> None:
    motion, frames = waving_motion(40, walk_m=walk_m), [0, 13, 39]
    show(motion)
    seen = [picture(page, frame / 30) for frame in frames]
    colors, silhouettes = video_pictures(body, motion, frames)
    for shown, color, silhouette in zip(seen, colors, silhouettes, strict=True):
        assert silhouette.sum() > 1000
        assert overlap(covered(shown), silhouette) > 0.93, "less than a pixel along its edge"
        both = covered(shown) & silhouette
        difference = np.abs(shown.astype(int) - color.astype(int))[both]
        assert difference.mean() < 20, "grey levels of 255"
    assert overlap(covered(seen[0]), silhouettes[1]) < 0.9, "the frames do differ"


def test_a_generated_clip_plays(
    page: Page, show: Callable[[BodyMotion], str], body: Body, tmp_path: Path, wav
) -> None:
    system = get_system("globaldiff/local", make_weights(tmp_path))
    options = GenerateOptions(speaker=next(iter(system.speakers)), steps=2)
    motion = body_motion(generate_motion(system, load_speech(wav(1.0)), options)[0])
    show(motion)
    assert page.evaluate("view.duration") == pytest.approx(29 / 30)
    _, silhouettes = video_pictures(body, motion, [0, 29])
    for seconds, silhouette in zip((0, 29 / 30), silhouettes, strict=True):
        assert overlap(covered(picture(page, seconds)), silhouette) > 0.95


def test_between_frames_it_shows_what_lies_between_and_outside_the_nearest(
    page: Page, show: Callable[[BodyMotion], str]
) -> None:
    motion = BodyMotion.resting(3)
    trans = motion.trans.copy()
    trans[1, 0], trans[2, 0] = 0.2, 0.6
    show(replace(motion, trans=trans))

    def middle(seconds: float) -> float:
        """Column of the picture around which the body stands."""
        return float(np.nonzero(covered(picture(page, seconds)))[1].mean())

    first, second, third = (middle(frame / 30) for frame in range(3))
    assert second - first > 5 and third - second == pytest.approx(2 * (second - first), abs=1)
    assert middle(1.5 / 30) == pytest.approx((second + third) / 2, abs=0.5)
    assert (middle(-1.0), middle(99.0)) == (first, third)


def test_faces_move(page: Page, show: Callable[[BodyMotion], str], body: Body) -> None:
    motion = BodyMotion.resting(3)
    expressions = motion.expressions.copy()
    expressions[1:, body.expression_names.index("jawOpen")] = 1.0
    show(replace(motion, expressions=expressions))
    closed, opened = picture(page, 0), picture(page, 1 / 30)
    rows, columns = np.nonzero((closed != opened).any(axis=-1))
    assert len(rows) > 5
    head = covered(closed)[:, SIZE_PX // 2].argmax()
    assert rows.min() > head and rows.max() < head + SIZE_PX // 5
    assert columns.min() > 0.4 * SIZE_PX and columns.max() < 0.6 * SIZE_PX


def test_a_file_that_cannot_be_shown_is_refused_and_the_one_before_stays(
    page: Page, show: Callable[[BodyMotion], str], folder: Path, body: Body
) -> None:
    name = show(BodyMotion.resting(2))
    before = picture(page, 0)
    whole = (folder / name).read_bytes()
    (folder / "cut.glb").write_bytes(whole[: len(whole) // 2])
    (folder / "empty.glb").write_bytes(b"")
    (folder / "other.glb").write_bytes(b"<!doctype html><p>no such file</p>")
    no_camera = whole.replace(b'"cameras"', b'"camerax"')
    (folder / "no_camera.glb").write_bytes(no_camera)
    refused = "url => view.load(url).then(() => 'shown', (error) => error.message)"
    for name in ("cut", "empty", "other", "no_camera"):
        said = page.evaluate(refused, f"{name}.glb")
        assert said == "The 3D file is damaged, or was not made by this app.", name
    said = page.evaluate(refused, "missing.glb")
    assert said == "The 3D file cannot be fetched: the server answers 404."
    np.testing.assert_array_equal(picture(page, 0), before)


def test_the_camera_that_a_person_moves_turns_around_what_it_looks_at(page: Page) -> None:
    eyes = page.evaluate(
        """async () => {
            const { Orbit } = await import("./orbit.js");
            const orbit = new Orbit();
            const camera = [1, 0, 0, 0,  0, 1, 0, 1,  0, 0, 1, 4];  // looks at 0, 1, 0
            const seen = {};
            const after = (name, move) => {
                orbit.reset();
                move();
                seen[name] = orbit.from(camera, 4);
            };
            after("front", () => {});
            after("side", () => orbit.turn(Math.PI / 2, 0));
            after("above", () => orbit.turn(0, 100));
            after("near", () => orbit.nearer(2));
            after("lower", () => { orbit.nearer(2); orbit.shift(0, 0.5); });
            orbit.reset();
            return [seen, orbit.isMoved];
        }"""
    )
    seen, is_moved = eyes
    assert not is_moved
    cameras = {name: np.reshape(rows, (3, 4)) for name, rows in seen.items()}
    for camera in cameras.values():
        np.testing.assert_allclose(camera[:, :3] @ camera[:, :3].T, np.eye(3), atol=1e-12)
        assert np.linalg.det(camera[:, :3]) == pytest.approx(1)
    np.testing.assert_allclose(cameras["front"], [[1, 0, 0, 0], [0, 1, 0, 1], [0, 0, 1, 4]])
    np.testing.assert_allclose(cameras["side"][:, 3], [4, 1, 0], atol=1e-12)
    np.testing.assert_allclose(cameras["side"][:, 2], [1, 0, 0], atol=1e-12)  # back, to the eye
    steep = 1.48
    np.testing.assert_allclose(
        cameras["above"][:, 3], [0, 1 + 4 * np.sin(steep), 4 * np.cos(steep)], atol=1e-12
    )
    np.testing.assert_allclose(cameras["near"][:, 3], [0, 1, 2])
    np.testing.assert_allclose(cameras["lower"][:, 3], [0, 0.5, 2])


def test_from_the_side_a_body_looks_as_one_that_has_turned(
    page: Page, show: Callable[[BodyMotion], str]
) -> None:
    motion = waving_motion(3)
    orbit = """async (yaw) => {
        const { Orbit } = await import("./orbit.js");
        view.orbit = new Orbit();
        view.orbit.turn(yaw, 0);
    }"""
    quarter = np.pi / 2
    show(motion)
    page.evaluate(orbit, -quarter)
    moved = picture(page, 0)
    page.evaluate("view.orbit = null")
    front = picture(page, 0)
    turned = Rotation.from_rotvec([0, quarter, 0])
    poses = motion.poses.copy()
    poses[:, :3] = (turned * Rotation.from_rotvec(poses[:, :3])).as_rotvec()
    show(replace(motion, poses=poses))
    page.evaluate("view.orbit = null")
    assert overlap(covered(moved), covered(front)) < 0.8
    # The file frames a body that has turned a little differently, so the shapes are compared.
    assert overlap(cut_to_size(covered(moved)), cut_to_size(covered(picture(page, 0)))) > 0.93


def cut_to_size(shape: np.ndarray) -> np.ndarray:
    """The part that is covered, scaled to a square."""
    rows, columns = np.nonzero(shape.any(axis=1))[0], np.nonzero(shape.any(axis=0))[0]
    part = shape[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    places = [np.linspace(0, count - 1, SIZE_PX).round().astype(int) for count in part.shape]
    return part[np.ix_(*places)]


def test_a_view_that_is_closed_frees_its_context_and_ends_what_it_loads(
    page: Page, show: Callable[[BodyMotion], str]
) -> None:
    name = show(BodyMotion.resting(2))
    lost = page.evaluate(
        """async (name) => {
            const { GlbView } = await import("./glb_view.js");
            const lost = [];
            for (let i = 0; i < 24; i++) {  // browsers keep about 16 contexts
                const canvas = document.createElement("canvas");
                const view = new GlbView(canvas);
                const loading = view.load(name);
                if (i % 2) await loading;
                view.seek(0);
                view.dispose();
                view.seek(0);
                lost.push(canvas.getContext("webgl2").isContextLost());
                if (i % 2 === 0) lost.push(await loading.catch((error) => error.message));
            }
            return lost;
        }""",
        name,
    )
    assert lost.count(True) == 24
    assert set(lost) - {True} == {"The 3D view was closed."}
    assert covered(picture(page, 0)).any(), "the first view still draws"
