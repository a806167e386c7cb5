"""Reader of binary glTF 2.0 files (.glb, .vrm): nodes, arrays and pictures, with limits.

Files are uploads of strangers. Only the file's own binary chunk is read: URIs are never followed.
Damaged structure ends in any of Python's errors; `read_character` makes one sentence of them.
"""

from __future__ import annotations

import io
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64
from PIL import Image
from scipy.spatial.transform import Rotation

from renderer.body.body_file import MAX_VERTICES, BodyError

MAX_FILE_BYTES = 50_000_000
MAX_JSON_BYTES = 10_000_000
MAX_NODES = 5_000
MAX_PICTURE_PIXELS = 4096 * 4096
MAX_ELEMENTS = 6 * MAX_VERTICES
"""Most elements of one accessor: the corners of the most faces."""
COMPRESSIONS = {"KHR_draco_mesh_compression": "Draco", "EXT_meshopt_compression": "meshopt"}
"""Extensions that compress meshes, which are refused, by their usual names."""

_KINDS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


def read_glb_bytes(path: Path) -> bytes:
    """Read a character's file; raises BodyError if it is too large, or OSError."""
    num_bytes = path.stat().st_size
    if num_bytes > MAX_FILE_BYTES:
        raise BodyError(
            f"{path.name} is {num_bytes / 1e6:.0f} MB; the limit for a character is "
            f"{MAX_FILE_BYTES / 1e6:.0f} MB. Export it with smaller textures."
        )
    return path.read_bytes()


