"""A page that is open, attacked from one address while another visitor, and another tab of the very
address, are served. ``pytest -rP`` shows the numbers; ``ATTACK_BODIES=34`` attacks for longer, and
``ATTACKED_VISITORS=20`` has so many wait meanwhile (`make soak`)."""

import io
import json
import os
import statistics
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from model.motion.motion import save_motion
from model.speech.audio import write_wav
from tests.helpers import smooth_motion_example
from tests.model.made import made_waveform
from tests.soak.attacks import (
    HoursOfNothing,
    TricklingSockets,
    live_socket,
    send_tiny_files,
)
from tests.soak.server import Server, server
from tests.soak.visitor import Refused, Visitor

OTHER, LAB = 3, 50
"""Numbers of visitors, each with an address of its own; behind the second are many."""
ATTACKER_AT, OTHER_AT = "127.0.1.200", "127.0.1.4"
IS_LONG = "ATTACK_BODIES" in os.environ
pytestmark = () if IS_LONG else pytest.mark.slow
BODIES = int(os.environ.get("ATTACK_BODIES", "12"))
NUM_HOURS = 6 if IS_LONG else 3
"""Each of them wants to be measured; a page measures fewer at once."""
VISITORS = int(os.environ.get("ATTACKED_VISITORS", "0"))
SYSTEMS = ["gan/5", "asynfusion/lcm-async"]
PAGES = 6
"""Of who attacks the visitors, each with an upload of its own."""
MOST_GROWTH = 1.5
"""Of the time from a visitor's click to the last file, attacked and not."""
FILES_OF_BODY = 900
LONGEST = 108_000
"""Frames of an hour."""


def say(line: str) -> None:
    print(line, flush=True)  # noqa: T201


@pytest.fixture(scope="module")
def page(weights: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    with server(tmp_path_factory.mktemp("attacked"), weights=weights) as page:
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


def test_tiny_files_hold_nobody_up_and_are_not_kept(page: Server, motion: bytes) -> None:
    with Visitor(page.address, OTHER) as visitor:
        statuses = send_tiny_files(page.address, BODIES, FILES_OF_BODY, ATTACKER_AT)
        for k in range(10):
            visitor.upload(f"after {k}.npz", motion)
    say(f"statuses of {BODIES} bodies of {FILES_OF_BODY} tiny files: {sorted(set(statuses))}")
    assert len(page.left()) < 100


def test_hours_of_nothing_do_not_hold_up_another_tab_of_the_same_address(
    page: Server, motion: bytes
) -> None:
    with Visitor(page.address, LAB) as tab:
        form = {"motions": [tab.upload("short.npz", motion)], "has_videos": False}
        with HoursOfNothing(page.address, LAB, an_hour_of_nothing(), NUM_HOURS) as hours:
            time.sleep(2)  # the first of them is at work
            assert tab.run("own_motion", **form)
            assert hours.num_done == 0


def test_sockets_that_trickle_lose_their_places(trickling: TricklingSockets) -> None:
    until = time.monotonic() + 60
    while trickling.num_open and time.monotonic() < until:
        time.sleep(0.5)
    assert trickling.num_open == 0


def crowd(page: Server, count: int, speech: bytes) -> list[float]:
    """How many seconds each of so many visitors waits, who all come at once."""
    waits: list[float] = []
    together = threading.Barrier(count)

    def come(number: int) -> None:
        with Visitor(page.address, number) as visitor:
            upload = visitor.upload("speech.wav", speech)
            together.wait()
            begun = time.monotonic()
            while True:
                try:
                    assert visitor.run("generate", speech=upload, systems=SYSTEMS)
                    break
                except Refused as refused:
                    assert "runs waiting" in str(refused), refused
                    time.sleep(1.0)  # and asks again
            waits.append(time.monotonic() - begun)

    threads = [threading.Thread(target=come, args=(number,)) for number in range(count)]
    for each in threads:
        each.start()
    for each in threads:
        each.join()
    return waits


@pytest.mark.skipif(not VISITORS, reason="ATTACKED_VISITORS=20, or make soak, lets them come")
def test_others_wait_at_most_half_as_long_again(tmp_path: Path) -> None:
    write_wav(tmp_path / "a.wav", made_waveform(32_000))
    speech = (tmp_path / "a.wav").read_bytes()
    with server(tmp_path) as page:
        crowd(page, 1, speech)  # what is read at the first run is read
        alone = crowd(page, VISITORS, speech)
        with HoursOfNothing(page.address, 199, an_hour_of_nothing(), PAGES, again=True):
            time.sleep(5)  # the first of them is at work
            attacked = crowd(page, VISITORS, speech)
    for name, waits in (("alone", alone), ("attacked", attacked)):
        say(
            f"{VISITORS} visitors, {name}: {statistics.mean(waits):.0f} s, {max(waits):.0f} at most"
        )
    assert len(alone) == len(attacked) == VISITORS
    assert statistics.mean(attacked) <= MOST_GROWTH * statistics.mean(alone)
