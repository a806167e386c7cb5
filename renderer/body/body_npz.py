"""Plain arrays out of a body's npz, with one sentence for whatever is wrong with them.

Nothing is ever unpickled, and no memory is taken before the size of an array is known.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float32, Int32

MAX_VERTICES = 100_000
MAX_FACES = 200_000


class BodyError(ValueError):
    """A body file or a motion that cannot be posed; the message is one sentence for a person."""


class BodyNpz:
    """Plain arrays of one npz by name, each failure as a sentence that names file and key."""

    def __init__(self, file_name: str, archive: np.lib.npyio.NpzFile) -> None:
        self.file_name = file_name
        self._archive = archive
        assert archive.zip is not None  # open as long as the archive is
        self._members = archive.zip

    def array(self, key: str, *shape: int | None) -> np.ndarray:
        """The array ``key``; ``None`` in ``shape`` leaves that axis free."""
        if key not in self._archive.files:
            raise BodyError(f"{self.file_name} is no SMPL-X body: it has no array '{key}'.")
        found, dtype = self._header(key)
        if dtype.hasobject:
            raise BodyError(
                f"{self.file_name} holds '{key}' as a pickled object, which is not opened because "
                "it could run code; use the .npz of the SMPL-X download page."
            )
        fits = len(found) == len(shape) and all(
            want in (None, have) for want, have in zip(shape, found, strict=True)
        )
        if not fits:
            wanted = ", ".join("any" if size is None else str(size) for size in shape)
            raise BodyError(f"{self.file_name}: '{key}' has shape {found}; ({wanted}) is needed.")
        try:
            return self._archive[key]
        except ValueError as error:
            raise BodyError(f"{self.file_name}: the array '{key}' is damaged.") from error

    def _header(self, key: str) -> tuple[tuple[int, ...], np.dtype]:
        """Shape and type of an array, before any memory is taken for it."""
        entry = self._members.getinfo(f"{key}.npy")
        try:
            with self._members.open(entry) as stream:
                version = np.lib.format.read_magic(stream)
                read = np.lib.format.read_array_header_1_0
                if version != (1, 0):
                    read = np.lib.format.read_array_header_2_0
                shape, _, dtype = read(stream)
        except ValueError as error:
            raise BodyError(f"{self.file_name}: the array '{key}' is damaged.") from error
        if not dtype.hasobject and math.prod(shape) * dtype.itemsize > entry.file_size:
            raise BodyError(f"{self.file_name}: the array '{key}' is cut short.")
        return shape, dtype

    def template(self, key: str) -> Float32[np.ndarray, "V 3"]:
        vertices = self.floats(key, None, 3)
        if not 0 < len(vertices) <= MAX_VERTICES:
            raise BodyError(
                f"{self.file_name} has {len(vertices)} vertices; 1 to {MAX_VERTICES} can be drawn."
            )
        return vertices

    def faces(self, key: str, num_vertices: int) -> Int32[np.ndarray, "F 3"]:
        faces = self.indices(key, num_vertices, None, 3)
        if not 0 < len(faces) <= MAX_FACES:
            raise BodyError(
                f"{self.file_name} has {len(faces)} faces; 1 to {MAX_FACES} can be drawn."
            )
        return faces

    def floats(self, key: str, *shape: int | None) -> np.ndarray:
        array = self.array(key, *shape)
        if array.dtype.kind not in "fiu":
            raise BodyError(f"{self.file_name}: '{key}' holds {array.dtype}, not numbers.")
        result = array.astype(np.float32, copy=False)
        if not np.isfinite(result).all():
            raise BodyError(f"{self.file_name}: '{key}' holds values that are not finite.")
        return result

    def names(self, key: str) -> tuple[str, ...]:
        return tuple(str(name) for name in self.array(key, None))

    def integers(self, key: str, *shape: int | None) -> np.ndarray:
        array = self.array(key, *shape)
        if array.dtype.kind not in "iu":
            raise BodyError(f"{self.file_name}: '{key}' holds {array.dtype}, not integers.")
        return array.astype(np.int64)

    def indices(self, key: str, count: int, *shape: int | None) -> np.ndarray:
        """Integers of which each names one of ``count`` things."""
        array = self.integers(key, *shape)
        outside = array[(array < 0) | (array >= count)]
        if outside.size:
            raise BodyError(
                f"{self.file_name}: '{key}' names number {outside[0]}, but only 0 to {count - 1} "
                "exist."
            )
        return array.astype(np.int32)
