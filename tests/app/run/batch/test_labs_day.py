"""A lab's day: many clips, two systems, no videos, over Dask workers of this machine, one of which
is killed on the way; the result is that of one process. ``LAB_CLIPS=200`` is the whole day."""

import os
import signal
import threading
from pathlib import Path

import numpy as np
import pytest

from app.run.batch.speech_batch import clip_requests, run_batch
from app.run.output.run_folder import RUN, read_run
from app.run.requests.requests import AnyRun
from model.speech.audio import write_wav
from processes.pool import JobPool
from tests.app.requests import generate_request
from tests.model.made import made_waveform
from tests.waiting import wait_for

pytest.importorskip("distributed", reason="Dask is not installed (requirements-cluster.txt)")

from tests.processes.test_cluster import scheduler, workers

pytestmark = pytest.mark.slow

CLIPS = int(os.environ.get("LAB_CLIPS", "6"))
SECONDS = 10 if CLIPS > 20 else 2
WORKERS = 4 if CLIPS > 20 else 2
SYSTEMS = ("gan/5", "asynfusion/lcm-async")


def test_a_labs_day(tmp_path: Path) -> None:
    speech = tmp_path / "speech"
    speech.mkdir()
    for number in range(CLIPS):
        write_wav(speech / f"clip{number:03}.wav", made_waveform(16_000 * SECONDS, number))

    def asked(out: Path) -> AnyRun:
        return generate_request(speech=speech, out=out, systems=SYSTEMS, has_figures=False)

    apart, here = tmp_path / "cluster", tmp_path / "here"
    told: list[str] = []
    with scheduler(tmp_path) as (_, file), workers(file, WORKERS) as (struck, *_):

        def strike() -> None:
            wait_for(lambda: list(apart.glob(f"*/{RUN}")))
            os.kill(struck.pid, signal.SIGKILL)

        threading.Thread(target=strike, daemon=True).start()
        runs = run_batch(
            clip_requests(asked(apart)),
            JobPool(scheduler=file),
            lambda path, share: told.append(path.name),
        )
        assert struck.wait(10) == -signal.SIGKILL
    clips = [f"clip{number:03}" for number in range(CLIPS)]
    assert list(runs.finished_clips) == sorted(told) == clips and runs.failed == {}
    run_batch(clip_requests(asked(here)), JobPool(2 if CLIPS > 20 else 1))
    for clip in clips:
        assert names_in(apart / clip) == names_in(here / clip)
        for system in ("gan-5", "asynfusion-lcm-async"):
            one, other = (np.load(out / clip / f"{system}.npz") for out in (apart, here))
            assert set(one) == set(other)
            for key in one:
                assert np.array_equal(one[key], other[key]), (clip, system, key)
        one, other = (read_run(out / clip) for out in (apart, here))
        assert one.inputs_stamp and (one.inputs_stamp, one.metrics) == (
            other.inputs_stamp,
            other.metrics,
        )
    for table in ("batch.csv", "batch.json", "summary.md"):
        assert (apart / table).read_bytes() == (here / table).read_bytes()


def names_in(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}
