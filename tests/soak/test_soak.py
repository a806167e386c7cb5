"""Four visitors in a loop for long: memory stays, temporary files are bounded, and an hour after
nothing is left. ``SOAK_SECONDS=1800`` is the whole of it (`make soak`)."""

import itertools
import os
import random
import threading
import time
from collections import Counter
from pathlib import Path

import pytest

from model.motion.motion import save_motion
from model.speech.audio import write_wav
from tests.helpers import smooth_motion_example
from tests.model.made import made_waveform
from tests.soak.server import Server, server
from tests.soak.visitor import Refused, Visitor

SECONDS = float(os.environ.get("SOAK_SECONDS", "0"))
VISITORS = 4
SYSTEMS = ["gan/5", "asynfusion/lcm-async"]
MOST_GROWTH = 1.1
"""Of memory, from the first sixth to the end."""
MOST_LEFT = 2.0
"""Of temporary files, against the most of the first sixth, which is as long as they are kept."""
SWEPT_S = 90.0
"""A sweep comes once a minute."""

if not SECONDS:
    pytest.skip(
        "a soak takes long; SOAK_SECONDS=1800, or make soak, does it", allow_module_level=True
    )


class Watch:
    """Looks once a second at what the server takes, until it is left."""

    def __init__(self, page: Server) -> None:
        self._page = page
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._look, daemon=True)
        self.memory = self.left = 0
        """The most, in bytes."""

    def __enter__(self) -> "Watch":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def _look(self) -> None:
        while not self._over.wait(1.0):
            self.memory = max(self.memory, self._page.memory())
            self.left = max(self.left, self._page.left_bytes())


class Crowd:
    """Visitors that come again and again, and what became of them."""

    def __init__(self, page: Server, folder: Path) -> None:
        self._page = page
        write_wav(folder / "a.wav", made_waveform(32_000))
        save_motion(smooth_motion_example(45), folder / "a.npz")
        self._speech = (folder / "a.wav").read_bytes()
        self._motion = (folder / "a.npz").read_bytes()
        self._sound = (30_000 * made_waveform(16_000 * 4)).astype("<i2").tobytes()
        self.done: Counter[str] = Counter()
        self.last: list[str] = []
        """Addresses of the files of the last run."""
        self._errors: list[BaseException] = []

    def come(self, seconds: float) -> None:
        """All visitors in a loop for so long, and until each has done everything once; returns
        when the last has ended what it does."""
        until = time.monotonic() + seconds
        crowd = [
            threading.Thread(target=self._visit, args=(number, until)) for number in range(VISITORS)
        ]
        for each in crowd:
            each.start()
        for each in crowd:
            each.join()
        if self._errors:
            raise self._errors[0]

    def _visit(self, number: int, until: float) -> None:
        chance = random.Random(f"{number} {sum(self.done.values())}")
        acts = [self._generate, self._diagnose, self._speak, self._leave]
        try:
            for count, act in enumerate(itertools.islice(itertools.cycle(acts), number, None)):
                if count >= len(acts) and time.monotonic() > until:
                    return
                with Visitor(self._page.address, number) as visitor:
                    act(visitor, chance)
                self.done[act.__name__.strip("_")] += 1
        except BaseException as error:
            self._errors.append(error)

    def _generate(self, visitor: Visitor, chance: random.Random) -> None:
        speech = visitor.upload("speech.wav", self._speech)
        seed = chance.randrange(1000)
        found = visitor.run("generate", speech=speech, systems=SYSTEMS, seed=seed)
        assert sum(address.startswith("media/") for address in found) >= len(SYSTEMS)
        self.last = found

    def _diagnose(self, visitor: Visitor, chance: random.Random) -> None:
        motions = [visitor.upload(f"{letter}.npz", self._motion) for letter in "ab"]
        drawn = chance.random() < 0.25
        assert visitor.run("own_motion", motions=motions, has_video=drawn)

    def _speak(self, visitor: Visitor, chance: random.Random) -> None:
        try:
            assert visitor.speak(self._sound) > 0
        except Refused:  # with drawing beside it, a machine may be too slow for live speech
            self.done["speak in vain"] += 1

    def _leave(self, visitor: Visitor, chance: random.Random) -> None:
        speech = visitor.upload("speech.wav", self._speech)
        visitor.run("generate", chance.randrange(1, 20), speech=speech, systems=SYSTEMS)
        visitor.speak(self._sound[:64_000], leaves=True)


def test_a_soak(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    hour = SECONDS / 6
    with server(tmp_path, keep_s=hour) as page:
        crowd = Crowd(page, tmp_path)
        with Watch(page) as early:
            crowd.come(hour)
        before = at_rest(page)
        with Watch(page) as late:
            crowd.come(SECONDS - hour)
        after = at_rest(page)
        with capsys.disabled():
            print(f"\n{dict(crowd.done)}")  # noqa: T201
            for name, one, other in (
                ("MB of memory at rest", before[0] / 1e6, after[0] / 1e6),
                ("files that the server holds open", before[1], after[1]),
                ("MB of memory at most", early.memory / 1e6, late.memory / 1e6),
                ("MB of temporary files at most", early.left / 1e6, late.left / 1e6),
            ):
                print(f"{name}: {one:.0f} after {hour:.0f} s, {other:.0f} at the end")  # noqa: T201
        assert after[0] <= MOST_GROWTH * before[0]
        assert late.left <= MOST_LEFT * early.left
        with Visitor(page.address, 0) as visitor:
            assert visitor.is_there(crowd.last[0])
            page.put_clock_forward()
            until = time.monotonic() + SWEPT_S
            while page.left() and time.monotonic() < until:
                time.sleep(1)
            assert page.left() == []
            assert not any(visitor.is_there(address) for address in crowd.last)


def at_rest(page: Server) -> tuple[int, int]:
    """Memory and open files once nobody asks for anything and nothing changes: after a cancelled
    run, a new process reads the models."""
    seen = [0, page.memory()]
    until = time.monotonic() + SWEPT_S
    while max(seen[-3:]) > 1.01 * min(seen[-3:]) and time.monotonic() < until:
        time.sleep(5)
        seen.append(page.memory())
    return seen[-1], page.open_files()
