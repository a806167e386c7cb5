"""What visitors leave: within its limits, and gone when promised."""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from gradio.route_utils import GradioUploadFile
from httpx import Response
from starlette.testclient import TestClient

from app import text
from app.page.visitors import uploads
from app.page.visitors.job_folders import make_process_folder, start_sweeper, sweep
from app.page.visitors.uploads import MAX_FILES
from app.page.visitors.visitors import client_network_of
from tests.app.page.conftest import UPLOAD
from tests.helpers import ROOT
from tests.waiting import wait_for

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


def test_what_is_old_goes_and_what_is_in_use_stays(tmp_path):
    write(tmp_path / "gradio" / "aa" / "old.mp4", age_s=2 * KEEP_S)
    write(tmp_path / "gradio" / "tmpaborted", age_s=2 * KEEP_S)
    write(tmp_path / "gradio" / "cc" / "new.wav", age_s=KEEP_S / 2)
    write(tmp_path / "jobs" / "ended" / "a.mp4", age_s=2 * KEEP_S)
    write(tmp_path / "private" / "never fetched" / "key.zip", age_s=2 * KEEP_S)
    running = write(tmp_path / "jobs" / "running" / "a.mp4", age_s=2 * KEEP_S)
    sweep(tmp_path, KEEP_S, in_use=[running.parent])
    assert left(tmp_path) == ["gradio/cc/new.wav", "jobs/running/a.mp4"]


def test_a_sweep_that_fails_is_not_the_last(tmp_path, monkeypatch, caplog):
    """Of one entry that cannot be deleted, and of what cannot even be begun."""
    write(tmp_path / "gradio" / "a stubborn one", age_s=2 * KEEP_S)
    old = write(tmp_path / "private" / "old" / "key.zip", age_s=2 * KEEP_S)
    unlink, fails = Path.unlink, [OSError(5, "Input/output error")]

    def fail_at(path: Path, **how: Any) -> None:
        if path.name == "a stubborn one":
            raise OSError(16, "Device or resource busy")
        unlink(path, **how)

    def in_use() -> list[Path]:
        if fails:
            raise fails.pop()
        return []

    monkeypatch.setattr(Path, "unlink", fail_at)
    monkeypatch.setattr("app.page.visitors.job_folders.SWEEP_EVERY_S", 0.01)
    start_sweeper(tmp_path, KEEP_S, in_use)
    wait_for(lambda: not old.exists())
    assert "deleting expired files failed" in caplog.text and "could not be deleted" in caplog.text


HOLD = """
import signal, sys
from pathlib import Path
from app.page.visitors.job_folders import make_process_folder
folder = make_process_folder(Path(sys.argv[1]))
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
    mine = make_process_folder(parent)
    assert (theirs / "upload").exists() and mine.parent == parent
    assert mine.stat().st_mode & 0o777 == parent.stat().st_mode & 0o777 == 0o700
    assert not (parent / "jobs").exists()
    child.send_signal(signal.SIGKILL)
    child.communicate()
    make_process_folder(parent)
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
    assert client_network_of(SimpleNamespace(client=client)) == address  # type: ignore[arg-type]


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
    wait_for(lambda: not path.exists())
    assert visitor.get(f"/gradio_api/file={path}").status_code in (403, 404)


def test_an_upload_that_is_broken_off_or_finds_no_room_leaves_nothing(served, monkeypatch):
    before = served.uploads()
    served.sent("10.1.0.1", multipart(bytes(10**6)), "b", {"type": "http.disconnect"})
    assert served.uploads() == before
    monkeypatch.setattr(uploads, "MAX_BODY_BYTES", 2 * 10**7)
    ended = {"type": "http.request", "body": b"\r\n--b--\r\n"}
    start, body = served.sent("10.1.0.2", multipart(bytes(2 * 10**7)), "b", ended)
    assert start["status"] == 400 and b"can be uploaded at once" in body["body"]
    whole = {"files": ("a.wav", bytes(2 * 10**7))}
    answer = served.visitor().post("/gradio_api/upload", files=whole)  # which says how long it is
    assert answer.status_code == 400 and "can be uploaded at once" in answer.text
    assert served.uploads() == before
    start, _ = served.sent("10.1.0.2", multipart(b"x"), "b", ended)
    assert start["status"] == 200 and len(served.uploads() - before) == 1
    monkeypatch.setattr(uploads.LimitedUploadParser, "min_free_bytes", 10**18)
    answer = served.visitor().post("/gradio_api/upload", files=UPLOAD)
    assert answer.status_code == 400 and answer.text == text.DISK_FULL


def test_the_uploads_of_one_address_have_a_limit_together(served, monkeypatch):
    quota = uploads.LimitedUploadParser.quota
    monkeypatch.setattr(quota, "max_bytes", 2800)
    visitor, other = served.visitor(), served.visitor()

    def send(client: TestClient, letter: bytes) -> Response:
        return client.post("/gradio_api/upload", files={"files": ("a.wav", 1200 * letter)})

    first = send(visitor, b"a")
    assert first.status_code == send(visitor, b"a").status_code == 200
    assert send(visitor, b"b").status_code == 200, "the first, sent twice, is there once"
    before = served.uploads()
    full = send(visitor, b"c")
    assert full.status_code == 400 and "from your IP address would take 0.0 GB" in full.text
    ended = {"type": "http.request", "body": b"\r\n--b--\r\n"}
    start, unstated = served.sent("10.1.0.3", multipart(bytes(5000)), "b", ended)
    assert start["status"] == 400 and b"from your IP address" in unstated["body"]
    assert served.uploads() == before
    assert send(other, b"b").status_code == 200
    shutil.rmtree(Path(first.json()[0]).parent)
    quota.forget_deleted()
    assert send(visitor, b"c").status_code == 200


def test_many_tiny_files_are_refused_by_their_number_and_leave_nothing(served):
    for count, status, sentence in (
        (MAX_FILES + 1, 400, f"At most {MAX_FILES} files"),
        (MAX_FILES, 200, ""),
    ):
        before = served.uploads()
        tiny = [("files", (f"{number}", b"%8d" % number)) for number in range(count)]
        answer = served.visitor().post("/gradio_api/upload", files=tiny)
        assert answer.status_code == status and sentence in answer.text
        assert len(served.uploads() - before) == (count if status == 200 else 0)


def test_a_long_field_that_is_no_file_is_refused(served):
    for length, status in ((65_536, 200), (65_537, 400)):
        form = {"data": {"a": "x" * length}, "files": {"files": ("a.wav", b"sound")}}
        answer = served.visitor().post("/gradio_api/upload", **form)
        assert answer.status_code == status
    assert "larger than the limit of 65536 bytes" in answer.text


def test_a_full_disk_is_said_and_leaves_nothing(served, monkeypatch):
    async def full(self: object, data: bytes) -> None:
        raise OSError(28, "No space left on device")

    before = served.uploads()
    monkeypatch.setattr(GradioUploadFile, "write", full)
    answer = served.visitor().post("/gradio_api/upload", files=UPLOAD)
    assert answer.status_code == 400 and answer.text == text.DISK_FULL
    assert served.uploads() == before
