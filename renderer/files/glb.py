"""GLB export: body, colours and motion in one binary glTF 2.0 file; and offsets of other bodies.

Metres, y up, 30 frames a second. The mesh is skinned with the four strongest joints of each vertex,
and face expressions are morph targets. The camera of the front view is included, framed and
following as in a video. glTF has no pose correctives, so elbows, knees and shoulders fold a little
less cleanly than in the videos.

Other builds are little-endian 16-bit integers; for each of `BODY_BUILDS` after the first: offsets
of all vertices at rest to the first build, in steps of ``BUILD_OFFSET_STEP_M``, then their unit
normals, in steps of 1 / 32767. All builds share skeleton, topology, weights and face.
"""

from __future__ import annotations

import io
import json
import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Float32, Integer, Shaped, UInt
from PIL import Image
from scipy.spatial.transform import Rotation

from conventions.joints import JOINT_NAMES, NUM_JOINTS, PARENTS
from conventions.rates import FPS
from conventions.views import BODY_BUILDS
from renderer.body.body import Body, BodyMotion
from renderer.body.body_file import OPEN_BODY_PATH, read_body_npz
from renderer.body.skinning import VertexNormals
from renderer.scene.camera import Z_NEAR_M
from renderer.scene.camera_setup import CameraSetup, make_camera_setup

ASSET = {"version": "2.0", "generator": "co-speech motion app"}
INFLUENCES = 4
SMALLEST_EXPRESSION = 1e-3
"""Expression weight below which, in all frames, a component is left out."""

_BODY_NODE, _CAMERA_NODE = NUM_JOINTS, NUM_JOINTS + 1  # after the joints
_CAMERA_VIEW = "front"
_ARRAY_BUFFER, _ELEMENT_BUFFER = 34962, 34963
_COMPONENTS = {"float32": 5126, "uint32": 5125, "uint16": 5123, "int16": 5122, "uint8": 5121}
_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


