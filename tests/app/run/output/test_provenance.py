"""The revision of the code that results and the cards of weights name."""

import subprocess
from pathlib import Path

import pytest

from app.run.output.provenance import versions
from model.training.run_folder import revision


@pytest.fixture
def repository(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A repository of one file, which Git takes for that of the code."""
    folder = tmp_path / "code"
    subprocess.run(["git", "init", "-q", str(folder)], check=True)
    monkeypatch.setenv("GIT_DIR", str(folder / ".git"))
    monkeypatch.setenv("GIT_WORK_TREE", str(folder))
    (folder / "code.py").write_text("pass\n")
    who = ("-c", "user.name=a", "-c", "user.email=a@b")
    for command in (("add", "code.py"), (*who, "commit", "-q", "-m", "Begin")):
        subprocess.run(["git", *command], cwd=folder, check=True)
    return folder


def test_results_and_cards_name_one_revision_whatever_lies_beside_the_code(
    repository: Path,
) -> None:
    clean = revision()
    assert len(clean) >= 7 and not clean.endswith("+")
    (repository / "results.json").write_text("{}")
    assert versions()["project"] == revision() == clean
    (repository / "code.py").write_text("1 / 0\n")
    assert versions()["project"] == revision() == f"{clean}+"


def test_without_a_repository_the_revision_is_unknown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("GIT_DIR", str(tmp_path / "nowhere"))
    assert versions()["project"] == revision() == "unknown"