class Gltf:
    """Parsed file, with trees of nodes; raises BodyError if it is no glTF, or compressed."""

    def __init__(self, content: bytes, name: str) -> None:
        self.name = name
        if len(content) < 20 or content[:4] != b"glTF":
            raise BodyError(f"{name} is not a binary glTF; export it as .glb or .vrm.")
        self.version, length, json_bytes = struct.unpack_from("<III", content, 4)
        if self.version != 2 or content[16:20] != b"JSON" or length > len(content):
            raise BodyError(
                f"{name} is not a complete glTF 2.0 file; export it again as .glb or .vrm."
            )
        if json_bytes > MAX_JSON_BYTES:
            raise BodyError(
                f"The JSON part of {name} is {json_bytes / 1e6:.0f} MB; "
                f"the limit is {MAX_JSON_BYTES / 1e6:.0f} MB."
            )
        self.document: dict[str, Any] = json.loads(content[20 : 20 + json_bytes])
        self.binary = content[28 + json_bytes : length]
        for extension, usual in COMPRESSIONS.items():
            if extension in self.document.get("extensionsUsed", ()):
                raise BodyError(
                    f"{name} is compressed with {usual}, which cannot be read; "
                    "export it without mesh compression."
                )
        self.nodes: list[dict] = self.document["nodes"]
        if len(self.nodes) > MAX_NODES:
            raise BodyError(f"{name} has {len(self.nodes)} nodes; the limit is {MAX_NODES}.")
        self.parents, self.order = self._tree()
        self.local = np.array([_local_matrix(node) for node in self.nodes])
        self.world = self.local.copy()
        """Matrix (4, 4) of each node to the scene."""
        for node in self.order:
            if self.parents[node] >= 0:
                self.world[node] = self.world[self.parents[node]] @ self.local[node]
        if not np.isfinite(self.world).all():
            raise BodyError(
                f"{name} is damaged: the position of a node is not finite; export it again."
            )

    def _tree(self) -> tuple[list[int], list[int]]:
        """Return the parent of each node, and the nodes depth first; refuse cycles."""
        parents = [-1] * len(self.nodes)
        for index, node in enumerate(self.nodes):
            for child in node.get("children", ()):
                if child < 0 or parents[child] >= 0:
                    raise BodyError(
                        f"{self.name} is damaged: node {child} has two parents; export it again."
                    )
                parents[child] = index
        order: list[int] = []
        waiting = [index for index, parent in enumerate(parents) if parent < 0][::-1]
        while waiting:
            order.append(waiting.pop())
            waiting += self.nodes[order[-1]].get("children", ())[::-1]
        if len(order) < len(parents):
            raise BodyError(f"{self.name} is damaged: its nodes form a cycle; export it again.")
        return parents, order

    def element(self, list_name: str, index: int) -> dict:
        """Return an object of a list of the document; raises IndexError for negative indices."""
        if index < 0:
            raise IndexError(index)
        return self.document[list_name][index]

    def accessor_array(self, index: int) -> np.ndarray:
        """Return an accessor's values (N, width); normalised integers as floats."""
        accessor = self.element("accessors", index)
        kind, width = np.dtype(_KINDS[accessor["componentType"]]), _WIDTHS[accessor["type"]]
        count = accessor["count"]
        if not 0 <= count <= MAX_ELEMENTS:
            raise BodyError(
                f"{self.name} has an array of {count} elements; the limit is {MAX_ELEMENTS}."
            )
        values = np.zeros((count, width), kind)
        if "bufferView" in accessor:
            offset = accessor.get("byteOffset", 0)
            values[:] = self._view(accessor["bufferView"], offset, kind, count, width)
        if sparse := accessor.get("sparse"):
            at, new, changed = sparse["indices"], sparse["values"], min(sparse["count"], count)
            places = np.dtype(_KINDS[at["componentType"]])
            rows = self._view(at["bufferView"], at.get("byteOffset", 0), places, changed, 1)[:, 0]
            values[rows] = self._view(
                new["bufferView"], new.get("byteOffset", 0), kind, changed, width
            )
        if accessor.get("normalized") and kind.kind != "f":
            return np.maximum(values / np.float32(np.iinfo(kind).max), -1).astype(np.float32)
        return values

    def _view(self, index: int, offset: int, kind: np.dtype, count: int, width: int) -> np.ndarray:
        """Return values within the binary chunk; numpy raises ValueError beyond its end."""
        view = self.element("bufferViews", index)
        if view.get("buffer", 0) != 0 or "uri" in self.document["buffers"][0]:
            raise BodyError(
                f"{self.name} stores data in other files, which are never opened; "
                "export it as one .glb or .vrm."
            )
        stride = view.get("byteStride") or kind.itemsize * width
        if min(offset, view.get("byteOffset", 0), stride, count) < 0:
            raise BodyError(
                f"{self.name} is damaged: an array starts before the beginning of the file; export "
                "it again."
            )
        start = view.get("byteOffset", 0) + offset
        return np.ndarray(
            (count, width), kind, self.binary, start if count else 0, (stride, kind.itemsize)
        )

    def image(self, index: int, max_px: int) -> Image.Image | None:
        """Return a picture as RGBA of at most ``max_px`` per side; None if it cannot be read."""
        image = self.element("images", index)
        if "bufferView" not in image:
            return None
        view = self.element("bufferViews", image["bufferView"])
        content = self._view(image["bufferView"], 0, np.dtype("u1"), view["byteLength"], 1)
        try:
            picture = Image.open(io.BytesIO(content.tobytes()), formats=("PNG", "JPEG", "WEBP"))
            if picture.width * picture.height > MAX_PICTURE_PIXELS:
                raise BodyError(
                    f"A texture of {self.name} has {picture.width} x {picture.height} pixels; "
                    "the limit is 4096 x 4096. Export it with smaller textures."
                )
            picture.draft("RGB", (max_px, max_px))  # decodes a large JPEG at a smaller size
            picture = picture.convert("RGBA")
        except (OSError, SyntaxError, struct.error, Image.DecompressionBombError):
            return None
        picture.thumbnail((max_px, max_px))
        return picture


def _local_matrix(node: dict) -> Float64[np.ndarray, "4 4"]:
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    matrix = np.eye(4)
    quaternion = np.array(node.get("rotation", (0, 0, 0, 1)), np.float64)
    if np.linalg.norm(quaternion) > 1e-9:
        matrix[:3, :3] = Rotation.from_quat(quaternion).as_matrix()
    matrix[:3, :3] *= np.array(node.get("scale", (1, 1, 1)), np.float64)
    matrix[:3, 3] = node.get("translation", (0, 0, 0))
    return matrix
