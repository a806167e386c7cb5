"""What visitors leave: bounded, and gone when promised."""

import itertools
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
from gradio.route_utils import GradioUploadFile

from app import text
from app.config import AppConfig
from app.errors import RunError
from app.page.launch import launch
from app.page.queue.jobs import JobBook
from app.page.visitors.uploads import MAX_FILES
from app.page.visitors.visitor_files import LEAST_BYTES, VisitorFiles, claim_folder, size_of
from tests.helpers import ROOT
from tests.soak.attacks import tiny_files

KEEP_S = 1000.0
NUMBERS = itertools.count(10)
"""Of addresses: what one of them sends counts for no other."""


def left(folder: Path) -> list[str]:
    """All files below a folder."""
    return sorted(str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file())


def write(path: Path, num_bytes: int = 10, age_s: float = 0.0) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"x" * num_bytes)
    for touched in (path, path.parent):
        os.utime(touched, (time.time() - age_s,) * 2)
    return path


def test_what_is_old_goes_and_what_is_in_use_stays(tmp_path: Path) -> None:
    visitor_files = VisitorFiles(AppConfig(temp=tmp_path, keep_results_s=KEEP_S))
    write(tmp_path / "gradio" / "aa" / "old.mp4", age_s=2 * KEEP_S)
    write(tmp_path / "gradio" / "tmpaborted", age_s=2 * KEEP_S)
    touched = write(tmp_path / "gradio" / "bb" / "waiting.wav", age_s=2 * KEEP_S)
    write(tmp_path / "gradio" / "cc" / "new.wav")
    write(tmp_path / "jobs" / "ended" / "a.mp4", age_s=2 * KEEP_S)
    running = write(tmp_path / "jobs" / "running" / "a.mp4", age_s=2 * KEEP_S)
    visitor_files.touch(visitor_files.uploads_of([None, 3, "/etc/passwd", [str(touched)]]))
    visitor_files.sweep(in_use=[running.parent])
    assert left(tmp_path) == ["gradio/bb/waiting.wav", "gradio/cc/new.wav", "jobs/running/a.mp4"]


def test_an_upload_stays_for_as_long_as_its_run_waits_or_goes_on(tmp_path: Path) -> None:
    visitor_files = VisitorFiles(AppConfig(temp=tmp_path, keep_results_s=KEEP_S))
    jobs = JobBook(tmp_path / "jobs", visitor_files=visitor_files)
    upload = write(tmp_path / "gradio" / "aa" / "waiting.wav")
    job = jobs.open("visitor", "generate", uses=["a form", str(upload)])
    write(upload, age_s=2 * KEEP_S)  # while others' runs go on
    visitor_files.sweep(jobs.in_use())
    assert upload.exists() and job.folder.exists()
    jobs.close(job)
    visitor_files.sweep(jobs.in_use())
    assert upload.exists()
    write(upload, age_s=2 * KEEP_S)
    visitor_files.sweep(jobs.in_use())
    assert not upload.exists()


def test_there_is_a_bound_for_each_address_and_for_all(tmp_path: Path) -> None:
    config = AppConfig(
        temp=tmp_path, max_kept_bytes=100_000, max_kept_bytes_each=60_000, min_free_bytes=0
    )
    visitor_files = VisitorFiles(config)
    visitor_files.charge("one", 55_000)
    visitor_files.admit("one", 5_000)
    visitor_files.admit("two", 45_000)
    with pytest.raises(RunError, match="From your address"):
        visitor_files.admit("one", 5_001)
    with pytest.raises(RunError, match="no room"):
        visitor_files.admit("two", 45_001)
    write(tmp_path / "jobs" / "a" / "b", 99_000)
    visitor_files.sweep()  # what is charged and not there is forgotten, what is there is found
    with pytest.raises(RunError, match="no room"):
        visitor_files.admit("two", 1_001)
    visitor_files.admit("two", 1_000)
    os.utime(tmp_path / "jobs" / "a", (0, 0))
    visitor_files.sweep()
    visitor_files.admit("two", 1_001)
    full = VisitorFiles(AppConfig(temp=tmp_path, min_free_bytes=10**18))
    with pytest.raises(RunError, match="no room"):
        full.admit("anyone")


def test_a_tiny_file_counts_as_what_it_takes_of_the_disk(tmp_path: Path) -> None:
    config = AppConfig(
        temp=tmp_path, max_kept_bytes=20 * 4096, max_kept_bytes_each=10 * 4096, min_free_bytes=0
    )
    visitor_files = VisitorFiles(config)
    visitor_files.charge("one", 0, num_files=9)
    visitor_files.admit("one", num_files=1)
    with pytest.raises(RunError, match="From your address"):
        visitor_files.admit("one", num_files=2)
    for number in range(20):
        write(tmp_path / "gradio" / str(number) / "a", 1)
    assert size_of(tmp_path) == 20 * 4096
    visitor_files.count()
    with pytest.raises(RunError, match="no room"):
        visitor_files.admit("two", num_files=1)


