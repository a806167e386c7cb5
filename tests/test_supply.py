"""What is installed is what was looked at: locks with hashes, one source for each file."""

import json
import re
import subprocess

import pytest
from packaging.requirements import Requirement
from packaging.version import Version

from tests.helpers import ROOT

LOCKS = sorted((ROOT / "locks").glob("*.txt"))


def pins(name: str) -> dict[str, str]:
    """Package to version, of a lock in which every entry has a hash."""
    entries = (ROOT / "locks" / f"{name}.txt").read_text().replace("\\\n", " ").splitlines()
    found = {}
    for entry in filter(None, entries):
        pinned = re.match(r"([\w.-]+)==(\S+)(?: ;.*?)?\s+--hash=sha256:[0-9a-f]{64}", entry)
        assert pinned, entry[:80]
        found[pinned[1].lower().replace("_", "-")] = pinned[2]
    return found


def wanted(file: str) -> list[Requirement]:
    lines = (line.split("#")[0].strip() for line in (ROOT / file).read_text().splitlines())
    return [Requirement(line) for line in lines if line and not line.startswith("-r")]


def test_the_lock_holds_what_is_required():
    for lock, files in [
        ("run", ["requirements.txt"]),
        ("test", ["requirements.txt", "requirements-dev.txt"]),
        ("cluster", ["requirements-cluster.txt"]),
    ]:
        locked = pins(lock) | {"torch": pins("torch-cpu")["torch"].split("+")[0]}
        for requirement in [each for file in files for each in wanted(file)]:
            assert requirement.specifier.contains(locked[requirement.name.lower()]), (
                f"{requirement} is not {locked[requirement.name.lower()]}; run make lock"
            )


def test_a_cluster_stands_beside_the_rest_in_one_environment():
    others = pins("run") | pins("test")
    cluster = pins("cluster")
    assert {name: others[name] for name in cluster.keys() & others.keys()}.items() <= (
        cluster.items()
    )


def test_every_file_of_torch_has_its_hash_and_its_own_source():
    assert Version(pins("torch-cpu")["torch"]).local == "cpu"
    assert pins("torch-pypi")["torch"] == pins("torch-cpu")["torch"].split("+")[0]
    assert "torch" not in pins("run") and not any(name.startswith("nvidia") for name in pins("run"))
    assert set(pins("pip")) == {"pip"}


def test_no_package_can_come_from_a_second_index():
    for script in [*(ROOT / ".ci").iterdir(), *LOCKS, ROOT / "requirements.txt", ROOT / "Makefile"]:
        assert "extra-index-url" not in script.read_text(), script
    installer = (ROOT / ".ci" / "venv").read_text()
    locked = [line for line in installer.splitlines() if "$pip " in line and "-r " in line]
    assert all("$locked" in line or line.strip().startswith("exec") for line in locked)


def test_git_hides_no_source_file_and_ignores_what_runs_leave():
    """What git ignores, ruff does not read either."""
    sources = "app/new.py model/data/new.py model/runs/new.py renderer/out/new.py".split()
    left = ["data/a.npz", "runs/a/state.pt", "out/a.mp4"]
    command = ["git", "check-ignore", "--no-index", *sources, *left]
    hidden = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if hidden.returncode == 128:
        pytest.skip("this is not a checkout of git")
    assert hidden.stdout.split() == left


def test_what_checks_the_javascript_is_locked_too():
    folder = ROOT / "tests" / "javascript"
    asked = json.loads((folder / "package.json").read_text())["devDependencies"]
    packages = json.loads((folder / "package-lock.json").read_text())["packages"]
    locked = {name: told for name, told in packages.items() if name}
    assert {name: locked[f"node_modules/{name}"]["version"] for name in asked} == asked
    for name, told in locked.items():
        assert told["integrity"].startswith("sha512-"), name
        assert told.get("dev"), f"{name} is not a part of the program"
