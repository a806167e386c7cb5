"""`convert`: files as they were understood, in another form, and what was assumed of them."""

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest

from app.commands.cli import main
from conventions.joints import HANDS
from model.formats.convention_detection import MEAN_HANDS_SUBSTITUTE
from model.formats.read import read_any_motion
from model.motion.motion import load_motion
from tests.model.formats.made import FROM_Y, Person, joints_of, turned

MOTION = Person(3).motion(20)


@pytest.fixture
def z_up(tmp_path: Path) -> Path:
    """Z up, in centimetres, with hands told from the mean hand."""
    poses, trans = turned(MOTION, FROM_Y["z"])
    poses[:, list(HANDS)] -= MEAN_HANDS_SUBSTITUTE
    path = tmp_path / "theirs.npz"
    np.savez(path, poses=poses, trans=100 * trans, fps=np.array(30))
    return path


def test_what_was_understood_goes_through_every_form(z_up, tmp_path, capsys):
    npz, bvh, glb = (tmp_path / "out" / f"a{ending}" for ending in (".npz", ".bvh", ".glb"))
    argv = ["--assume", "theirs:hands=mean"]
    assert main(["convert", str(z_up), "--out", str(npz), *argv]) == 0
    printed = capsys.readouterr()
    assert printed.out.strip() == str(npz)
    assert "up axis z" in printed.err and "units cm" in printed.err
    assert "hands relative to the mean pose" in printed.err
    with np.load(npz, allow_pickle=False) as arrays:
        assumed = {each["kind"]: each["value"] for each in json.loads(str(arrays["assumptions"]))}
    assert (assumed["up"], assumed["units"], assumed["hands"]) == ("z", "cm", "mean")
    np.testing.assert_allclose(joints_of(load_motion(npz)), joints_of(MOTION), atol=1e-3)
    assert read_any_motion(npz).notes == ()
    assert main(["convert", str(npz), "--out", str(bvh)]) == 0
    again = joints_of(read_any_motion(bvh).motion)
    np.testing.assert_allclose(again, joints_of(MOTION), atol=2e-3)
    assert main(["convert", str(bvh), "--out", str(glb)]) == 0
    assert glb.read_bytes()[:4] == b"glTF"


def test_a_bad_file_of_a_zip_costs_itself_only(z_up, tmp_path, capsys):
    packed, out = tmp_path / "set.zip", tmp_path / "out"
    with zipfile.ZipFile(packed, "w") as archive:
        archive.write(z_up, "sub/one.npz")
        archive.writestr("two.bvh", "HIERARCHY")
    assert main(["convert", str(packed), str(z_up), "--out", str(out), "--json"]) == 1
    printed = capsys.readouterr()
    told = {Path(each["file"]).name: each for each in json.loads(printed.out)}
    assert "line 1" in told["two.bvh"]["error"] and told["one.npz"]["frames"] == 20
    assert "1 of 3 files were not converted" in printed.err
    made = sorted(str(path.relative_to(out)) for path in out.rglob("*") if path.is_file())
    assert len(made) == 2 and made[1] == "theirs.npz" and made[0].endswith("one.npz")


def test_a_zip_with_a_file_for_each_parameter_is_one_motion(tmp_path, capsys):
    """As Embody-3D has them; `diagnose` measures it as one clip."""
    poses = MOTION.poses.reshape(20, 55, 3)
    parts = {"global_orient": poses[:, 0], "body_pose": poses[:, 1:22], "transl": MOTION.trans}
    packed, out = tmp_path / "set.zip", tmp_path / "out"
    with zipfile.ZipFile(packed, "w") as archive:
        for part, rows in parts.items():
            np.save(tmp_path / "rows.npy", rows)
            archive.write(tmp_path / "rows.npy", f"AAA111/smplx_mesh_{part}/clip.npy")
    assert main(["convert", str(packed), "--out", str(out)]) == 0
    found = load_motion(out / "AAA111" / "clip.npz")
    np.testing.assert_allclose(found.poses[:, :66], MOTION.poses[:, :66], atol=1e-6)
    assert main(["diagnose", str(packed), "--out", str(tmp_path / "numbers")]) == 0
    assert [path.name for path in (tmp_path / "numbers" / "clips").glob("*.json")] == ["clip.json"]
    capsys.readouterr()


@pytest.mark.parametrize(
    ("files", "out", "said"),
    [
        (["theirs.npz", "theirs.npz"], "a.npz", "the inputs contain 2 motions"),
        (["none.npz"], "out", "does not exist"),
        (["theirs.npz"], "theirs.npz", "would overwrite an input file"),
    ],
)
def test_what_cannot_be_converted_is_said(files, out, said, z_up, tmp_path, capsys):
    before = z_up.read_bytes()
    paths = [str(tmp_path / each) for each in files]
    assert main(["convert", *paths, "--out", str(tmp_path / out)]) == 1
    assert said in capsys.readouterr().err
    assert z_up.read_bytes() == before