def test_files_are_bounded_by_number_too_for_each_address_and_for_all(tmp_path: Path) -> None:
    config = AppConfig(temp=tmp_path, max_kept_files=7, max_kept_files_each=5, min_free_bytes=0)
    visitor_files = VisitorFiles(config)
    visitor_files.charge("one", 0, num_files=5)
    with pytest.raises(RunError, match="From your address 5 files came within 60 minutes"):
        visitor_files.admit("one", num_files=1)
    visitor_files.admit("two", num_files=2)
    visitor_files.charge("two", 0, num_files=2)
    with pytest.raises(RunError, match="no room"):
        visitor_files.admit("three", num_files=1)


def test_whether_there_is_room_is_answered_without_a_look_at_the_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    visitor_files = VisitorFiles(AppConfig(temp=tmp_path, min_free_bytes=0, max_kept_files=3))
    for number in range(3):
        write(tmp_path / "gradio" / str(number) / "a", 1)
    visitor_files.sweep()

    def never(*_: object) -> None:
        raise AssertionError("visitors wait while the folder is looked at")

    for name in ("walk", "scandir", "listdir"):
        monkeypatch.setattr(os, name, never)
    visitor_files.admit("one", 100)
    with pytest.raises(RunError, match="no room"):
        visitor_files.admit("one", 100, num_files=1)


def test_what_comes_while_the_files_are_counted_is_not_forgotten(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    visitor_files = VisitorFiles(AppConfig(temp=tmp_path, min_free_bytes=0, max_kept_bytes=100_000))
    visitor_files.charge("one", 60_000)
    look = os.scandir

    def scandir(folder: Any) -> Any:
        with pytest.raises(RunError, match="no room"):  # what came before still counts
            visitor_files.admit("two", 50_000)
        visitor_files.charge("two", 30_000)
        return look(folder)

    monkeypatch.setattr(os, "scandir", scandir)
    visitor_files.count()
    monkeypatch.undo()
    with pytest.raises(RunError, match="no room"):
        visitor_files.admit("three", 80_000)


def test_what_an_address_has_left_is_forgotten_in_time_and_kept_small(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = time.time()
    monkeypatch.setattr(time, "time", lambda: now)
    visitor_files = VisitorFiles(
        AppConfig(temp=tmp_path, keep_results_s=60, max_kept_files_each=1000)
    )
    for _ in range(1000):
        visitor_files.charge("one", 10, num_files=1)
        now += 0.05
    assert len(visitor_files._left["one"]._spans) < 61
    with pytest.raises(RunError, match="From your address"):
        visitor_files.admit("one", num_files=1)
    now += 40
    visitor_files.admit("one", num_files=400)
    now += 60
    visitor_files.sweep()
    assert not visitor_files._left


HOLD = """
import sys, time
from pathlib import Path
from app.page.visitors.visitor_files import claim_folder
folder = claim_folder(Path(sys.argv[1]))
(folder / "upload").write_text("a voice")
print(folder, flush=True)
time.sleep(60)
"""


def test_what_a_killed_process_left_is_removed_by_the_next_and_not_before(tmp_path: Path) -> None:
    parent = tmp_path / "temp"
    write(parent / "jobs" / "of an earlier release")
    child = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(parent)], cwd=ROOT, stdout=subprocess.PIPE, text=True
    )
    assert child.stdout is not None
    theirs = Path(child.stdout.readline().strip())
    mine = claim_folder(parent)
    assert (theirs / "upload").exists() and mine.parent == parent
    assert not (parent / "jobs").exists()
    child.send_signal(signal.SIGKILL)
    child.wait()
    claim_folder(parent)
    assert not theirs.exists() and mine.exists()


