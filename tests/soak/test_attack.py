"""Visitors at once while another attacks with hours of nothing: how much longer they wait.
``ATTACKED_VISITORS=20`` does it (`make soak`)."""

import os
import statistics
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from model.speech.audio import write_wav
from tests.app.page.queue.test_run_processes import LONGEST, zeros
from tests.model.made import made_waveform
from tests.soak.server import Server, server
from tests.soak.visitor import Refused, Visitor

VISITORS = int(os.environ.get("ATTACKED_VISITORS", "0"))
PAGES = 6
"""Of the attacker, each with an upload of its own."""
SYSTEMS = ["gan/5", "asynfusion/lcm-async"]
MOST_GROWTH = 1.5
"""Of the time from a visitor's click to the last file, attacked and not."""

if not VISITORS:
    pytest.skip(
        "twenty visitors take minutes; ATTACKED_VISITORS=20, or make soak, lets them come",
        allow_module_level=True,
    )


def test_others_wait_at_most_half_as_long_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_wav(tmp_path / "a.wav", made_waveform(32_000))
    speech = (tmp_path / "a.wav").read_bytes()
    hour = zeros(tmp_path / "hour.npz", LONGEST).read_bytes()
    with server(tmp_path) as page:
        crowd(page, 1, speech)  # what is read at the first run is read
        alone = crowd(page, VISITORS, speech)
        over = threading.Event()
        pages = [start(attack, page, hour, number, over) for number in range(PAGES)]
        time.sleep(5)  # the first of them is at work
        attacked = crowd(page, VISITORS, speech)
        over.set()
        for each in pages:
            each.join()
    grown = statistics.mean(attacked) / statistics.mean(alone)
    with capsys.disabled():
        for name, waits in (("alone", alone), ("attacked", attacked)):
            print(  # noqa: T201
                f"\n{VISITORS} visitors, {name}: {statistics.mean(waits):.0f} s on average, "
                f"{max(waits):.0f} s at most",
                end="",
            )
        print(f"; {grown:.2f} times as long")  # noqa: T201
    assert len(alone) == len(attacked) == VISITORS
    assert grown <= MOST_GROWTH


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

    for each in [start(come, number) for number in range(count)]:
        each.join()
    return waits


def attack(page: Server, hour: bytes, number: int, over: threading.Event) -> None:
    """One page of the attacker's, again and again until the others have what they came for."""
    with Visitor(page.address, 199) as visitor:
        while not over.is_set():
            motions = [visitor.upload(f"{number}.npz", hour)]
            try:
                for _ in visitor.events("own_motion", {"motions": motions}):
                    if over.is_set():
                        return
            except Refused:
                time.sleep(0.2)


def start(work: Callable[..., None], *arguments: object) -> threading.Thread:
    thread = threading.Thread(target=work, args=arguments)
    thread.start()
    return thread