def glb_bytes(
    body: Body,
    motion: BodyMotion,
    coarser_faces: Sequence[UInt[np.ndarray, "_ 3"]] = (),
    markers: Sequence[tuple[float, str]] = (),
) -> bytes:
    """Return the file as bytes: about 0.25 MB per 10 s of motion, and 1.5 MB for the body.

    ``coarser_faces`` are of meshes with fewer faces for slow viewers, which no node shows.
    """
    vertices, joints = body.shaped_vertices_and_joints(motion)
    buffer = GlbBinary()
    offsets = joints - np.where(np.array(PARENTS)[:, None] >= 0, joints[list(PARENTS)], 0)
    nodes: list[dict] = [
        {"name": name, "translation": offsets[joint].tolist()}
        for joint, name in enumerate(JOINT_NAMES)
    ]
    for joint in range(1, NUM_JOINTS):
        nodes[PARENTS[joint]].setdefault("children", []).append(joint)
    inverse_binds = np.tile(np.eye(4, dtype=np.float32), (NUM_JOINTS, 1, 1))
    inverse_binds[:, 3, :3] = -joints  # glTF stores matrices column by column
    skin = {
        "joints": list(range(NUM_JOINTS)),
        "skeleton": 0,
        "inverseBindMatrices": buffer.add_accessor(inverse_binds.reshape(-1, 16)),
    }
    used = _used_expressions(body, motion)
    mesh = _mesh(buffer, body, vertices, used)
    stage = make_camera_setup(body, [motion], _CAMERA_VIEW)
    channels = _channels(buffer, body, motion, stage, offsets[0], nodes, used)
    camera = stage.camera
    lens = {"yfov": camera.yfov_rad, "aspectRatio": 1.0, "znear": Z_NEAR_M}
    nodes.append({"name": "body", "mesh": 0, "skin": 0})
    nodes.append(
        {
            "name": "camera",
            "camera": 0,
            "translation": list(camera.eye),
            "rotation": Rotation.from_matrix(camera.axes().T).as_quat().tolist(),
        }
    )
    material: dict = {
        "pbrMetallicRoughness": {"metallicFactor": 0, "roughnessFactor": 0.75},
        "doubleSided": True,
    }
    pictured: dict = {}
    if body.texture is not None:
        picture = io.BytesIO()
        Image.fromarray(body.texture.pixels).save(picture, "WEBP", quality=88, method=1)
        view = buffer.add_buffer_view(np.frombuffer(picture.getvalue(), np.uint8))
        material["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 0}
        material |= {"alphaMode": "MASK", "alphaCutoff": 0.5}
        pictured = {
            "images": [{"bufferView": view, "mimeType": "image/webp"}],
            "textures": [{"extensions": {"EXT_texture_webp": {"source": 0}}}],
            "extensionsUsed": ["EXT_texture_webp"],
        }
    return buffer.to_glb(
        **pictured,
        asset=ASSET,
        scene=0,
        scenes=[{"nodes": [0, _BODY_NODE, _CAMERA_NODE]}],
        nodes=nodes,
        cameras=[{"type": "perspective", "perspective": lens}],
        skins=[skin],
        meshes=[mesh, *(_coarser_mesh(buffer, mesh, faces) for faces in coarser_faces)],
        materials=[material],
        animations=[make_animation(buffer, motion.num_frames, channels, markers)],
    )


def join_glb_chunks(document: dict, binary: bytes) -> bytes:
    """Join the two chunks of a binary glTF file."""
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    total = 12 + 8 + len(text) + 8 + len(binary)
    return b"".join(
        [
            struct.pack("<4sII", b"glTF", 2, total),
            struct.pack("<I4s", len(text), b"JSON"),
            text,
            struct.pack("<I4s", len(binary), b"BIN\0"),
            binary,
        ]
    )


class GlbBinary:
    """Binary part of a GLB, with its buffer views and accessors."""

    def __init__(self, document: dict[str, Any] | None = None, binary: bytes = b"") -> None:
        """Start with the content of another file, or with nothing."""
        self._document = {} if document is None else document
        self.content = bytearray(binary + b"\0" * (-len(binary) % 4))
        self.views: list[dict] = self._document.setdefault("bufferViews", [])
        self.accessors: list[dict] = self._document.setdefault("accessors", [])

    def add_accessor(
        self,
        array: Shaped[np.ndarray, " N *C"],
        *,
        target: int | None = None,
        normalized: bool = False,
        bounds: bool = False,
    ) -> int:
        """Add an array of scalars (N,) or vectors (N, C); return the index of its accessor."""
        entry = {"bufferView": self.add_buffer_view(array, target), **_description(array)}
        if normalized:
            entry["normalized"] = True
        if bounds:
            entry["min"] = np.atleast_1d(array.min(0)).tolist()
            entry["max"] = np.atleast_1d(array.max(0)).tolist()
        self.accessors.append(entry)
        return len(self.accessors) - 1

    def add_sparse_accessor(
        self, indices: Integer[np.ndarray, " M"], values: Float32[np.ndarray, "M 3"], count: int
    ) -> int:
        """Add ``count`` vectors, zero except ``values`` at ``indices``; return its index."""
        bounds = np.concatenate([values, np.zeros((1, 3), np.float32)])
        self.accessors.append(
            {
                **_description(values),
                "count": count,
                "min": bounds.min(0).tolist(),
                "max": bounds.max(0).tolist(),
                "sparse": {
                    "count": len(indices),
                    "indices": {
                        "bufferView": self.add_buffer_view(indices, None),
                        "componentType": _COMPONENTS[indices.dtype.name],
                    },
                    "values": {"bufferView": self.add_buffer_view(values, None)},
                },
            }
        )
        return len(self.accessors) - 1

    def add_rotations(self, rotations: Rotation) -> int:
        """Add the rotations of a node (T) as 16-bit quaternions; return their accessor's index."""
        quaternions = rotations.as_quat()
        # Players interpolate the short way between neighbours of the same sign.
        signs = np.where((quaternions[1:] * quaternions[:-1]).sum(axis=1) < 0, -1, 1)
        quaternions[1:] *= np.cumprod(signs)[:, None]
        return self.add_accessor(np.round(quaternions * 32767).astype(np.int16), normalized=True)

    def to_glb(self, **parts: Any) -> bytes:
        """Return the file with these parts of its document."""
        buffers = [{"byteLength": len(self.content)}, *self._document.get("buffers", ())[1:]]
        return join_glb_chunks(self._document | parts | {"buffers": buffers}, bytes(self.content))

    def add_buffer_view(self, array: Shaped[np.ndarray, " ..."], target: int | None = None) -> int:
        """Add the bytes of an array; return the index of their buffer view."""
        view = {"buffer": 0, "byteOffset": len(self.content), "byteLength": array.nbytes}
        if target is not None:
            view["target"] = target
        self.views.append(view)
        self.content += np.ascontiguousarray(array).tobytes()
        self.content += b"\0" * (-len(self.content) % 4)
        return len(self.views) - 1


def _description(array: Shaped[np.ndarray, " N *C"]) -> dict:
    width = array.shape[1] if array.ndim == 2 else 1
    return {
        "componentType": _COMPONENTS[array.dtype.name],
        "count": len(array),
        "type": _TYPES[width],
    }


def _used_expressions(body: Body, motion: BodyMotion) -> list[int]:
    """Return the indices of expression components that move in this motion and affect this body."""
    if motion.expression_basis != body.expression_basis:
        return []
    directions = body.expression_dirs
    strongest = np.abs(motion.expressions[:, : len(directions)]).max(0)
    moving = (directions != 0).any(axis=(1, 2))
    return np.flatnonzero((strongest > SMALLEST_EXPRESSION) & moving).tolist()


def _mesh(
    buffer: GlbBinary, body: Body, vertices: Float32[np.ndarray, "V 3"], used: list[int]
) -> dict:
    num_vertices = body.num_vertices
    texture = body.texture
    normals_of = VertexNormals(body.faces, num_vertices, texture and texture.welds)
    normals = normals_of(vertices).astype(np.float32)
    joints, shares = _four_strongest(body)
    colors = np.full((num_vertices, 4), 65535, np.uint16)
    colors[:, :3] = np.round(body.vertex_colors * 65535)
    index_type = np.uint16 if num_vertices <= 65535 else np.uint32
    moved = body.expression_vertices.astype(index_type)
    primitive: dict = {
        "attributes": {
            "POSITION": buffer.add_accessor(vertices, target=_ARRAY_BUFFER, bounds=True),
            "NORMAL": buffer.add_accessor(normals, target=_ARRAY_BUFFER),
            "COLOR_0": buffer.add_accessor(colors, target=_ARRAY_BUFFER, normalized=True),
            "JOINTS_0": buffer.add_accessor(joints, target=_ARRAY_BUFFER),
            "WEIGHTS_0": buffer.add_accessor(shares, target=_ARRAY_BUFFER, normalized=True),
        },
        "indices": buffer.add_accessor(
            body.faces.astype(index_type).ravel(), target=_ELEMENT_BUFFER
        ),
        "material": 0,
    }
    mesh: dict = {"name": "body", "primitives": [primitive]}
    if texture is not None:
        primitive["attributes"]["TEXCOORD_0"] = buffer.add_accessor(
            texture.uv, target=_ARRAY_BUFFER
        )
    if used:
        primitive["targets"] = [
            {"POSITION": buffer.add_sparse_accessor(moved, body.expression_dirs[k], num_vertices)}
            for k in used
        ]
        mesh["weights"] = [0.0] * len(used)
        names = body.expression_names
        extras: dict = {"targetNames": [names[k] if names else f"expression{k}" for k in used]}
        if body.jaw_component in used:
            extras["jawTarget"] = used.index(body.jaw_component)
        mesh["extras"] = extras
    return mesh


def _coarser_mesh(buffer: GlbBinary, mesh: dict, faces: UInt[np.ndarray, "F 3"]) -> dict:
    """Return a mesh of other faces with the vertices of ``mesh``."""
    indices = buffer.add_accessor(faces.ravel(), target=_ELEMENT_BUFFER)
    attributes = mesh["primitives"][0]["attributes"]
    return {
        "name": f"body of {len(faces)} faces",
        "primitives": [{"attributes": attributes, "indices": indices, "material": 0}],
    }


def _four_strongest(body: Body) -> tuple[np.ndarray, np.ndarray]:
    """Return joint indices (V, 4) uint8 and weights (V, 4) uint16 that sum to 65535."""
    weights = body.weights.toarray()
    joints = np.argsort(-weights, axis=1, kind="stable")[:, :INFLUENCES]
    shares = np.take_along_axis(weights, joints, axis=1)
    levels = np.round(shares / shares.sum(1, keepdims=True) * 65535).astype(np.int64)
    levels[:, 0] += 65535 - levels.sum(1)
    joints = np.where(levels > 0, joints, 0)  # glTF requires joint 0 where the weight is 0
    return joints.astype(np.uint8), levels.astype(np.uint16)


def _channels(
    buffer: GlbBinary,
    body: Body,
    motion: BodyMotion,
    stage: CameraSetup,
    pelvis: Float[np.ndarray, " 3"],
    nodes: list[dict],
    used: list[int],
) -> list[tuple[int, str, int]]:
    """Return the animation's channels; a joint with constant rotation has it in ``nodes``."""
    moved: list[tuple[int, str, int]] = []
    rotvec = motion.poses.reshape(-1, NUM_JOINTS, 3).astype(np.float64)
    for joint in range(NUM_JOINTS):
        rotations = Rotation.from_rotvec(rotvec[:, joint])
        if np.ptp(rotvec[:, joint], axis=0).max() < 1e-7:
            nodes[joint]["rotation"] = rotations[0].as_quat().tolist()
        else:
            moved.append((joint, "rotation", buffer.add_rotations(rotations)))
    positions = (pelvis + motion.trans).astype(np.float32)
    moved.append((0, "translation", buffer.add_accessor(positions)))
    if used:
        weights = np.ascontiguousarray(motion.expressions[:, used], np.float32)
        moved.append((_BODY_NODE, "weights", buffer.add_accessor(weights.ravel())))
    if stage.panel_cameras[0].is_following:
        track = stage.followed_positions(body, motion)[0] + stage.camera.eye
        moved.append((_CAMERA_NODE, "translation", buffer.add_accessor(track.astype(np.float32))))
    return moved


def make_animation(
    buffer: GlbBinary,
    num_frames: int,
    channels: Sequence[tuple[int, str, int]],
    markers: Sequence[tuple[float, str]] = (),
) -> dict[str, Any]:
    """Return an animation of channels: node, path (such as ``rotation``) and accessor.

    glTF has no markers (seconds with names), so they are in the ``extras``, with their frame.
    """
    times = buffer.add_accessor(np.arange(num_frames, dtype=np.float32) / FPS, bounds=True)
    animation: dict[str, Any] = {
        "name": "motion",
        "samplers": [
            {"input": times, "output": output, "interpolation": "LINEAR"} for *_, output in channels
        ],
        "channels": [
            {"sampler": number, "target": {"node": node, "path": path}}
            for number, (node, path, _) in enumerate(channels)
        ],
    }
    if markers:
        animation["extras"] = {
            "markers": [
                {"time": round(seconds, 4), "frame": round(seconds * FPS), "name": name}
                for seconds, name in markers
            ]
        }
    return animation


BUILD_OFFSET_STEP_M = 4e-6
"""Step of the integer offsets (m): offsets of up to 13 cm fit, and those of builds are below 5."""


def body_build_offsets_bytes() -> bytes:
    """Return vertex offsets and normals of all builds after the first; 180 kB per build."""
    first = read_body_npz(OPEN_BODY_PATH)
    normals_of = VertexNormals(first.faces, len(first.template))
    parts: list[np.ndarray] = []
    for build in BODY_BUILDS[1:]:
        template = read_body_npz(OPEN_BODY_PATH, build).template
        parts += [(template - first.template) / BUILD_OFFSET_STEP_M, normals_of(template) * 32_767]
    return b"".join(np.rint(part).astype("<i2").tobytes() for part in parts)
