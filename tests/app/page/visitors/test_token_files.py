from pathlib import Path

import pytest

from app.page.visitors.token_files import TokenFiles


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "a.zip"
    path.touch()
    return path


def test_a_file_is_for_the_browser_with_the_cookie(path: Path) -> None:
    offers = TokenFiles()
    token = offers.add(path, "mine")
    for cookie in ("", "min", "mine2", "yours", "\u00e9"):
        assert offers.find(token, cookie) is None and offers.take(token, cookie) is None
    assert offers.find(token, "mine") == path
    assert offers.find(token.swapcase(), "mine") is None


def test_no_cookie_is_asked_of_none_and_an_empty_one_lets_nobody_in(path: Path) -> None:
    offers = TokenFiles()
    assert offers.find(offers.add(path, None), "any") == path
    assert offers.find(offers.add(path, ""), "") is None


def test_what_is_taken_is_had_once(path: Path) -> None:
    offers = TokenFiles()
    token, other = offers.add(path, "mine"), offers.add(path, "mine")
    assert token != other
    assert offers.take(token, "mine") == path
    assert offers.find(token, "mine") is None and offers.take(token, "mine") is None
    assert offers.find(other, "mine") == path


def test_what_is_over_or_deleted_is_had_by_nobody_and_forgotten_once(
    path: Path, tmp_path: Path
) -> None:
    offers = TokenFiles()
    deleted = tmp_path / "deleted"
    deleted.touch()
    tokens = [
        offers.add(path, "mine", keep_s=-1.0),
        offers.add(deleted, "mine"),
        offers.add(path, "mine", keep_s=60.0),
    ]
    deleted.unlink()
    assert [offers.find(token, "mine") for token in tokens] == [None, None, path]
    assert offers.forget_ended() == [path, deleted] and offers.forget_ended() == []
    assert offers.find(tokens[2], "mine") == path
