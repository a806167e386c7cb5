"""One door for all files: by its ending, each has its reader."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from model.formats.numbers import ReadOptions
from model.formats.upright import turned_upright
from model.storage.npz import MotionError

if TYPE_CHECKING:
    from model.formats.numbers import ReadMotion

ENDINGS = (".npz", ".npy", ".bvh")
PICKLES = (".pkl", ".pickle", ".pt", ".pth", ".p", ".joblib")
CONVERT = (
    "python -c \"import pickle,numpy,sys; d=pickle.load(open(sys.argv[1],'rb'));"
    " numpy.savez('motion.npz',**{k:numpy.asarray(v) for k,v in d.items()})\" FILE"
)
"""Run by whoever trusts the file: loading a pickle runs what it says."""


def read_any_motion(path: str | Path, options: ReadOptions | None = None) -> ReadMotion:
    """Read a motion file, and say what was changed.

    Taken are npz files as BEAT2, AMASS and many models write them, ``.npy`` arrays and BVH; see
    ``docs/formats.md``. A body whose up is z is turned.

    Raises:
        MotionError: for all else; one sentence that names the file.
    """
    from model.formats.bvh_reader import read_bvh
    from model.formats.npy_reader import read_npy
    from model.formats.npz_reader import read_npz

    path, options = Path(path), options or ReadOptions()
    ending = path.suffix.lower()
    if ending in PICKLES:
        raise MotionError(
            f"{path.name} is a pickle, which can run programs when it is read, and is never loaded."
            f" If you trust it, convert it yourself: {CONVERT}"
        )
    readers = {".npy": read_npy, ".bvh": read_bvh}
    read = readers.get(ending, read_npz)(path, options)
    return turned_upright(read, path.name)
