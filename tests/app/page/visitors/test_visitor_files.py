"""What visitors leave: bounded, and gone when promised."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from gradio.route_utils import GradioUploadFile

from app import text
from app.config import AppConfig
from app.errors import RunError
from app.page.queue.jobs import JobBook
from app.page.visitors.uploads import MAX_FILES
from app.page.visitors.visitor_files import VisitorFiles, claim_folder, size_of
from app.page.visitors.visitors import address_of
from tests.app.page.conftest import BOUND_BYTES, UPLOAD
from tests.app.page.made import until
from tests.helpers import ROOT
from tests.soak.attacks import tiny_files

KEEP_S = 1000.0


def left(folder: Path) -> list[str]:
    """All files below a folder."""
    return sorted(str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file())


def write(path: Path, num_bytes: int = 10, age_s: float = 0.0) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"x" * num_bytes)
    for touched in (path, path.parent):
        os.utime(touched, (time.time() - age_s,) * 2)
    return path


def files_of(folder: Path, **bounds: Any) -> VisitorFiles:
    return VisitorFiles(AppConfig(temp=folder, **{"min_free_bytes": 0, **bounds}))


def test_what_is_old_goes_and_what_is_in_use_stays(tmp_path):
    visitor_files = files_of(tmp_path, keep_results_s=KEEP_S)
    write(tmp_path / "gradio" / "aa" / "old.mp4", age_s=2 * KEEP_S)
    write(tmp_path / "gradio" / "tmpaborted", age_s=2 * KEEP_S)
    touched = write(tmp_path / "gradio" / "bb" / "waiting.wav", age_s=2 * KEEP_S)
    write(tmp_path / "gradio" / "cc" / "new.wav", age_s=KEEP_S / 2)
    write(tmp_path / "jobs" / "ended" / "a.mp4", age_s=2 * KEEP_S)
    running = write(tmp_path / "jobs" / "running" / "a.mp4", age_s=2 * KEEP_S)
    visitor_files.touch(visitor_files.uploads_of([None, 3, "/etc/passwd", [str(touched)]]))
    visitor_files.sweep(in_use=[running.parent])
    assert left(tmp_path) == ["gradio/bb/waiting.wav", "gradio/cc/new.wav", "jobs/running/a.mp4"]


def test_an_upload_stays_for_as_long_as_its_run_waits_or_goes_on(tmp_path):
    visitor_files = files_of(tmp_path, keep_results_s=KEEP_S)
    jobs = JobBook(tmp_path / "jobs", visitor_files=visitor_files)
    upload = write(tmp_path / "gradio" / "aa" / "waiting.wav")
    job = jobs.open("visitor", "generate", uses=["a form", str(upload)])
    for is_over in (False, True):
        write(upload, age_s=2 * KEEP_S)  # while others' runs go on
        visitor_files.sweep(jobs.in_use())
        assert upload.exists() != is_over and job.folder.exists()
        if not is_over:
            jobs.close(job)
            visitor_files.sweep(jobs.in_use())
            assert upload.exists()


def is_refused(visitor_files: VisitorFiles, address: str, words: str, *room: int) -> None:
    with pytest.raises(RunError, match=words):
        visitor_files.admit(address, *room)


def test_bytes_are_bounded_for_each_address_and_for_all(tmp_path):
    visitor_files = files_of(tmp_path, max_kept_bytes=100_000, max_kept_bytes_each=60_000)
    visitor_files.charge("one", 55_000)
    visitor_files.admit("one", 5_000)
    visitor_files.admit("two", 45_000)
    is_refused(visitor_files, "one", "From your address", 5_001)
    is_refused(visitor_files, "two", "no room", 45_001)
    write(tmp_path / "jobs" / "a" / "b", 99_000)
    visitor_files.sweep()  # what is charged and not there is forgotten, what is there is found
    visitor_files.admit("two", 1_000)
    is_refused(visitor_files, "two", "no room", 1_001)
    os.utime(tmp_path / "jobs" / "a", (0, 0))
    visitor_files.sweep()
    visitor_files.admit("two", 1_001)
    is_refused(files_of(tmp_path, min_free_bytes=10**18), "anyone", "no room")
    visitor_files.close()
    is_refused(visitor_files, "two", text.CLOSING)


def test_files_are_bounded_by_number_and_count_as_what_they_take_of_the_disk(tmp_path):
    visitor_files = files_of(tmp_path, max_kept_files=7, max_kept_files_each=5)
    visitor_files.charge("one", 0, num_files=5)
    is_refused(visitor_files, "one", "From your address 5 files came within 60 minutes", 0, 1)
    visitor_files.admit("two", num_files=2)
    visitor_files.charge("two", 0, num_files=2)
    is_refused(visitor_files, "three", "no room", 0, 1)

    bounds = {"max_kept_bytes": 20 * 4096, "max_kept_bytes_each": 10 * 4096}
    visitor_files = files_of(tmp_path, **bounds)
    visitor_files.charge("one", 0, num_files=9)
    visitor_files.admit("one", num_files=1)
    is_refused(visitor_files, "one", "From your address", 0, 2)
    for number in range(20):
        write(tmp_path / "gradio" / str(number) / "a", 1)
    assert size_of(tmp_path) == 20 * 4096
    visitor_files.count()
    is_refused(visitor_files, "two", "no room", 0, 1)


def test_what_comes_while_the_files_are_counted_is_not_forgotten(tmp_path, monkeypatch):
    visitor_files = files_of(tmp_path, max_kept_bytes=100_000)
    visitor_files.charge("one", 60_000)
    look = os.scandir

    def scandir(folder: Any) -> Any:
        if str(folder) == str(tmp_path):  # and not of a page that another test has left open
            is_refused(visitor_files, "two", "no room", 50_000)  # what came before still counts
            visitor_files.charge("two", 30_000)
        return look(folder)

    monkeypatch.setattr(os, "scandir", scandir)
    visitor_files.count()
    monkeypatch.undo()
    visitor_files.admit("three", 70_000)
    is_refused(visitor_files, "three", "no room", 70_001)


def test_what_an_address_has_left_is_forgotten_in_time_and_kept_small(tmp_path, monkeypatch):
    now = time.time()
    monkeypatch.setattr(time, "time", lambda: now)
    visitor_files = files_of(tmp_path, keep_results_s=60, max_kept_files_each=1000)
    for _ in range(1000):
        visitor_files.charge("one", 10, num_files=1)
        now += 0.05
    assert len(visitor_files._left["one"]._spans) < 61
    is_refused(visitor_files, "one", "From your address", 0, 1)
    now += 40
    visitor_files.admit("one", num_files=400)
    now += 60
    visitor_files.sweep()
    assert not visitor_files._left


HOLD = """
import signal, sys
from pathlib import Path
from app.page.visitors.visitor_files import claim_folder
folder = claim_folder(Path(sys.argv[1]))
(folder / "upload").write_text("a voice")
print(folder, flush=True)
signal.pause()
"""


def test_what_a_killed_process_left_is_removed_by_the_next_and_not_before(tmp_path):
    parent = tmp_path / "temp"
    write(parent / "jobs" / "of an earlier release")
    child = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(parent)], cwd=ROOT, stdout=subprocess.PIPE, text=True
    )
    assert child.stdout is not None
    theirs = Path(child.stdout.readline().strip())
    mine = claim_folder(parent)
    assert (theirs / "upload").exists() and mine.parent == parent
    assert mine.stat().st_mode & 0o777 == parent.stat().st_mode & 0o777 == 0o700
    assert not (parent / "jobs").exists()
    child.send_signal(signal.SIGKILL)
    child.communicate()
    claim_folder(parent)
    assert not theirs.exists() and mine.exists()


@pytest.mark.parametrize(
    ("host", "address"),
    [
        ("192.168.1.7", "192.168.1.7"),
        ("::ffff:192.168.1.7", "192.168.1.7"),
        ("2001:db8:1:2:aaaa::1", "2001:db8:1:2::/64"),
        ("2001:db8:1:3::1", "2001:db8:1:3::/64"),
        ("a socket", "a socket"),
        (None, ""),
    ],
)
def test_who_has_a_network_is_one_address_and_within_the_program_there_is_none(host, address):
    client = None if host is None else SimpleNamespace(host=host)
    assert address_of(SimpleNamespace(client=client)) == address  # type: ignore[arg-type]


# On the real page, each test from an address of its own.


def multipart(content: bytes) -> bytes:
    head = b'--b\r\nContent-Disposition: form-data; name="files"; filename="a.wav"\r\n\r\n'
    return head + content


def test_an_upload_is_served_and_gone_once_it_is_old(served):
    visitor = served.visitor()
    path = Path(visitor.post("/gradio_api/upload", files=UPLOAD).json()[0])
    assert visitor.get(f"/gradio_api/file={path}").text == "sound"
    for touched in (path, path.parent):
        os.utime(touched, (0, 0))
    until(lambda: not path.exists())
    assert visitor.get(f"/gradio_api/file={path}").status_code in (403, 404)


def test_an_upload_that_is_broken_off_or_finds_no_room_leaves_nothing(served):
    before = served.uploads()
    served.sent("10.1.0.1", multipart(bytes(10**6)), "b", {"type": "http.disconnect"})
    assert served.uploads() == before
    ended = {"type": "http.request", "body": b"\r\n--b--\r\n"}
    start, body = served.sent("10.1.0.2", multipart(bytes(BOUND_BYTES)), "b", ended)
    assert start["status"] == 507 and b"From your address" in body["body"]
    assert served.uploads() == before
    start, _ = served.sent("10.1.0.2", multipart(b"x"), "b", ended)
    assert start["status"] == 507, "what came and was refused counts, too"
    start, _ = served.sent("10.1.0.3", multipart(b"x"), "b", ended)
    assert start["status"] == 200 and len(served.uploads() - before) == 1
    visitor, half = served.visitor(), {"files": ("a.wav", bytes(BOUND_BYTES // 2))}
    assert visitor.post("/gradio_api/upload", files=half).status_code == 200
    answer = visitor.post("/gradio_api/upload", files=half)  # which says how long it is
    assert answer.status_code == 507 and "From your address" in answer.text
    assert len(served.uploads() - before) == 2


def test_many_tiny_files_are_refused_by_their_number_and_leave_nothing(served):
    one, other = served.visitor(), served.visitor()

    def answers(visitor: Any, count: int, status: int, sentence: str) -> None:
        before = served.uploads()
        body, boundary = tiny_files(count)
        headers = {"Content-Type": f"multipart/form-data; boundary={boundary}"}
        answer = visitor.post("/gradio_api/upload", content=body, headers=headers)
        assert answer.status_code == status and sentence in answer.text
        assert status == 200 or served.uploads() == before

    answers(one, MAX_FILES + 1, 413, f"At most {MAX_FILES} files")
    answers(one, 51, 507, "From your address 300 files came")  # they counted nevertheless
    answers(other, MAX_FILES, 200, "")
    answers(other, 51, 507, "From your address 300 files came")
    assert one.get("/config").status_code == 200


def test_a_long_field_that_is_no_file_is_refused(served):
    for length, status in ((65_536, 200), (65_537, 400)):
        form = {"data": {"a": "x" * length}, "files": {"files": ("a.wav", b"sound")}}
        answer = served.visitor().post("/gradio_api/upload", **form)
        assert answer.status_code == status
    assert "may have 65536 bytes" in answer.text


def test_a_full_disk_is_said_and_leaves_nothing(served, monkeypatch):
    async def full(self: object, data: bytes) -> None:
        raise OSError(28, "No space left on device")

    before = served.uploads()
    monkeypatch.setattr(GradioUploadFile, "write", full)
    answer = served.visitor().post("/gradio_api/upload", files=UPLOAD)
    assert answer.status_code == 400 and answer.text == text.DISK_FULL
    assert served.uploads() == before
