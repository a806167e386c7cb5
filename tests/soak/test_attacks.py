"""A page that is open, attacked from one address while another visitor is served. ``pytest -rP``
shows the numbers; ``ATTACK_BODIES=34`` attacks for longer (`make soak`)."""

import os
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from model.motion.motion import save_motion
from tests.helpers import smooth_motion_example
from tests.soak.attacks import NAMED, send_tiny_files, zip_of_nothing
from tests.soak.server import Server, server
from tests.soak.visitor import Refused, Visitor

OTHER, LAB = 3, 50
"""Numbers of visitors, each with an address of its own."""
ATTACKER_AT = "127.0.1.200"
IS_LONG = "ATTACK_BODIES" in os.environ
pytestmark = () if IS_LONG else pytest.mark.slow
BODIES = int(os.environ.get("ATTACK_BODIES", "12"))
FILES_OF_BODY = 900


def say(line: str) -> None:
    print(line, flush=True)  # noqa: T201


@pytest.fixture(scope="module")
def page(weights: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    with server(tmp_path_factory.mktemp("attacked"), weights=weights) as page:
        yield page


@pytest.fixture(scope="module")
def motion(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A second and a half."""
    path = tmp_path_factory.mktemp("motion") / "short.npz"
    save_motion(smooth_motion_example(45), path)
    return path.read_bytes()


def test_tiny_files_hold_nobody_up_and_are_not_kept(page: Server, motion: bytes) -> None:
    with Visitor(page.address, OTHER) as visitor:
        statuses = send_tiny_files(page.address, BODIES, FILES_OF_BODY, ATTACKER_AT)
        for k in range(10):
            visitor.upload(f"after {k}.npz", motion)
    say(f"statuses of {BODIES} bodies of {FILES_OF_BODY} tiny files: {sorted(set(statuses))}")
    assert len(page.left()) < 100


def test_a_zip_named_many_times_holds_nobody_up(page: Server) -> None:
    with Visitor(page.address, LAB) as one, Visitor(page.address, OTHER) as other:
        named = one.upload("nothing.zip", zip_of_nothing())
        news = one.events("own_motion", {"motions": NAMED * [named], "has_video": False})
        waits = []
        with pytest.raises(Refused):
            for _ in news:
                asked_at = time.monotonic()
                assert other.is_there("config")
                waits.append(time.monotonic() - asked_at)
    say(f"longest wait of another meanwhile: {max(waits, default=0):.2f} s")
    assert max(waits, default=0) < 5
