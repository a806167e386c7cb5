"""A page that is open, attacked from one address while another visitor, and another tab of the very
address, are served. ``pytest -rP`` shows the numbers; ``ATTACK_BODIES=34`` attacks for longer
(`make soak`)."""

import io
import json
import os
import time
from collections.abc import Iterator

import numpy as np
import pytest

from model.motion.motion import save_motion
from tests.helpers import smooth_motion_example
from tests.model.made import make_weights
from tests.soak.attacks import (
    HoursOfNothing,
    Times,
    TricklingSockets,
    live_socket,
    looking_on,
    send_tiny_files,
)
from tests.soak.server import Server, server
from tests.soak.visitor import Visitor

OTHER, LAB = 3, 50
"""Numbers of visitors, each with an address of its own; behind the second are many."""
ATTACKER_AT, OTHER_AT = "127.0.1.200", "127.0.1.4"
IS_LONG = "ATTACK_BODIES" in os.environ
BODIES = int(os.environ.get("ATTACK_BODIES", "12"))
NUM_HOURS = 6 if IS_LONG else 3
"""Each of them wants to be measured; a page measures fewer at once."""
FILES_OF_BODY = 900
LONGEST = 108_000
"""Frames of an hour."""


def say(line: str) -> None:
    print(line, flush=True)  # noqa: T201


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    folder = tmp_path_factory.mktemp("attacked")
    weights = make_weights(folder / "weights")
    with server(folder, weights=weights) as page:
        yield page


@pytest.fixture(scope="module")
def trickling(page: Server) -> Iterator[TricklingSockets]:
    """Ten sockets that trickle while everything else goes on."""
    with TricklingSockets(page.address, 10, ATTACKER_AT) as sockets:
        yield sockets


@pytest.fixture(scope="module")
def motion(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A second and a half."""
    path = tmp_path_factory.mktemp("motion") / "short.npz"
    save_motion(smooth_motion_example(45), path)
    return path.read_bytes()


def an_hour_of_nothing() -> bytes:
    file = io.BytesIO()
    np.savez_compressed(
        file,
        poses=np.zeros((LONGEST, 165), np.float32),
        trans=np.zeros((LONGEST, 3), np.float32),
        expressions=np.zeros((LONGEST, 100), np.float32),
        betas=np.zeros(300, np.float32),
        mocap_frame_rate=30,
    )
    return file.getvalue()


def test_ten_sockets_that_trickle_leave_places_for_others(
    page: Server, trickling: TricklingSockets
) -> None:
    say(f"live places taken by ten sockets of one address: {trickling.num_let_in}")
    assert trickling.num_let_in < 10
    assert all("address" in told for told in trickling.endings)
    with live_socket(page.address, OTHER_AT) as other:
        assert "token" in json.loads(other.recv())


def test_tiny_files_hold_nobody_up(page: Server, motion: bytes) -> None:
    with Visitor(page.address, OTHER) as visitor:
        before, after = Times(), Times()
        for k in range(5):
            before.of(lambda k=k: visitor.upload(f"before {k}.npz", motion))
        with looking_on(page.address, "127.0.1.5") as meanwhile:
            statuses = send_tiny_files(page.address, BODIES, FILES_OF_BODY, ATTACKER_AT)
        with looking_on(page.address, "127.0.1.5") as at_uploads:
            for k in range(10):
                after.of(lambda k=k: visitor.upload(f"after {k}.npz", motion))
    num_left = len(page.left())
    say(f"statuses of {BODIES} bodies of {FILES_OF_BODY} tiny files: {sorted(set(statuses))}")
    say(f"files left by them: {num_left}")
    say(f"GETs while they come: {meanwhile}")
    say(f"uploads before: {before}\nuploads after: {after}\nGETs at these: {at_uploads}")
    assert num_left < 100


def test_hours_of_nothing_do_not_hold_up_another_tab_of_the_same_address(
    page: Server, motion: bytes
) -> None:
    with Visitor(page.address, LAB) as tab, Visitor(page.address, OTHER) as other:
        form = {"motions": [tab.upload("short.npz", motion)], "has_videos": False}
        others = {"motions": [other.upload("short.npz", motion)], "has_videos": False}
        alone, same, elsewhere = Times(), Times(), Times()
        if IS_LONG:
            tab.run("own_motion", **form)  # what is read at the first run is read
            alone.of(lambda: tab.run("own_motion", **form))
        with HoursOfNothing(page.address, LAB, an_hour_of_nothing(), NUM_HOURS) as hours:
            time.sleep(2)  # the first of them is at work
            same.of(lambda: tab.run("own_motion", **form))
            num_done = hours.num_done
            say(f"beside {NUM_HOURS} hours of its own address: {same}; {num_done} of them done")
            if IS_LONG:
                elsewhere.of(lambda: other.run("own_motion", **others))
                say(f"alone: {alone}\nthen from another address: {elsewhere}")
    assert num_done == 0


def test_sockets_that_trickle_lose_their_places(trickling: TricklingSockets) -> None:
    until = time.monotonic() + 60
    while trickling.num_open and time.monotonic() < until:
        time.sleep(0.5)
    assert trickling.num_open == 0
