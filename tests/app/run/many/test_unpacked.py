"""Zips of sets: what they hold is measured as a folder is, and hostile ones do nothing."""

import stat
import struct
import zipfile
from dataclasses import replace
from pathlib import Path

import pytest

from app.errors import RunError
from app.run.ask import Ask
from app.run.many.motions import diagnose_folders
from app.run.many.unpacked import Limits, unpacked
from model.motion.motion import save_motion
from tests.helpers import smooth_motion_example

NPZ = (".npz",)


def _zip(path: Path, *entries: tuple[str | zipfile.ZipInfo, bytes], packed: bool = False) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED if packed else 0) as archive:
        for name, content in entries:
            archive.writestr(name, content)
    return path


def _all_below(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "deep" / "in").mkdir(parents=True)
    return tmp_path / "deep" / "in"


def test_wanted_files_come_out_at_any_depth(folder: Path, tmp_path: Path):
    entries = [("set/a.npz", b"one"), ("set/more/b.npz", b"two"), ("set/read.me", b"text")]
    entries += [("__MACOSX/set/._a.npz", b"not this"), ("set/.hidden/c.npz", b"nor this")]
    path = _zip(tmp_path / "set.zip", *entries, packed=True)
    assert unpacked(path, folder, NPZ) == 2
    assert _all_below(folder) == {"set/a.npz", "set/more/b.npz"}
    assert (folder / "set" / "more" / "b.npz").read_bytes() == b"two"


def test_times_follow_from_content(folder: Path, tmp_path: Path):
    for name, content in (("one", b"same"), ("two", b"same"), ("three", b"else")):
        info = zipfile.ZipInfo("a.npz", (2000 + len(name), 1, 1, 0, 0, 0))
        (folder / name).mkdir()
        unpacked(_zip(tmp_path / f"{name}.zip", (info, content)), folder / name, NPZ)
    one, two, three = (
        (folder / name / "a.npz").stat().st_mtime_ns for name in ("one", "two", "three")
    )
    assert one == two != three


@pytest.mark.parametrize(
    "name",
    [
        "../a.npz", "set/../../a.npz", "/a.npz", "//host/a.npz", "..\\a.npz", "C:a.npz", "./a.npz",
        "set//a.npz", "a\n.npz", "\u202ea.npz", "n" * 300 + ".npz", "d/" * 40 + "a.npz", "../",
        "../read.me",
    ],
)  # fmt: skip
def test_names_that_lead_elsewhere_are_refused(name: str, folder: Path, tmp_path: Path):
    path = _zip(tmp_path / "bad.zip", ("good.npz", b"good"), (name, b"bad"))
    before = _all_below(tmp_path)
    with pytest.raises(RunError, match="leads out of its folder or is no plain one"):
        unpacked(path, folder, NPZ)
    assert _all_below(tmp_path) == before


@pytest.mark.parametrize("kind", [stat.S_IFLNK, stat.S_IFIFO, stat.S_IFCHR])
def test_links_and_devices_are_refused(kind: int, folder: Path, tmp_path: Path):
    link = zipfile.ZipInfo("set")
    link.external_attr = (kind | 0o777) << 16
    path = _zip(tmp_path / "bad.zip", (link, b"/etc"), ("set/passwd.npz", b"bad"))
    with pytest.raises(RunError, match="a link or device"):
        unpacked(path, folder, NPZ)
    assert not _all_below(folder)


def test_limits_hold_before_a_byte_is_unpacked(folder: Path, tmp_path: Path):
    zeros = bytes(3 * 2**20)
    path = _zip(tmp_path / "bomb.zip", ("a.npz", zeros), ("b.npz", zeros), packed=True)
    assert path.stat().st_size < 20_000
    for limits, said in (
        (Limits(file_bytes=2**20), r"'a.npz' of 3 MiB; at most 1 MiB a file"),
        (Limits(total_bytes=5 * 2**20), r"unpack to 6 MiB; at most 5 MiB"),
        (Limits(files=1), r"holds 2 files; at most 1 are read"),
    ):
        with pytest.raises(RunError, match=said):
            unpacked(path, folder, NPZ, limits)
    assert not _all_below(folder)
    assert unpacked(path, folder, NPZ, Limits(2, 6 * 2**20, 3 * 2**20)) == 2


