"""What `pip install .` makes, used outside of the checkout; and the container's steps."""

import json
import os
import re
import resource
import shutil
import subprocess
import sys
import time
import urllib.error
import urllib.request
import zipfile
from pathlib import Path

import pytest
from frame_regression import MEAN, named_config
from frame_regression.network import Regression

from model.storage.cards import to_json
from model.storage.checkpoint import save_weights
from tests.helpers import ROOT
from tests.model.made import make_data_folder

GIGABYTE = 2**30


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as site-packages is after the install; what is needed besides is in this one."""
    folder = tmp_path_factory.mktemp("installed")
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-index"]
    command += ["--no-build-isolation", "--wheel-dir", str(folder), str(ROOT)]
    subprocess.run(command, check=True, capture_output=True)
    (wheel,) = folder.glob("co_speech_motion-*.whl")
    with zipfile.ZipFile(wheel) as packed:
        packed.extractall(folder / "site")
    wheel.unlink()
    return folder / "site"


def made_regression() -> tuple[dict, dict]:
    """Tensors of the example's network, untrained, and a card of them."""
    config = named_config("smoke", MEAN)
    tensors = Regression(68, config.width).state_dict()
    card = {"speakers": {"ann": 1}, "config": json.loads(to_json(config))}
    return {f"network.{name}": tensor for name, tensor in tensors.items()}, card


