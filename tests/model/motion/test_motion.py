import io
import subprocess
import sys
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from model.motion import motion as motion_module
from model.motion.motion import Motion, load_motion, save_motion
from model.storage import npz
from model.storage.files import WriteError, written_atomically
from model.storage.npz import MotionError
from tests.helpers import ROOT, beat2_folder, smooth_motion_example


def valid_arrays(num_frames: int = 5) -> dict[str, np.ndarray]:
    return {
        "poses": np.full((num_frames, 165), 0.1),
        "trans": np.ones((num_frames, 3)),
        "expressions": np.zeros((num_frames, 100)),
        "betas": np.zeros(300, dtype=np.float32),
        "mocap_frame_rate": np.array(30),
        "gender": np.array("neutral"),
        "model": np.array("smplx2020"),
    }


def assert_refused(path: Path, *words: str) -> None:
    with pytest.raises(MotionError) as caught:
        load_motion(path)
    sentence = str(caught.value)
    assert path.name in sentence
    assert sentence.endswith(".") and "\n" not in sentence
    for word in words:
        assert word in sentence


def test_round_trip_keeps_every_number(tmp_path):
    motion = smooth_motion_example()
    save_motion(motion, tmp_path / "a.npz")
    back = load_motion(tmp_path / "a.npz")
    for name in ("poses", "trans", "expressions", "betas"):
        np.testing.assert_array_equal(getattr(back, name), getattr(motion, name))
        assert getattr(back, name).dtype == np.float32
    assert back.expression_basis == "arkit52"
    assert [path.name for path in tmp_path.iterdir()] == ["a.npz"]


