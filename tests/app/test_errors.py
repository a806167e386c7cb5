"""What a person is told of an error."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from app import text
from app.errors import RunError, message_for_user, visitor_message


@pytest.mark.parametrize(
    ("told", "on_page"),
    [
        ("Say this.", "Say this."),
        (
            "a.npy tells no frame rate; 30 was taken (say another with --assume).",
            "a.npy tells no frame rate; 30 was taken.",
        ),
        ("None was given: add it (--speech), or not.", "None was given: add it, or not."),
        ("Rates are 12 to 240 (30 usually).", "Rates are 12 to 240 (30 usually)."),
        (
            "No weights in /srv/app/weights; /tmp/a/b\x1b[2J.npz is bad: see http://a/b/c",
            "No weights in weights; b?[2J.npz is bad: see http://a/b/c",
        ),
    ],
)
def test_a_visitor_is_shown_no_option_no_folder_and_nothing_that_a_terminal_obeys(told, on_page):
    assert visitor_message(RunError(told)) == on_page


def test_faults_get_a_number_under_which_the_log_has_them(caplog):
    shown = visitor_message(KeyError("secret /path"))
    assert "secret" not in shown
    number = shown.rsplit(" ", 1)[1].rstrip(".")
    assert len(number) == 8 and number in caplog.text and "secret /path" in caplog.text


def test_of_the_systems_errors_those_are_told_that_a_person_can_do_something_about():
    full = OSError(28, "No space left on device", "/results/a.mp4")
    assert message_for_user(full) == (
        "The disk at /results is full; free some space or write to another folder."
    )
    assert visitor_message(full) == text.DISK_FULL
    assert message_for_user(OSError(13, "Permission denied")) == (
        "Permission to write to the folder was denied; choose another folder."
    )
    assert "ran out of memory" in str(message_for_user(MemoryError()))
    assert message_for_user(OSError(2, "No such file")) is None


@contextmanager
def as_nobody() -> Iterator[None]:
    """Run without root's right to read everything."""
    is_root = os.getuid() == 0
    if is_root:
        os.setresuid(65534, 65534, 0)
    try:
        yield
    finally:
        if is_root:
            os.setresuid(0, 0, 0)


def test_an_input_that_may_not_be_read_is_told_as_such():
    with TemporaryDirectory() as folder:  # pytest's lies in others that nobody else may enter
        check_refusals(Path(folder))


def check_refusals(tmp_path):
    tmp_path.chmod(0o755)
    hidden, closed = tmp_path / "a.wav", tmp_path / "closed"
    hidden.touch(mode=0o000)
    closed.mkdir(mode=0o000)
    missing = tmp_path / "results.csv"
    with as_nobody():
        for path, words in (
            (hidden, f"Permission to read {hidden} was denied;"),
            (closed / "b.wav", "b.wav was denied; change its permissions"),
            (missing, f"Permission to write to {tmp_path}"),
        ):
            assert words in str(
                message_for_user(PermissionError(13, "Permission denied", str(path)))
            )
