"""Motions as other programs read them, asked for by their addresses."""

from pathlib import Path

import numpy as np
import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient

from app.page.routes.media import ENDINGS, MediaAddresses, motion_file_routes
from app.page.visitors.visitors import COOKIE
from model.motion.motion import save_motion
from tests.app.fakes import made_motion

WHOSE = {"Cookie": f"{COOKIE}=mine"}


@pytest.fixture
def temp(tmp_path: Path) -> Path:
    folder = tmp_path / "temp"
    folder.mkdir()
    return folder


@pytest.fixture
def addresses() -> MediaAddresses:
    return MediaAddresses()


@pytest.fixture
def page(addresses: MediaAddresses, temp: Path) -> TestClient:
    app = FastAPI()
    app.router.routes.extend(motion_file_routes(addresses, temp))
    return TestClient(app)


def test_a_motion_comes_as_each_program_reads_it(
    page: TestClient, addresses: MediaAddresses, temp: Path, tmp_path: Path
) -> None:
    motion = tmp_path / "globaldiff-local.npz"
    save_motion(made_motion(8), motion)
    address = addresses.address(motion, "mine")
    came = {kind: page.get(f"/{address}/{kind}", headers=WHOSE) for kind in ENDINGS}
    for kind, answer in came.items():
        assert answer.status_code == 200, answer.text
        name = f"globaldiff-local{ENDINGS[kind]}"
        assert f'filename="{name}"' in answer.headers["content-disposition"]
    assert came["glb"].content[:4] == b"glTF"
    assert came["bvh"].text.startswith("HIERARCHY") and "Frames: 8" in came["bvh"].text
    kept = tmp_path / "blender.npz"
    kept.write_bytes(came["blender"].content)
    with np.load(kept, allow_pickle=False) as content:
        assert content["poses"].shape == (8, 165)
    assert not list(temp.iterdir()), "nothing stays behind"
    assert [path.name for path in tmp_path.glob("*.npz")] != [] and motion.is_file()


def test_only_a_motion_that_this_browser_was_told_of_is_made(
    page: TestClient, addresses: MediaAddresses, temp: Path, tmp_path: Path
) -> None:
    motion, sound = tmp_path / "a.npz", tmp_path / "a.wav"
    save_motion(made_motion(8), motion)
    sound.write_bytes(b"RIFF")
    address = addresses.address(motion, "mine")
    for url, headers in (
        (f"/{address}/glb", {}),
        (f"/{address}/exe", WHOSE),
        (f"/{address}/..%2fa.npz", WHOSE),
        (f"/{addresses.address(sound, 'mine')}/glb", WHOSE),
        ("/media/guess/glb", WHOSE),
    ):
        assert page.get(url, headers=headers).status_code == 404, url
    assert not list(temp.iterdir())


def test_a_motion_that_cannot_be_read_is_told_in_a_sentence(
    page: TestClient, addresses: MediaAddresses, temp: Path, tmp_path: Path
) -> None:
    damaged = tmp_path / "damaged.npz"
    damaged.write_bytes(b"PK nothing of the kind")
    answer = page.get(f"/{addresses.address(damaged, 'mine')}/bvh", headers=WHOSE)
    assert answer.status_code == 400 and "damaged.npz" in answer.text
    assert str(tmp_path) not in answer.text and not list(temp.iterdir())
