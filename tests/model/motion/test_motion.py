"""Motion files: written whole or not at all, read back to the bit, refused in a sentence."""

import io
import resource
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model.motion import motion as motion_module
from model.motion.motion import load_motion, save_motion
from model.storage import npz
from model.storage.files import WriteError, written_atomically
from model.storage.npz import MotionError
from tests.helpers import ROOT, beat2_folder, smooth_motion_example
from tests.model.motion.made import about, posed

Arrays = dict[str, np.ndarray]


def valid_arrays(num_frames: int = 5) -> Arrays:
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
    assert path.name in sentence and sentence.endswith(".") and sentence.isprintable()
    for word in words:
        assert word in sentence


def test_a_file_has_the_keys_of_beat2_and_keeps_every_number(tmp_path):
    motion, path = smooth_motion_example(), tmp_path / "a.npz"
    save_motion(motion, path)
    back = load_motion(path)
    for name in ("poses", "trans", "expressions", "betas"):
        np.testing.assert_array_equal(getattr(back, name), getattr(motion, name))
        assert getattr(back, name).dtype == np.float32
    assert back.expression_basis == "arkit52" and list(tmp_path.iterdir()) == [path]
    told = {"mocap_frame_rate": 30, "gender": "neutral", "model": "smplx2020"}
    with np.load(path, allow_pickle=False) as arrays:
        assert {key: arrays[key].item() for key in told} == told
        for key in arrays.files:
            assert f"| `{key}` |" in (ROOT / "docs" / "formats.md").read_text()
    np.savez(path, **valid_arrays())
    assert load_motion(path).expression_basis == "flame100"  # where nothing is said


@pytest.mark.beat2
def test_real_beat2_clip():
    motion = load_motion(beat2_folder() / "smplxflame_30" / "2_scott_0_1_1.npz")
    assert motion.num_frames == 1906 and motion.expression_basis == "flame100"
    assert 1.0 < motion.trans[:, 1].min() < motion.trans[:, 1].max() < 1.5


def test_what_is_no_archive_is_refused(tmp_path):
    assert_refused(tmp_path / "none.npz", "does not exist")
    (tmp_path / "folder.npz").mkdir()
    assert_refused(tmp_path / "folder.npz", "folder")
    for content in (b"", b"just text", b"PK\x03\x04 broken", b"\x93NUMPY\x01\x00"):
        (tmp_path / "a.npz").write_bytes(content)
        assert_refused(tmp_path / "a.npz", "not a readable npz")


@settings(max_examples=30, deadline=None, derandomize=True)
@given(st.floats(0, 1, exclude_max=True), st.integers(0, 255))
def test_every_prefix_of_a_file_is_refused_and_a_wrong_byte_breaks_nothing(
    tmp_path_factory, share, byte
):
    path = tmp_path_factory.mktemp("damaged") / "a.npz"
    np.savez_compressed(path, **valid_arrays(20))
    whole = path.read_bytes()
    at = int(share * len(whole))
    path.write_bytes(whole[:at])
    assert_refused(path, "not a readable npz")
    path.write_bytes(whole[:at] + bytes([byte]) + whole[at + 1 :])
    try:
        load_motion(path)
    except MotionError as error:
        assert "a.npz" in str(error)


class Trap:
    """Unpickling one of these would be noticed."""

    sprung = False

    def __reduce__(self):
        return (setattr, (Trap, "sprung", True))


def given_key(key: str, value: object) -> Callable[[Arrays], Arrays]:
    return lambda arrays: arrays | {key: np.asarray(value)}


def with_value(key: str, value: float) -> Callable[[Arrays], Arrays]:
    def change(arrays: Arrays) -> Arrays:
        arrays[key].flat[-1] = value
        return arrays

    return change


TRAP = np.array([Trap()], dtype=object)
REFUSED = [
    *(
        (lambda arrays, key=key: {k: v for k, v in arrays.items() if k != key}, f"lacks {key}")
        for key in ("poses", "trans", "expressions", "betas", "mocap_frame_rate")
    ),
    *(
        (given_key(key, np.zeros(shape)), f"`{key}` must have the shape")
        for key, shape in (
            ("poses", (5, 156)), ("poses", (5, 55, 3)), ("poses", ()), ("trans", (5,)),
            ("trans", (5, 4)), ("expressions", (5, 50)), ("betas", (10,)),
        )
    ),
    *(
        (with_value(key, value), f"`{key}` holds values that are not finite (NaN or {where}")
        for key, where in (("poses", "infinite), first in frame 4"), ("betas", "infinite)."))
        for value in (np.nan, np.inf)
    ),
    (given_key("poses", TRAP), "pickled Python objects in `poses`"),
    (given_key("extra", TRAP), "pickled Python objects in `extra`"),
    (given_key("trans", np.zeros((4, 3))), "`trans` must have the shape (5, 3); it has (4, 3)"),
    (given_key("trans", np.full((5, 3), 1e200)), "1e+200"),
    (given_key("trans", np.full((5, 3), "x")), "must hold numbers"),
    (given_key("mocap_frame_rate", 60.0), "has 60 frames per second; resample it to 30"),
    (given_key("mocap_frame_rate", [30, 30]), "has 30 and 30 frames per second"),
    (lambda _: valid_arrays(0), "no frames"),
    (given_key("expression_basis", "mine"), "the expression basis 'mine'"),
    (given_key("expression_basis", 3.0), "must be a single string"),
]  # fmt: skip