def installed(
    site: Path, *arguments: str, cwd: Path, one_core: bool = False, **environment: str
) -> subprocess.Popen:
    """The command, as the script that pip writes calls it."""
    code = "import sys; from co_speech_motion.__main__ import main; sys.exit(main())"
    command = [sys.executable, "-c", code, *arguments]
    if one_core and (taskset := shutil.which("taskset")):
        command = [taskset, "--cpu-list", str(min(os.sched_getaffinity(0))), *command]
    variables = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    return subprocess.Popen(
        command,
        cwd=cwd,
        env={**variables, "PYTHONPATH": str(site), **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def answer(child: subprocess.Popen) -> str:
    out, error = child.communicate(timeout=300)
    assert child.returncode == 0, out + error
    return out


def test_one_name_stands_beside_the_packages_of_others(site: Path) -> None:
    names = {path.name for path in site.iterdir() if not path.name.endswith(".dist-info")}
    assert names == {"co_speech_motion"}
    entry = next(site.glob("*.dist-info/entry_points.txt")).read_text()
    assert "co-speech-motion = co_speech_motion.__main__:main" in entry
    root = site / "co_speech_motion"
    shipped = {str(path.relative_to(root)) for path in root.rglob("*.*")}
    assert {"renderer/draw/shaders/mesh.vert", "model/weights/expression.json"} <= shipped
    assert not [name for name in shipped if "__pycache__" in name or name.startswith("tests")]


def test_every_file_of_the_roots_is_in_it(site: Path) -> None:
    roots = ("app", "conventions", "model", "processes", "renderer", "tools", "examples")
    listed = subprocess.run(
        ["git", "ls-files", *roots], cwd=ROOT, capture_output=True, text=True, check=False
    ).stdout.split()
    if not listed:
        pytest.skip("not a git checkout, so the files cannot be listed")
    there = [name for name in listed if (ROOT / name).exists()]
    assert [name for name in there if not (site / "co_speech_motion" / name).exists()] == []


def test_the_command_works_where_nothing_but_its_output_can_be_written(
    site: Path, tmp_path: Path
) -> None:
    """No home, one core, and as much memory as a machine of 4 GB has left."""
    home = tmp_path / "home"
    home.write_text("a file, in which no cache can be made")
    speech = site / "co_speech_motion" / "examples" / "three_reasons.wav"
    child = installed(
        site,
        *("generate", str(speech), "--systems", "globaldiff/global", "--steps", "1"),
        *("--out", "results", "--no-video"),
        cwd=tmp_path,
        one_core=True,
        HOME=str(home),
        XDG_CACHE_HOME=str(home),
        XDG_CONFIG_HOME=str(home),
    )
    resource.prlimit(child.pid, resource.RLIMIT_DATA, (3 * GIGABYTE, 3 * GIGABYTE))
    answer(child)
    assert (tmp_path / "results" / "globaldiff-global.npz").is_file()
    assert (tmp_path / "results" / "figure6.png").is_file()
    assert "--data" in answer(installed(site, "train", "--help", cwd=tmp_path))


@pytest.fixture(scope="module")
def with_a_family(site: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The path of modules once the example's package and a broken one were installed as well."""
    target = tmp_path_factory.mktemp("target")
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index"]
    source = target / "source"
    shutil.copytree(ROOT / "examples" / "frame_regression", source)
    command += ["--no-build-isolation", "--target", str(target), str(source)]
    subprocess.run(command, check=True, capture_output=True)
    told = target / "broken-1.0.dist-info"
    told.mkdir()
    (told / "METADATA").write_text("Metadata-Version: 2.1\nName: broken\nVersion: 1.0\n")
    (told / "entry_points.txt").write_text("[co_speech_motion.families]\nworse = broken:FAMILY\n")
    return f"{site}{os.pathsep}{target}"


def test_a_family_that_pip_installs_trains_and_generates_beside_a_broken_one(
    site: Path, with_a_family: str, tmp_path: Path
) -> None:
    data = make_data_folder(tmp_path / "data")
    flags = ("smoke", "--system", "regression/mean", "--data", str(data), "--out", "run")
    answer(installed(site, "train", *flags, cwd=tmp_path, PYTHONPATH=with_a_family))
    child = installed(
        site,
        "generate",
        str(data / "wave16k" / "1_ann_0_0_0.wav"),
        *("--systems", "regression/mean,regression/drawn", "--weights", "run/weights"),
        *("--out", "results", "--no-video", "--no-figures"),
        cwd=tmp_path,
        PYTHONPATH=with_a_family,
    )
    _, error = child.communicate(timeout=300)
    assert child.returncode == 0, error
    assert (
        "The family 'worse' of the package broken (broken:FAMILY) is left out: "
        "ModuleNotFoundError: No module named 'broken'." in error
    )
    assert (tmp_path / "results" / "regression-drawn.npz").is_file()
    assert (tmp_path / "results" / "regression-mean.npz").is_file()


def test_weights_that_a_package_brings_are_found_beside_the_bundled(
    site: Path, with_a_family: str, tmp_path: Path
) -> None:
    weights = Path(with_a_family.split(os.pathsep)[1]) / "frame_regression" / "weights"
    save_weights(weights, MEAN, *made_regression())
    code = "from model.systems.registry import list_systems, read_card; "
    code += "print(list_systems()[-2:], list(read_card('regression/drawn')['speakers']))"
    child = subprocess.run(
        [sys.executable, "-c", code], cwd=site / "co_speech_motion", capture_output=True, text=True,
        env={**os.environ, "PYTHONPATH": with_a_family}, check=False,
    )  # fmt: skip
    assert child.stdout == "('regression/mean', 'regression/drawn') ['ann']\n", child.stderr


def test_it_is_imported_by_its_one_name(site: Path, tmp_path: Path) -> None:
    """Without being in the way of anyone's own ``app`` or ``model`` until it is used."""
    code = (
        "import sys, co_speech_motion; assert not {'app', 'model', 'torch'} & set(sys.modules); "
        "from co_speech_motion import systems, read_motion; print(*systems())"
    )
    child = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True,
        env={**os.environ, "PYTHONPATH": str(site)}, check=False,
    )  # fmt: skip
    assert child.returncode == 0, child.stderr
    assert "globaldiff/local" in child.stdout.split()
    (tmp_path / "app.py").write_text("")
    child = subprocess.run(
        [sys.executable, "-c", "from co_speech_motion import systems"], cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(site)}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert child.returncode == 1 and "Another package called 'app'" in child.stderr


def test_the_installed_page_opens_and_ends(site: Path, tmp_path: Path) -> None:
    port = 7950
    flags = ("page", "--port", str(port))
    child = installed(site, *flags, cwd=tmp_path, TMPDIR=str(tmp_path), HOME=str(tmp_path))
    try:
        deadline = time.monotonic() + 120
        while time.monotonic() < deadline and child.poll() is None:
            try:
                urllib.request.urlopen(f"http://127.0.0.1:{port}/config", timeout=5)
                break
            except urllib.error.URLError:
                time.sleep(0.3)
        assert child.poll() is None, child.communicate()
        assert urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=30).status == 200
    finally:
        child.terminate()
        _, error = child.communicate(timeout=60)
    assert child.returncode == 0, error
    assert "Traceback" not in error


def test_the_container_is_made_by_the_scripts_of_make_demo() -> None:
    steps = re.findall(r"^RUN (\S+ run)\b", (ROOT / "Dockerfile").read_text(), re.MULTILINE)
    makefile = (ROOT / "Makefile").read_text()
    recipe = makefile[makefile.index(".venv/.run-ready:") :].split("\n\n")[0]
    assert steps == re.findall(r"@(\.ci/\S+ run)\b", recipe) == [
        ".ci/system-packages run",
        ".ci/venv run",
    ]  # fmt: skip


def test_the_container_is_given_every_file_that_its_steps_and_the_page_need() -> None:
    text = (ROOT / "Dockerfile").read_text()
    given = {name for line in re.findall(r"^COPY (.*) \S+$", text, re.M) for name in line.split()}
    ignored = (ROOT / ".dockerignore").read_text().split()
    assert given == {
        ".ci", "requirements.txt", "requirements-cluster.txt", "locks",
        "app.py", "app", "conventions", "model", "processes", "renderer", "tools",
        "examples",
    }  # fmt: skip
    assert not given & set(ignored)
    assert all((ROOT / name).exists() for name in given)
    assert re.search(r"^USER (?!root)\w+$", text, re.M)
    user = text.index("\nUSER")
    assert user < text.index("\nHEALTHCHECK") and user < text.index("\nCMD")