@pytest.mark.parametrize("comment", [b"", b"a comment"])
def test_a_list_of_too_many_files_is_not_even_read(comment, folder, tmp_path, monkeypatch):
    path = tmp_path / "many.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.comment = comment
        for place in range(100):
            archive.writestr(f"{place:0100}.npz", b"")
    monkeypatch.setattr("zipfile.ZipFile", None)
    with pytest.raises(RunError, match="more files than the 10"):
        unpacked(path, folder, NPZ, Limits(files=10))


def test_a_file_of_another_size_than_it_says_is_refused(folder: Path, tmp_path: Path):
    """Of 5,000 bytes that say they are 10: in the list, and before the file itself."""
    path = _zip(tmp_path / "bad.zip", ("a.npz", bytes(5000)), packed=True)
    content = path.read_bytes()
    assert content.count(struct.pack("<L", 5000)) == 2
    path.write_bytes(content.replace(struct.pack("<L", 5000), struct.pack("<L", 10)))
    with pytest.raises(RunError, match="no readable zip"):
        unpacked(path, folder, NPZ)
    assert sum(file.stat().st_size for file in folder.rglob("*.npz")) <= 10


def test_names_that_come_twice_are_refused(folder: Path, tmp_path: Path):
    with pytest.warns(UserWarning, match="Duplicate"):
        path = _zip(tmp_path / "bad.zip", ("a.npz", b"one"), ("a.npz", b"two"))
    with pytest.raises(RunError, match=r"'a.npz' twice"):
        unpacked(path, folder, NPZ)
    within = _zip(tmp_path / "within.zip", ("b.npz", b"file"), ("b.npz/c.npz", b"in a file"))
    with pytest.raises(RunError, match="two files of one name"):
        unpacked(within, folder, NPZ)


def test_what_is_no_zip_is_told(folder: Path, tmp_path: Path):
    whole = _zip(tmp_path / "whole.zip", ("a.npz", bytes(range(256)) * 10), packed=True)
    content = whole.read_bytes()
    at = content.index(b"a.npz") + 20
    bad = {
        "empty.zip": b"",
        "text.zip": b"no zip at all",
        "half.zip": content[: len(content) // 2],
        "end.zip": content[-10:],
        "changed.zip": content[:at] + bytes([content[at] ^ 255]) + content[at + 1 :],
    }
    for name, data in bad.items():
        (tmp_path / name).write_bytes(data)
        with pytest.raises(RunError, match=f"{name} is no readable zip"):
            unpacked(tmp_path / name, folder, NPZ)
    locked = zipfile.ZipInfo("a.npz")
    path = _zip(tmp_path / "locked.zip", (locked, b"secret"))
    data = bytearray(path.read_bytes())
    for mark, place in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        data[data.index(mark) + place] |= 1
    path.write_bytes(data)
    with pytest.raises(RunError, match="without a password"):
        unpacked(path, folder, NPZ)
    with pytest.raises(RunError, match=r"none of the files that are looked for: .npz"):
        unpacked(_zip(tmp_path / "other.zip", ("a.txt", b"text")), folder, NPZ)
    with pytest.raises(RunError, match=r"none.zip cannot be read: No such file"):
        unpacked(tmp_path / "none.zip", folder, NPZ)


def test_sets_in_zips_are_measured_as_folders_are_and_kept(tmp_path: Path):
    for place, name in enumerate(("lively", "gt")):
        (tmp_path / name).mkdir()
        for seed, clip in enumerate("ab"):
            save_motion(
                smooth_motion_example(60, 9 * place + seed), tmp_path / name / f"{clip}.npz"
            )
    lively, gt = (
        _zip(
            tmp_path / f"{name}.zip",
            *((f"x/{clip}.npz", (tmp_path / name / f"{clip}.npz").read_bytes()) for clip in "ab"),
        )
        for name in ("lively", "gt")
    )
    out, zipped = tmp_path / "out", tmp_path / "zipped"
    diagnose_folders(Ask(motions=(tmp_path / "lively",), out=out, reference=tmp_path / "gt"))
    zips = Ask(motions=(lively,), out=zipped, reference=gt)
    assert diagnose_folders(zips).told["clips"] == ["a", "b"]
    for table in ("many.csv", "clips.csv"):
        assert (zipped / table).read_bytes() == (out / table).read_bytes()
    again = diagnose_folders(zips)
    assert any("2 clips had been measured before" in note for note in again.notes)
    with pytest.raises(RunError, match="leads out"):
        bad = _zip(tmp_path / "bad.zip", ("../a.npz", b""))
        diagnose_folders(replace(zips, reference=bad))
    assert not [path for path in zipped.iterdir() if path.name.startswith(".")]
