"""The renderer still draws its golden pictures, by whichever OpenGL."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from renderer.draw.offscreen import BACKENDS
from renderer.draw.probe import choose_backend, probe_backend
from tests.golden.regenerate import GOLDEN, PICTURES, ROOT, draw_all

pytestmark = pytest.mark.gl

MEAN_TOLERANCE = 0.003
"""Of the whole picture, as a share of full scale."""
TILE_TOLERANCE = 0.05
"""Of the worst 15 x 15 pixels: a missing finger hardly moves the mean of the picture."""
TILE_PX = 15


@pytest.fixture(scope="module", params=["here", pytest.param("other", marks=pytest.mark.slow)])
def drawn(request, tmp_path_factory) -> Path:
    """The pictures as what draws here, or the other OpenGL, draws them now."""
    backend, folder = choose_backend(), tmp_path_factory.mktemp("golden")
    if request.param == "here":
        draw_all(backend, folder)
        return folder
    (other,) = set(BACKENDS) - {backend}
    if not probe_backend(other).works:
        pytest.skip(f"{other} does not work here")
    command = [sys.executable, "-m", "tests.golden.regenerate", "--backend", other]
    subprocess.run([*command, "--out", str(folder)], cwd=ROOT, check=True)  # one in a process
    return folder


@pytest.mark.parametrize("name", PICTURES)
def test_golden_picture(drawn, name):
    expected = np.asarray(Image.open(GOLDEN / f"{name}.png")).astype(np.float64)
    actual = np.asarray(Image.open(drawn / f"{name}.png")).astype(np.float64)
    assert actual.shape == expected.shape
    mean, worst = errors(actual, expected)
    if mean > MEAN_TOLERANCE or worst > TILE_TOLERANCE:
        difference = 255 - np.clip(4 * np.abs(actual - expected), 0, 255)
        Image.fromarray(actual.astype(np.uint8)).save(GOLDEN / f"{name}.wrong.png")
        Image.fromarray(difference.astype(np.uint8)).save(GOLDEN / f"{name}.diff.png")
        pytest.fail(
            f"{name} differs by {mean:.2%} on average and {worst:.1%} in one place; see "
            f"{GOLDEN / name}.*.png; after a wanted change run: make golden"
        )


def errors(actual: np.ndarray, expected: np.ndarray) -> tuple[float, float]:
    """Mean absolute difference of the picture and of its worst tile, as shares of full scale."""
    difference = np.abs(actual - expected).mean(axis=2) / 255.0
    rows, columns = (size // TILE_PX for size in difference.shape)
    tiles = difference[: rows * TILE_PX, : columns * TILE_PX]
    tiles = tiles.reshape(rows, TILE_PX, columns, TILE_PX).mean(axis=(1, 3))
    return float(difference.mean()), float(tiles.max())


def test_the_comparison_sees_a_small_body_part_go_missing():
    picture = np.asarray(Image.open(GOLDEN / "rest.png")).astype(np.float64)
    changed = picture.copy()
    changed[100:112, 60:72] = 255.0 - changed[100:112, 60:72]
    mean, worst = errors(changed, picture)
    assert mean < MEAN_TOLERANCE < TILE_TOLERANCE < worst
    assert errors(picture, picture) == (0.0, 0.0)