@pytest.mark.parametrize(("change", "says"), REFUSED)
def test_arrays_that_are_no_motion_are_refused_by_name(tmp_path, change, says):
    np.savez(tmp_path / "a.npz", **change(valid_arrays()))
    assert_refused(tmp_path / "a.npz", says)
    assert not Trap.sprung


@pytest.mark.parametrize("shape", ["(True, 165)", "(-3, -165)", f"(3, {10**399})", "(10**12, 165)"])
def test_headers_that_lie_about_lengths_are_refused(tmp_path, shape):
    path, arrays = tmp_path / "a.npz", valid_arrays()
    poses = arrays.pop("poses")
    np.savez(path, **arrays)
    shape = shape.replace("10**12", str(10**12))
    text = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}}}\n".encode()
    content = io.BytesIO()
    content.write(np.lib.format.magic(1, 0) + len(text).to_bytes(2, "little") + text)
    content.write(poses.tobytes())
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("poses.npy", content.getvalue())
    assert_refused(path, "is damaged: `poses`")


def test_entries_that_are_no_arrays_and_names_that_move_the_cursor_are_refused(tmp_path):
    path = tmp_path / "a.npz"
    np.savez(path, **{"\x1b[2J\x1b[1;1HAll is well": np.zeros(3)})
    assert_refused(path, "holds ?[2J")
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("readme.txt", "hello")
    assert_refused(path, "holds `readme.txt`, which is not an array")


def test_what_is_too_large_is_refused_before_it_is_unpacked(tmp_path, monkeypatch):
    path = tmp_path / "a.npz"
    with path.open("wb") as file:
        file.truncate(200 * 10**6)  # takes no room on the disk, and is not an archive
    assert_refused(path, "191 MiB", "the limit is 160 MiB")
    assert npz.MAX_BYTES == 512 * 2**20
    monkeypatch.setattr(npz, "MAX_BYTES", 2**20)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("poses.npy", bytes(3 * 2**20))
    assert_refused(path, "3 MiB in 1 arrays", "the limits are 1 MiB")
    np.savez(path, **{str(k): np.zeros(1) for k in range(65)})
    assert_refused(path, "in 65 arrays", "1 MiB and 64 arrays")
    monkeypatch.setattr(motion_module, "MAX_FRAMES", 5)
    np.savez(path, **valid_arrays(5))
    assert load_motion(path).num_frames == 5
    np.savez(path, **valid_arrays(6))
    assert_refused(path, "6 frames; at most 5")


def test_a_motion_refuses_no_frames_and_nan():
    motion = smooth_motion_example()
    with pytest.raises(MotionError, match="no frames"):
        motion.part(slice(0))
    with pytest.raises(MotionError, match="`trans` holds values that are not finite"):
        replace(motion, trans=motion.trans * np.float32(np.nan))


def test_local_rotations_turn_by_the_pose_angle():
    rotation = posed(1, right_middle3=about(2, np.pi / 6)).local_rotations()[0, 45]
    np.testing.assert_allclose(rotation[0], [0.8660254, -0.5, 0], atol=1e-6)


def test_an_older_file_survives_a_failed_write(tmp_path):
    target = tmp_path / "a.npz"
    target.write_bytes(b"older")
    with pytest.raises(RuntimeError), written_atomically(target) as temporary:
        temporary.write_bytes(b"half")
        raise RuntimeError
    assert target.read_bytes() == b"older" and list(tmp_path.iterdir()) == [target]


def test_writes_that_the_system_refuses_give_one_sentence_and_no_file(tmp_path):
    """Real failing writes: no file may grow over 4 KiB, a disk is full, a folder is not there."""
    target, limits = tmp_path / "a.npz", resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, limits[1]))
    try:
        with pytest.raises(WriteError) as caught:
            save_motion(smooth_motion_example(), target)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert str(caught.value) == (
        f"{target} could not be written: it would exceed the largest file size allowed here."
    )
    with pytest.raises(WriteError, match="the disk is full; free some space"):
        with written_atomically(target), open("/dev/full", "wb", buffering=0) as full:
            full.write(b"x")
    with pytest.raises(WriteError, match="its folder does not exist"):
        save_motion(smooth_motion_example(), tmp_path / "none" / "a.npz")
    assert list(tmp_path.iterdir()) == []
