"""Zips and tars of sets: what is wanted comes out of them, and hostile ones do nothing."""

import stat
import struct
import tarfile
import zipfile
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

from app.errors import RunError
from app.run.batch.archives import UnpackBudget, unpack_archive

NPZ = (".npz",)


def _zip(path: Path, *entries: tuple[str | zipfile.ZipInfo, bytes], packed: bool = False) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED if packed else 0) as archive:
        for name, content in entries:
            archive.writestr(name, content)
    return path


def _packed(path: Path, **files: bytes) -> Path:
    """A zip or a tar, by its name."""
    if path.suffix == ".zip":
        return _zip(path, *files.items(), packed=True)
    with tarfile.open(path, "w:gz" if path.suffix == ".gz" else "w") as archive:
        for name, content in files.items():
            info = tarfile.TarInfo(name)
            info.size = len(content)
            archive.addfile(info, BytesIO(content))
    return path


def _all_below(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "deep" / "in").mkdir(parents=True)
    return tmp_path / "deep" / "in"


@pytest.mark.parametrize("name", ["a.zip", "a.tar.gz", "a.tar"])
def test_wanted_files_come_out_at_any_depth_also_of_archives_within(
    name: str, folder: Path, tmp_path: Path
):
    inner = _packed(tmp_path / "in.tar.gz", **{"./deep/c.npz": b"three", "no.txt": b"no"})
    files = {"my/a.npz": b"one", "my/b.NPZ": b"two", "my/in.tar.gz": inner.read_bytes()}
    files |= {"__MACOSX/my/._a.npz": b"not this", "my/.hidden/c.npz": b"nor this"}
    if name == "a.zip":  # as Windows writes them
        files["my\\a.npz"] = files.pop("my/a.npz")
    assert unpack_archive(_packed(tmp_path / name, **files), folder, NPZ) == 3
    assert _all_below(folder) == {"my/a.npz", "my/b.NPZ", "my/in/deep/c.npz"}
    assert (folder / "my" / "b.NPZ").read_bytes() == b"two"


def test_times_follow_from_content(folder: Path, tmp_path: Path):
    for name, content in (("one", b"same"), ("two", b"same"), ("three", b"else")):
        info = zipfile.ZipInfo("a.npz", (2000 + len(name), 1, 1, 0, 0, 0))
        (folder / name).mkdir()
        unpack_archive(_zip(tmp_path / f"{name}.zip", (info, content)), folder / name, NPZ)
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
    with pytest.raises(RunError, match="an unsafe path"):
        unpack_archive(path, folder, NPZ)
    assert _all_below(tmp_path) == before


@pytest.mark.parametrize("kind", [stat.S_IFLNK, stat.S_IFIFO, stat.S_IFCHR])
def test_links_and_devices_are_refused(kind: int, folder: Path, tmp_path: Path):
    link = zipfile.ZipInfo("set")
    link.external_attr = (kind | 0o777) << 16
    path = _zip(tmp_path / "bad.zip", (link, b"/etc"), ("set/passwd.npz", b"bad"))
    with pytest.raises(RunError, match="a link or device"):
        unpack_archive(path, folder, NPZ)
    assert not _all_below(folder)


@pytest.mark.parametrize("name", ["bomb.zip", "bomb.tar.gz"])
def test_limits_hold_before_a_byte_is_unpacked_and_for_all_archives_together(
    name: str, folder: Path, tmp_path: Path
):
    zeros = bytes(3 * 2**20)
    path = _packed(tmp_path / name, **{"a.npz": zeros, "b.npz": zeros})
    assert path.stat().st_size < 20_000
    for limits, said in (
        (UnpackBudget(max_file_bytes=2**20), r"'a.npz' in .* is 3 MiB; the limit for a file is 1"),
        (UnpackBudget(max_files=10, max_total_bytes=5 * 2**20), r"Split the archive"),
        (UnpackBudget(max_files=1), r"the limit is 1"),
    ):
        with pytest.raises(RunError, match=said):
            unpack_archive(path, folder, NPZ, limits)
    assert not _all_below(folder)
    unread = _packed(tmp_path / "unread.tar.gz", **{"a.txt": zeros, "b.npz": b"b"})
    with pytest.raises(RunError, match="exceed the limit of 1 MiB in total"):
        unpack_archive(unread, folder, NPZ, UnpackBudget(max_files=10, max_total_bytes=2**20))
    within = _zip(tmp_path / "within.zip", (name, path.read_bytes()), ("c.npz", zeros))
    with pytest.raises(RunError, match=rf"files in {name} (take|exceed)"):
        unpack_archive(within, folder, NPZ, UnpackBudget(max_files=10, max_total_bytes=8 * 2**20))


