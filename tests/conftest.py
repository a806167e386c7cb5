"""Settings of every test, and what several files need but nobody changes: made once a run."""

import gc
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

from tests.shapes import begin_test  # isort: skip  (before what it checks)

import pytest
import torch
from filelock import FileLock
from threadpoolctl import threadpool_limits

from model.speech.audio import write_wav
from tests.model.made import made_waveform, make_data_folder, make_weights
from tests.model.systems.planned.made import make_annotated_folder, make_planned_weights

# Of this process and of all that it starts, workers of pytest-xdist among them: threads of several
# that wait for each other on the same cores make small matrices many times slower.
os.environ |= dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "LP_NUM_THREADS"), "1")
threadpool_limits(1, user_api="blas")
torch.set_num_threads(1)  # before fixtures of a whole run, too
# Ports of its own for each worker: Gradio looks for a free one and binds it later, so that two
# processes that look in one range can find the same.
_worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
os.environ["GRADIO_SERVER_PORT"] = str(7860 + 100 * _worker)
# A torch for GPUs brings Triton, whose LLVM ends a process that has drawn by Mesa's in a
# segmentation fault as soon as it is imported, as every optimizer of torch does.
sys.modules["triton"] = None

MadeOnce = Callable[[str, Callable[[Path], object]], Path]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files of the browser first: they wait much, and the others fill the cores beside them."""
    items.sort(key=lambda item: "browser" not in item.path.parts)


def pytest_configure() -> None:
    """What is imported is not garbage, and need not be gone through for it again and again: a fifth
    of the time that it takes."""
    gc.disable()


def pytest_collection_finish() -> None:
    gc.collect()
    gc.freeze()
    gc.enable()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """What the app calls is checked where it is tested itself."""
    begin_test(is_checked=not item.nodeid.startswith(("tests/app/", "tests/browser/")))


@pytest.fixture(autouse=True)
def _fixed_seed_and_one_thread() -> Iterator[None]:
    """Tests repeat exactly and do not fight over cores."""
    torch.manual_seed(0)
    torch.set_num_threads(1)
    yield


def _state(folder: Path) -> list[tuple[str, int, int]]:
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return [(str(path), path.stat().st_size, path.stat().st_mtime_ns) for path in files]


@pytest.fixture(scope="session")
def made_once(tmp_path_factory: pytest.TempPathFactory) -> Iterator[MadeOnce]:
    """``made_once(name, make)``: the folder that ``make(folder)`` fills, for the first worker of
    this run that asks; the others wait and read it. Whoever writes into it fails the suite."""
    root = tmp_path_factory.getbasetemp()
    shared = (root.parent if "PYTEST_XDIST_WORKER" in os.environ else root) / "made-once"
    shared.mkdir(exist_ok=True)
    states: dict[Path, list[tuple[str, int, int]]] = {}

    def get(name: str, make: Callable[[Path], object]) -> Path:
        folder = shared / name
        with FileLock(shared / f"{name}.lock"):
            if not folder.is_dir():
                begun = shared / f"{name}.begun"
                shutil.rmtree(begun, ignore_errors=True)
                begun.mkdir()
                make(begun)
                begun.rename(folder)
        states.setdefault(folder, _state(folder))
        return folder

    yield get
    for folder, state in states.items():
        assert _state(folder) == state, f"a test has changed {folder}, which others read"


@pytest.fixture(scope="session")
def weights(made_once: MadeOnce) -> Path:
    """globaldiff/local, globaldiff/global and the face: real config classes, tiny and random."""
    return made_once("weights", make_weights)


@pytest.fixture(scope="session")
def planned_weights(made_once: MadeOnce) -> Path:
    """A planner, what performs its plans, and the face: tiny, random."""
    return made_once("planned-weights", make_planned_weights)


@pytest.fixture(scope="session")
def all_weights(made_once: MadeOnce) -> Path:
    """Systems that perform plans and systems that do not."""
    return made_once("all-weights", lambda folder: make_planned_weights(make_weights(folder)))


@pytest.fixture(scope="session")
def data_folder(made_once: MadeOnce) -> Path:
    """BEAT2's layout with four clips of four seconds (`make_data_folder`)."""
    return made_once("data", make_data_folder)


@pytest.fixture(scope="session")
def annotated_folder(made_once: MadeOnce) -> Path:
    """The same with the plan of three seconds beside each clip."""
    return made_once("annotated", make_annotated_folder)


@pytest.fixture(scope="session")
def speech(made_once: MadeOnce) -> Path:
    """A second and a bit of something that is not silence: 37 frames."""
    folder = made_once(
        "speech",
        lambda folder: write_wav(folder / "speech.wav", made_waveform(round(16_000 * 37 / 30))),
    )
    return folder / "speech.wav"