def test_written_file_has_the_keys_of_beat2(tmp_path):
    save_motion(smooth_motion_example(), tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz", allow_pickle=False) as arrays:
        assert arrays["poses"].dtype == np.float32
        assert int(arrays["mocap_frame_rate"]) == 30
        assert str(arrays["gender"]) == "neutral"
        assert str(arrays["model"]) == "smplx2020"
        assert str(arrays["expression_basis"]) == "arkit52"


def test_without_a_basis_it_is_flame(tmp_path):
    np.savez(tmp_path / "a.npz", **valid_arrays())
    assert load_motion(tmp_path / "a.npz").expression_basis == "flame100"


@pytest.mark.beat2
def test_real_beat2_clip():
    motion = load_motion(beat2_folder() / "smplxflame_30" / "2_scott_0_1_1.npz")
    assert motion.num_frames == 1906
    assert motion.expression_basis == "flame100"
    assert 1.0 < motion.trans[:, 1].min() < motion.trans[:, 1].max() < 1.5
    rotations = motion.local_rotations()
    assert rotations.shape == (1906, 55, 3, 3)


def test_missing_file_and_folder(tmp_path):
    assert_refused(tmp_path / "none.npz", "does not exist")
    (tmp_path / "folder.npz").mkdir()
    assert_refused(tmp_path / "folder.npz", "folder")


@pytest.mark.parametrize("content", [b"", b"just text", b"PK\x03\x04 broken", b"\x93NUMPY\x01\x00"])
def test_what_is_no_npz(tmp_path, content):
    (tmp_path / "a.npz").write_bytes(content)
    assert_refused(tmp_path / "a.npz", "not a readable npz")


def test_truncated_and_corrupt_files(tmp_path):
    np.savez_compressed(tmp_path / "a.npz", **valid_arrays(200))
    whole = (tmp_path / "a.npz").read_bytes()
    (tmp_path / "cut.npz").write_bytes(whole[: len(whole) // 2])
    assert_refused(tmp_path / "cut.npz", "not a readable npz")
    corrupt = bytearray(whole)
    corrupt[150:400] = bytes(250)
    (tmp_path / "corrupt.npz").write_bytes(corrupt)
    assert_refused(tmp_path / "corrupt.npz")


class Trap:
    """Unpickling one of these would be noticed."""

    sprung = False

    def __reduce__(self):
        return (setattr, (Trap, "sprung", True))


@pytest.mark.parametrize("key", ["poses", "extra"])
def test_pickled_objects_are_never_loaded(tmp_path, key):
    arrays = valid_arrays() | {key: np.array([Trap()], dtype=object)}
    np.savez(tmp_path / "a.npz", **arrays)
    assert_refused(tmp_path / "a.npz", "pickled", key)
    assert not Trap.sprung


@pytest.mark.parametrize("key", ["poses", "trans", "expressions", "betas", "mocap_frame_rate"])
def test_a_missing_key_is_named(tmp_path, key):
    arrays = valid_arrays()
    del arrays[key]
    np.savez(tmp_path / "a.npz", **arrays)
    assert_refused(tmp_path / "a.npz", f"lacks {key}")


@pytest.mark.parametrize(
    ("key", "shape"),
    [
        ("poses", (5, 156)), ("poses", (5, 55, 3)), ("poses", ()), ("trans", (5,)),
        ("trans", (5, 4)), ("expressions", (5, 50)), ("betas", (10,)), ("mocap_frame_rate", (2,)),
    ],
)  # fmt: skip
def test_wrong_shapes(tmp_path, key, shape):
    np.savez(tmp_path / "a.npz", **valid_arrays() | {key: np.zeros(shape)})
    assert_refused(tmp_path / "a.npz", f"`{key}`", str(shape))


def test_arrays_of_different_length(tmp_path):
    np.savez(tmp_path / "a.npz", **valid_arrays() | {"trans": np.zeros((4, 3))})
    assert_refused(tmp_path / "a.npz", "4 frames", "5")


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("key", ["poses", "trans", "expressions", "betas"])
def test_values_that_are_not_finite(tmp_path, key, value):
    arrays = valid_arrays()
    arrays[key][2 if key != "betas" else 0, ...] = value
    np.savez(tmp_path / "a.npz", **arrays)
    assert_refused(tmp_path / "a.npz", "not finite", key)


def test_values_no_float32_can_hold(tmp_path):
    np.savez(tmp_path / "a.npz", **valid_arrays() | {"trans": np.full((5, 3), 1e200)})
    assert_refused(tmp_path / "a.npz", "1e+200")


def test_other_frame_rate(tmp_path):
    np.savez(tmp_path / "a.npz", **valid_arrays() | {"mocap_frame_rate": np.array(60.0)})
    assert_refused(tmp_path / "a.npz", "60 frames per second", "30")


def test_no_frames(tmp_path):
    np.savez(tmp_path / "a.npz", **valid_arrays(0))
    assert_refused(tmp_path / "a.npz", "no frames")


def test_text_where_numbers_belong(tmp_path):
    np.savez(tmp_path / "a.npz", **valid_arrays() | {"trans": np.full((5, 3), "x")})
    assert_refused(tmp_path / "a.npz", "numbers")


@pytest.mark.parametrize("basis", ["mine", 3.0])
def test_unknown_basis(tmp_path, basis):
    np.savez(tmp_path / "a.npz", **valid_arrays(), expression_basis=np.array(basis))
    assert_refused(tmp_path / "a.npz", "basis")


def npy_header(shape: tuple[int, ...], descr: str = "<f8") -> bytes:
    buffer = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        buffer, {"shape": shape, "fortran_order": False, "descr": descr}
    )
    return buffer.getvalue()


def test_a_header_that_promises_more_than_the_file_holds(tmp_path):
    np.savez(tmp_path / "a.npz", **{k: v for k, v in valid_arrays().items() if k != "poses"})
    with zipfile.ZipFile(tmp_path / "a.npz", "a") as archive:
        archive.writestr("poses.npy", npy_header((10**12, 165)))
    assert_refused(tmp_path / "a.npz", "damaged", "poses")


def test_an_entry_that_is_no_array(tmp_path):
    np.savez(tmp_path / "a.npz", **valid_arrays())
    with zipfile.ZipFile(tmp_path / "a.npz", "a") as archive:
        archive.writestr("readme.txt", "hello")
    assert_refused(tmp_path / "a.npz", "readme.txt", "not an array")


def test_a_zip_bomb_is_refused_before_it_is_unpacked(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        with archive.open("poses.npy", "w") as file:
            for _ in range(npz.MAX_BYTES // 2**20 + 1):
                file.write(bytes(2**20))
    assert (tmp_path / "a.npz").stat().st_size < 2**20
    assert_refused(tmp_path / "a.npz", "513 MiB", "at most 512 MiB")


def test_a_large_file_is_refused_before_it_is_opened(tmp_path):
    with (tmp_path / "a.npz").open("wb") as file:
        file.truncate(200 * 10**6)  # takes no room on the disk, and is no archive
    assert_refused(tmp_path / "a.npz", "191 MiB", "at most 160 MiB")


def test_too_many_frames(tmp_path, monkeypatch):
    monkeypatch.setattr(motion_module, "MAX_FRAMES", 4)
    np.savez(tmp_path / "a.npz", **valid_arrays())
    assert_refused(tmp_path / "a.npz", "5 frames", "at most 4")


def test_motion_refuses_no_frames_and_nan():
    motion = smooth_motion_example()
    none = {name: getattr(motion, name)[:0] for name in ("poses", "trans", "expressions")}
    with pytest.raises(MotionError, match="no frames"):
        replace(motion, **none)
    with pytest.raises(MotionError, match="`trans` holds values that are not finite"):
        replace(motion, trans=motion.trans * np.float32(np.nan))


def test_local_rotations_turn_by_the_pose_angle():
    poses = np.zeros((1, 165), dtype=np.float32)
    poses[0, 45 * 3 + 2] = np.pi / 6
    motion: Motion = replace(smooth_motion_example(1), poses=poses)
    rotation = motion.local_rotations()[0, 45].numpy()
    np.testing.assert_allclose(rotation[0], [0.8660254, -0.5, 0], atol=1e-6)


def test_an_older_file_survives_a_failed_write(tmp_path):
    target = tmp_path / "a.npz"
    target.write_bytes(b"older")
    with pytest.raises(RuntimeError):
        with written_atomically(target) as temporary:
            temporary.write_bytes(b"half")
            raise RuntimeError
    assert target.read_bytes() == b"older"
    assert [path.name for path in tmp_path.iterdir()] == ["a.npz"]


def test_a_full_disk_gives_one_sentence_and_no_file(tmp_path):
    """A real failing write: the operating system refuses to let the file grow over 4 KiB."""
    script = (
        "import resource, sys\n"
        "from model.storage.files import WriteError\n"
        "from model.motion.motion import save_motion\n"
        "from tests.helpers import smooth_motion_example\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))\n"
        "try:\n"
        "    save_motion(smooth_motion_example(), sys.argv[1])\n"
        "except WriteError as error:\n"
        "    sys.stdout.write(str(error))\n"
    )
    target = tmp_path / "a.npz"
    result = subprocess.run(
        [sys.executable, "-c", script, str(target)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    assert (
        result.stdout
        == f"{target} could not be written: it would exceed the largest file size allowed here."
    )
    assert list(tmp_path.iterdir()) == []


def test_the_sentence_for_a_full_disk(tmp_path):
    with pytest.raises(WriteError, match="the disk is full; free some space"):
        with written_atomically(tmp_path / "a"):
            with open("/dev/full", "wb", buffering=0) as full:
                full.write(b"x")


def test_a_folder_that_is_not_there(tmp_path):
    with pytest.raises(WriteError, match="its folder does not exist"):
        save_motion(smooth_motion_example(), tmp_path / "none" / "a.npz")


def test_every_written_key_is_documented(tmp_path):
    save_motion(smooth_motion_example(), tmp_path / "a.npz")
    documented = (ROOT / "docs" / "formats.md").read_text()
    with np.load(tmp_path / "a.npz", allow_pickle=False) as arrays:
        for key in arrays.files:
            assert f"| `{key}` |" in documented
