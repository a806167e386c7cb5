"""Reading of any motion file, with a record of each assumption that was needed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float

from model.formats.bvh_reader import read_bvh
from model.formats.convention_detection import finish_import
from model.formats.numpy_reader import CONVERT_PICKLE_COMMAND, read_npy, read_npz
from model.formats.reading import ImportedMotion, ImportOverrides
from model.storage.npz import MotionError, open_archive, read_array, read_headers

ENDINGS = (".npz", ".npy", ".bvh")
PICKLES = (".pkl", ".pickle", ".pt", ".pth", ".p", ".joblib", ".ckpt")
_MAGIC = {b"PK\x03\x04": ".npz", b"\x93NUMPY": ".npy", b"HIERARCHY": ".bvh"}
_CONVERSION_HINTS = {
    ".fbx": "export it as BVH from Blender",
    ".glb": "export it as BVH from Blender",
    ".gltf": "export it as BVH from Blender",
    ".json": "save its arrays with numpy.savez",
    ".csv": "save its arrays with numpy.savez",
    ".c3d": "fit SMPL-X to its markers (SOMA, MoSh++)",
}


def read_any_motion(
    path: str | Path,
    overrides: ImportOverrides | None = None,
    body: Path | None = None,
    *names: str,
) -> ImportedMotion:
    """Read a motion file, with all assumptions about it.

    Supported are npz files as BEAT2, AMASS and many models write them, ``.npy`` arrays and BVH; see
    ``docs/formats.md``.

    Args:
        overrides: what the user states about files (`parse_import_overrides`).
        names: names of this file in ``overrides``, besides its own name and stem.

    Raises:
        MotionError: for all else; one sentence that names the file.

    Example:
        >>> imported = read_any_motion("examples/procedural_speaker/a_procedural_speaker.npz")
        >>> imported.motion.num_frames, imported.source_fps
        (420, 30.0)
        >>> print(imported.assumptions[0].sentence("speaker"))
        speaker: rotations axis-angle, 3 numbers per joint.
    """
    path = Path(path)
    of_file = (overrides or ImportOverrides()).for_file(path.name, path.stem, *names)
    hands = read_mean_hand_pose(body)
    try:
        return read_with_raw_errors(path, of_file, hands)
    except MotionError as error:
        if path.name in str(error):
            raise
        raise MotionError(f"{path.name}: {error}") from error
    except (ArithmeticError, LookupError, TypeError, ValueError) as error:
        raise MotionError(
            f"{path.name} cannot be read: it is damaged or has an unknown layout"
            f" ({type(error).__name__}). Save it again, or in another format"
            f" ({', '.join(ENDINGS)})."
        ) from error


def read_with_raw_errors(
    path: Path, overrides: dict[str, str], hands: Float[np.ndarray, "30 3"] | None = None
) -> ImportedMotion:
    """Read a motion file; unexpected content raises errors that are not for users."""
    reader = {".npy": read_npy, ".bvh": read_bvh, ".npz": read_npz}[_kind(path)]
    return finish_import(reader(path, overrides), hands)


def _kind(path: Path) -> str:
    """Return the file type by suffix, or by first bytes if unknown; raises MotionError."""
    ending = path.suffix.lower()
    if ending in PICKLES:
        raise MotionError(
            f"{path.name} is a pickle file, which could run code when read, so it is never loaded. "
            f"If you trust it, convert it with: {CONVERT_PICKLE_COMMAND}."
        )
    if ending in ENDINGS or not path.is_file():
        kind = ending if ending in ENDINGS else ".npz"
        if kind != ".npz" and not path.is_file():
            raise MotionError(f"{path.name} does not exist; give a motion file.")
        return kind
    with path.open("rb") as file:
        start = file.read(16)
    kind = next((kind for magic, kind in _MAGIC.items() if start.startswith(magic)), None)
    if kind is None:
        way = _CONVERSION_HINTS.get(ending, "save it in one of these formats")
        raise MotionError(
            f"{path.name} is not a supported motion file ({', '.join(ENDINGS)}); {way}."
        )
    return kind


def read_mean_hand_pose(body: Path | None) -> Float[np.ndarray, "30 3"] | None:
    """Read a SMPL-X file's mean hand pose (30, 3), None if it has none; raises MotionError."""
    if body is None or body.suffix.lower() != ".npz":
        return None
    with open_archive(body) as archive:
        headers = read_headers(archive, body.name, allow_objects=True)
        keys = ("hands_meanl", "hands_meanr")
        if any(key not in headers or headers[key][1].kind != "f" for key in keys):
            return None
        hands = [read_array(archive, key) for key in keys]
    if any(hand.size != 45 for hand in hands):
        return None
    return np.concatenate([hand.reshape(15, 3) for hand in hands]).astype(np.float64)
