"""Headers of archives from strangers."""

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest

from model.formats.read import read_any_motion
from model.motion.motion import save_motion
from model.storage.npz import MotionError
from tests.helpers import smooth_motion_example


def with_header(path: Path, key: str, header: str) -> Path:
    """A motion file whose array ``key`` says that of itself."""
    save_motion(smooth_motion_example(3), path)
    arrays = dict(np.load(path))
    with zipfile.ZipFile(path, "w") as archive:
        for name, array in arrays.items():
            content = io.BytesIO()
            if name == key:
                text = (header + "\n").encode()
                content.write(np.lib.format.magic(1, 0) + len(text).to_bytes(2, "little") + text)
                content.write(array.tobytes())
            else:
                np.save(content, array)
            archive.writestr(f"{name}.npy", content.getvalue())
    return path


@pytest.mark.parametrize("shape", ["(True, 165)", "(-3, -165)", f"(3, {10**399})"])
def test_lengths_that_are_none_are_refused(tmp_path: Path, shape: str):
    path = tmp_path / "it.npz"
    header = f"{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}}}"
    with pytest.raises(MotionError, match=r"`poses` is not an array|not have its stated size"):
        read_any_motion(with_header(path, "poses", header))


def test_names_of_arrays_cannot_move_the_cursor(tmp_path: Path):
    path = tmp_path / "it.npz"
    np.savez(path, **{"\x1b[2J\x1b[1;1HAll is well": np.zeros(3)})
    with pytest.raises(MotionError, match=r"holds \?\[2J") as caught:
        read_any_motion(path)
    assert str(caught.value).isprintable()