@pytest.fixture(scope="module")
def temp(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("page")


@pytest.fixture(scope="module")
def address(weights: Path, temp: Path) -> Iterator[str]:
    config = AppConfig(
        port=0,
        weights=weights,
        temp=temp,
        keep_results_s=4,
        max_kept_bytes_each=60 * 10**6,
        max_kept_files_each=MAX_FILES + 50,
    )
    page = launch(config, is_warmed_up=False)
    assert page.local_url is not None
    yield page.local_url
    page.close()


@contextmanager
def new_address(page: str) -> Iterator[httpx.Client]:
    """A client of an address that has sent nothing yet."""
    transport = httpx.HTTPTransport(local_address=f"127.0.2.{next(NUMBERS)}")
    with httpx.Client(base_url=page, timeout=20, transport=transport) as client:
        yield client


@pytest.fixture
def client(address: str) -> Iterator[httpx.Client]:
    with new_address(address) as client:
        yield client


def test_an_upload_is_served_and_then_gone(client: httpx.Client, temp: Path) -> None:
    path = client.post("gradio_api/upload", files={"files": ("a.wav", b"sound")}).json()[0]
    assert client.get(f"gradio_api/file={path}").text == "sound"
    until = time.monotonic() + 12
    while left(temp / "gradio") and time.monotonic() < until:
        time.sleep(0.2)
    assert left(temp / "gradio") == []
    assert client.get(f"gradio_api/file={path}").status_code in (403, 404)


def parts(num_bytes: int, stops: bool) -> Iterator[bytes]:
    yield (
        b'--b\r\nContent-Disposition: form-data; name="files"; filename="a.wav"\r\n'
        b"Content-Type: audio/wav\r\n\r\n"
    )
    for _ in range(num_bytes // 10**6):
        yield b"x" * 10**6
    if stops:
        raise ConnectionError("the visitor has gone")
    yield b"\r\n--b--\r\n"


def upload(client: httpx.Client, num_bytes: int, stops: bool = False) -> httpx.Response:
    return client.post(
        "gradio_api/upload",
        content=parts(num_bytes, stops),
        headers={"Content-Type": "multipart/form-data; boundary=b"},
    )


def test_an_upload_that_is_broken_off_leaves_nothing(client: httpx.Client, temp: Path) -> None:
    with pytest.raises(ConnectionError):
        upload(client, 20 * 10**6, stops=True)
    until = time.monotonic() + 3
    while left(temp / "gradio") and time.monotonic() < until:
        time.sleep(0.05)
    assert left(temp / "gradio") == []


def test_too_much_of_one_address_is_refused_in_a_sentence_and_heals(
    client: httpx.Client, temp: Path
) -> None:
    first, second = upload(client, 40 * 10**6), upload(client, 40 * 10**6)
    assert (first.status_code, second.status_code) == (200, 507)
    assert "From your address" in second.text
    assert sum(path.stat().st_size for path in temp.rglob("*") if path.is_file()) < 41 * 10**6
    until = time.monotonic() + 20
    while upload(client, 10**6).status_code != 200 and time.monotonic() < until:
        time.sleep(0.5)
    assert upload(client, 10**6).status_code == 200


def tiny(client: httpx.Client, count: int) -> httpx.Response:
    body, boundary = tiny_files(count)
    headers = {"Content-Type": f"multipart/form-data; boundary={boundary}"}
    return client.post("gradio_api/upload", content=body, headers=headers)


def test_many_tiny_files_are_refused_by_their_number_and_leave_nothing(
    client: httpx.Client, address: str, temp: Path
) -> None:
    def is_refused(client: httpx.Client, count: int, status: int, sentence: str) -> None:
        before = set(left(temp / "gradio"))
        answer = tiny(client, count)
        assert answer.status_code == status and sentence in answer.text
        assert set(left(temp / "gradio")) <= before

    is_refused(client, MAX_FILES + 1, 413, f"At most {MAX_FILES} files")
    is_refused(client, 51, 507, "From your address 300 files came")  # they counted nevertheless
    with new_address(address) as other:
        assert len(tiny(other, MAX_FILES).json()) == MAX_FILES
        is_refused(other, 51, 507, "From your address 300 files came")
    assert client.get("config").status_code == 200


@pytest.mark.parametrize("path", ["component_server", "component_server/", "process_recording"])
def test_what_takes_files_uncounted_is_closed(client: httpx.Client, path: str) -> None:
    answer = client.post(f"gradio_api/{path}", files={"video": ("a.wav", b"sound")})
    assert answer.status_code == 404 and "fields of its forms" in answer.text


def test_a_long_field_that_is_no_file_is_refused(client: httpx.Client) -> None:
    answer = client.post("gradio_api/upload", data={"a": "x" * 70_000}, files={"files": b"sound"})
    assert answer.status_code == 400 and "may have 65536 bytes" in answer.text


def test_a_full_disk_is_said_and_leaves_nothing(
    client: httpx.Client, temp: Path, monkeypatch: pytest.MonkeyPatch
) -> None:

    async def full(self: object, data: bytes) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(GradioUploadFile, "write", full)
    answer = upload(client, 10**6)
    assert answer.status_code == 400 and answer.text == text.DISK_FULL
    monkeypatch.undo()
    assert [name for name in left(temp / "gradio") if "tmp" in name] == []
    assert upload(client, 10**6).status_code == 200


def test_a_folder_that_goes_while_it_is_measured_is_passed_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a" / "b").mkdir(parents=True)
    (tmp_path / "a" / "b" / "gone").write_bytes(b"12345")
    (tmp_path / "stays").write_bytes(b"123")
    look = os.scandir

    def scandir(folder: Any) -> Any:
        if str(folder) == str(tmp_path / "a"):
            shutil.rmtree(folder)
        return look(folder)

    monkeypatch.setattr(os, "scandir", scandir)
    assert size_of(tmp_path) == LEAST_BYTES