@pytest.mark.parametrize("comment", [b"", b"a comment"])
def test_a_list_of_too_many_files_is_not_even_read(comment, folder, tmp_path, monkeypatch):
    path = tmp_path / "many.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.comment = comment
        for place in range(100):
            archive.writestr(f"{place:0100}.npz", b"")
    monkeypatch.setattr("zipfile.ZipInfo", None)  # of an entry that is read
    with pytest.raises(RunError, match="the limit is 10"):
        unpack_archive(path, folder, NPZ, UnpackBudget(max_files=10))


def test_a_file_of_another_size_than_it_says_is_refused(folder: Path, tmp_path: Path):
    """Of 5,000 bytes that say they are 10: in the list, and before the file itself."""
    path = _zip(tmp_path / "bad.zip", ("a.npz", bytes(5000)), packed=True)
    content = path.read_bytes()
    assert content.count(struct.pack("<L", 5000)) == 2
    path.write_bytes(content.replace(struct.pack("<L", 5000), struct.pack("<L", 10)))
    with pytest.raises(RunError, match="not a readable zip"):
        unpack_archive(path, folder, NPZ)
    assert sum(file.stat().st_size for file in folder.rglob("*.npz")) <= 10


def test_names_that_come_twice_are_refused(folder: Path, tmp_path: Path):
    with pytest.warns(UserWarning, match="Duplicate"):
        path = _zip(tmp_path / "bad.zip", ("a.npz", b"one"), ("a.npz", b"two"))
    with pytest.raises(RunError, match=r"'a.npz' twice"):
        unpack_archive(path, folder, NPZ)
    within = _zip(tmp_path / "within.zip", ("b.npz", b"file"), ("b.npz/c.npz", b"in a file"))
    with pytest.raises(RunError, match="two files with the same name"):
        unpack_archive(within, folder, NPZ)


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
        with pytest.raises(RunError, match=f"{name} is not a readable zip"):
            unpack_archive(tmp_path / name, folder, NPZ)
    locked = zipfile.ZipInfo("a.npz")
    path = _zip(tmp_path / "locked.zip", (locked, b"secret"))
    data = bytearray(path.read_bytes())
    for mark, place in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        data[data.index(mark) + place] |= 1
    path.write_bytes(data)
    with pytest.raises(RunError, match="without a password"):
        unpack_archive(path, folder, NPZ)
    with pytest.raises(RunError, match=r"contains no supported files \(.npz"):
        unpack_archive(_zip(tmp_path / "other.zip", ("a.txt", b"text")), folder, NPZ)
    with pytest.raises(RunError, match=r"none.zip cannot be read: No such file"):
        unpack_archive(tmp_path / "none.zip", folder, NPZ)


@pytest.mark.parametrize("kind", ["symlink", "hard link", "device", "sparse", "out", "root"])
def test_hostile_tars_leave_nothing(kind: str, tmp_path: Path, folder: Path):
    info = tarfile.TarInfo("x.npz")
    info.type = {
        "symlink": tarfile.SYMTYPE,
        "hard link": tarfile.LNKTYPE,
        "device": tarfile.CHRTYPE,
        "sparse": tarfile.GNUTYPE_SPARSE,
    }.get(kind, tarfile.REGTYPE)
    info.linkname = "/etc/passwd"
    info.name = {"out": "../x.npz", "root": "/x.npz"}.get(kind, "x.npz")
    with tarfile.open(tmp_path / "a.tar", "w") as opened:
        opened.addfile(info)
    with pytest.raises(RunError, match=r"link or device|unsafe path|not a readable tar"):
        unpack_archive(tmp_path / "a.tar", folder, NPZ)
    assert _all_below(tmp_path) == {"a.tar"}


def test_archives_too_deep_cut_or_none_are_refused(tmp_path: Path, folder: Path):
    deep = _packed(tmp_path / "0.zip", **{"a.npz": b"a"})
    for place in range(1, 4):
        deep = _packed(tmp_path / f"{place}.zip", **{"in.zip": deep.read_bytes()})
    with pytest.raises(RunError, match="an archive nested 3 levels deep; at most 2"):
        unpack_archive(deep, folder, NPZ)
    whole = _packed(tmp_path / "w.tar.gz", **{"a.npz": np.random.default_rng(0).bytes(9000)})
    content = whole.read_bytes()
    huge = tarfile.TarInfo("x")
    huge.type, huge.size = tarfile.XHDTYPE, 2**31
    for bad in (content[:600], content[:-500], b"", b"\x1f\x8b no", huge.tobuf()):
        path = tmp_path / ("bad.tar" if bad == huge.tobuf() else "bad.tar.gz")
        path.write_bytes(bad)
        with pytest.raises(RunError, match=r"not a readable tar|holds none"):
            unpack_archive(path, folder, NPZ)
