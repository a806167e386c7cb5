"""What `pip install .` makes, used outside of the checkout; and the container's steps."""

import json
import os
import re
import resource
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from frame_regression.config import MEAN, presets
from frame_regression.network import Regression

from model.storage.cards import to_json
from model.storage.checkpoint import save_weights
from tests.helpers import ROOT

GIGABYTE = 2**30
SPEECH = "co_speech_motion/examples/three_reasons.wav"
CODE = "import sys; from co_speech_motion.__main__ import main; sys.exit(main())"
"""As the script that pip writes calls it."""


@pytest.fixture(scope="module", params=["copied", pytest.param("wheel", marks=pytest.mark.slow)])
def site(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as site-packages is after the install; what is needed besides is in this one. By
    default a copy of what pyproject.toml says, since pip takes long."""
    folder = tmp_path_factory.mktemp("installed") / "site"
    if request.param == "copied":
        told = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["hatch"]
        for source, target in told["build"]["targets"]["wheel"]["force-include"].items():
            (folder / target).parent.mkdir(parents=True, exist_ok=True)
            copy = shutil.copytree if (ROOT / source).is_dir() else shutil.copy2
            copy(ROOT / source, folder / target)
        return folder
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-index"]
    command += ["--no-build-isolation", "--wheel-dir", str(folder.with_name("wheels")), str(ROOT)]
    subprocess.run(command, check=True, capture_output=True)
    (wheel,) = folder.parent.glob("wheels/co_speech_motion-*.whl")
    with zipfile.ZipFile(wheel) as packed:
        packed.extractall(folder)
    return folder


def installed(
    site: Path, *arguments: str, cwd: Path, one_core: bool = False, **environment: str
) -> subprocess.Popen:
    command = [sys.executable, "-c", *arguments]
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


def test_one_name_with_every_file_stands_beside_the_packages_of_others(site):
    names = {path.name for path in site.iterdir() if not path.name.endswith(".dist-info")}
    assert names == {"co_speech_motion"}
    root = site / "co_speech_motion"
    assert (root / "renderer/draw/shaders/mesh.vert").is_file()
    assert (root / "model/weights/expression.json").is_file() and not (root / "tests").exists()
    for told in site.glob("*.dist-info/entry_points.txt"):
        assert "co-speech-motion = co_speech_motion.__main__:main" in told.read_text()
        assert not list(root.rglob("__pycache__"))
    roots = ("app", "conventions", "model", "processes", "renderer", "tools", "examples")
    command = ["git", "ls-files", *roots]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False).stdout
    there = [name for name in listed.split() if (ROOT / name).exists()]
    assert [name for name in there if not (root / name).exists()] == []


def test_it_is_imported_by_its_one_name_in_no_ones_way_until_it_is_used(site, tmp_path):
    code = (
        "import sys, co_speech_motion; assert not {'app', 'model', 'torch'} & set(sys.modules); "
        "from co_speech_motion import systems; print(*systems())"
    )
    assert "globaldiff/local" in answer(installed(site, code, cwd=tmp_path)).split()
    (tmp_path / "app.py").write_text("")
    child = installed(site, "from co_speech_motion import systems", cwd=tmp_path)
    _, error = child.communicate(timeout=100)
    assert child.returncode == 1 and "Another package called 'app'" in error


@pytest.mark.slow
def test_the_command_works_from_any_folder(site, tmp_path):
    """On one core, with as much memory as a machine of 4 GB has left, and for a wheel also where
    nothing but its output can be written."""
    places = {}
    if site.with_name("wheels").is_dir():
        home = tmp_path / "home"
        home.write_text("a file, in which no cache can be made")
        places = dict.fromkeys(("HOME", "XDG_CACHE_HOME", "XDG_CONFIG_HOME"), str(home))
    flags = ["generate", str(site / SPEECH), "--systems", "globaldiff/global", "--steps", "1"]
    flags += ["--out", "results", "--no-video", "--no-figures"]
    child = installed(site, CODE, *flags, cwd=tmp_path, one_core=True, **places)
    resource.prlimit(child.pid, resource.RLIMIT_DATA, (3 * GIGABYTE, 3 * GIGABYTE))
    assert "results/globaldiff-global.npz" in answer(child).splitlines()


@pytest.mark.slow
def test_programs_of_their_own_are_words_of_the_command(site, tmp_path):
    for word, flag in (("train", "--data"), ("page", "--port")):
        assert flag in answer(installed(site, CODE, word, "--help", cwd=tmp_path))


@pytest.fixture
def with_a_family(site: Path, tmp_path: Path) -> str:
    """The path of modules once the example's package and a broken one were installed as well."""
    target = tmp_path / "target"
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index"]
    source = shutil.copytree(ROOT / "examples" / "frame_regression", tmp_path / "source")
    command += ["--no-build-isolation", "--target", str(target), str(source)]
    subprocess.run(command, check=True, capture_output=True)
    told = target / "broken-1.0.dist-info"
    told.mkdir()
    (told / "METADATA").write_text("Metadata-Version: 2.1\nName: broken\nVersion: 1.0\n")
    (told / "entry_points.txt").write_text("[co_speech_motion.families]\nworse = broken:FAMILY\n")
    return f"{site}{os.pathsep}{target}"


@pytest.mark.slow
def test_a_family_that_pip_installs_trains_and_generates_beside_a_broken_one(
    site, with_a_family, data_folder, tmp_path
):
    flags = ("smoke", "--system", "regression/mean", "--data", str(data_folder), "--out", "run")
    answer(installed(site, CODE, "train", *flags, cwd=tmp_path, PYTHONPATH=with_a_family))
    flags = ("--systems", "regression/mean,regression/drawn", "--weights", "run/weights")
    flags += ("--out", "results", "--no-video", "--no-figures")
    speech = str(data_folder / "wave16k" / "1_ann_0_0_0.wav")
    command = ("generate", speech, *flags)
    child = installed(site, CODE, *command, cwd=tmp_path, PYTHONPATH=with_a_family)
    _, error = child.communicate(timeout=300)
    assert child.returncode == 0, error
    assert (
        "The family 'worse' of the package broken (broken:FAMILY) is left out: "
        "ModuleNotFoundError: No module named 'broken'." in error
    )
    for system in ("mean", "drawn"):
        assert (tmp_path / "results" / f"regression-{system}.npz").is_file()
    # Weights that a package brings are found beside the bundled ones.
    config = presets(MEAN)["smoke"]
    tensors = Regression(68, config.width).state_dict()
    card = {"speakers": {"ann": 1}, "config": json.loads(to_json(config))}
    weights = Path(with_a_family.split(os.pathsep)[1]) / "frame_regression" / "weights"
    save_weights(weights, MEAN, {f"network.{n}": tensor for n, tensor in tensors.items()}, card)
    code = "from model.systems.registry import list_systems, read_card; "
    code += "print(list_systems()[-2:], list(read_card('regression/drawn')['speakers']))"
    child = installed(site, code, cwd=site / "co_speech_motion", PYTHONPATH=with_a_family)
    assert answer(child) == "('regression/mean', 'regression/drawn') ['ann']\n"


def test_the_container_is_made_by_the_scripts_of_make_demo():
    steps = re.findall(r"^RUN (\S+ run)\b", (ROOT / "Dockerfile").read_text(), re.MULTILINE)
    makefile = (ROOT / "Makefile").read_text()
    recipe = makefile[makefile.index(".venv/.run-ready:") :].split("\n\n")[0]
    assert steps == re.findall(r"@(\.ci/\S+ run)\b", recipe) == [
        ".ci/system-packages run",
        ".ci/venv run",
    ]  # fmt: skip


def test_the_container_is_given_every_file_that_its_steps_and_the_page_need():
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
