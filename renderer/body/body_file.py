"""Reader of body files: the open body, or a licensed SMPL-X ``.npz``, with checks.

Both become one :class:`BodyArrays`. Nothing in a file is ever unpickled (licensed files have a few
pickled arrays, which are not needed to pose the body).
"""

from __future__ import annotations

import hashlib
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float32, Float64, Int32, Int64, Shaped

from conventions.joints import NUM_JOINTS, PARENTS
from conventions.views import BODY_BUILDS

if TYPE_CHECKING:
    from renderer.body.texture import Texture

MAX_VERTICES = 100_000
MAX_FACES = 200_000


class BodyError(ValueError):
    """Error of a body file or motion that cannot be posed; the message is one sentence."""


OPEN_BODY_PATH = Path(__file__).parents[1] / "assets" / "open_body.npz"
OPEN_BODY_FORMAT = 2

NUM_POSE_FEATURES = 9 * (NUM_JOINTS - 1)
MAX_EXPRESSIONS = 100


@dataclass(frozen=True, eq=False)
class Rig:
    """Bones and blendshapes of a character in its file, by which an animation is written into it.

    A position of the file becomes one of the body by
    ``file_to_body_scale * R_file_to_body @ position``, and a translation.
    """

    path: Path
    joint_nodes: tuple[int, ...]
    """Node of each SMPL-X joint, -1 where the character has none."""
    R_rest_to_zero_pose: Float64[np.ndarray, "J 3 3"]
    """World rotation of each joint, in our axes, from the file's rest pose to the zero pose."""
    R_file_to_body: Float64[np.ndarray, "3 3"]
    file_to_body_scale: float
    target_weights: dict[int, dict[int, dict[int, float]]]
    """Weight of each expression component, by mesh and by target of the mesh."""


@dataclass(frozen=True, eq=False)
class BodyArrays:
    """Arrays of linear blend skinning, in metres, y up, in the zero pose."""

    name: str
    sha256: str
    expression_basis: str
    """Expression basis of motions that can move the face: ``arkit52`` (open body) or ``flame100``.
    """
    expression_names: tuple[str, ...]
    """Names of the expression components; empty if the file has none."""
    template: Float32[np.ndarray, "V 3"]
    faces: Int32[np.ndarray, "F 3"]
    weights: sp.csr_array
    """Skinning weights (V, 55); rows sum to one."""
    rest_joints: Float32[np.ndarray, "J 3"]
    shape_dirs: Float32[np.ndarray, "V 3 B"]
    """Vertex offset per unit of each beta; B = 0 on the open body."""
    shape_joint_dirs: Float32[np.ndarray, "J 3 B"]
    expression_vertices: Int32[np.ndarray, " M"]
    """Indices of vertices that any expression moves."""
    expression_dirs: Float32[np.ndarray, "E M 3"]
    expression_joint_dirs: Float32[np.ndarray, "E J 3"]
    pose_vertices: Int32[np.ndarray, " P"]
    """Indices of vertices with pose correctives."""
    pose_dirs: sp.csr_array | Float32[np.ndarray, "P3 N"]
    """Corrective offsets (3 P, 486) per entry of (R - I) of joints 1 to 54; sparse or dense."""
    regions: Int32[np.ndarray, " V"] | None
    """Index of the painted region of each vertex (``renderer.body.look``); None without regions."""
    texture: Texture | None = None
    """Colours and texture of a character; None for other bodies."""
    jaw_component: int | None = None
    """Expression component that opens the mouth of a character without a jaw bone."""
    rig: Rig | None = None
    """Bones of a character in its file; None for other bodies."""
    remarks: tuple[str, ...] = ()
    """Sentences on how a character was read."""

    @cached_property
    def dominant_joints(self) -> Int64[np.ndarray, " V"]:
        """Joint with the largest weight, for each vertex."""
        return self.weights.toarray().argmax(axis=1)  # 50 times as fast as with a sparse matrix


def read_body_npz(path: Path, body_build: str = BODY_BUILDS[0]) -> BodyArrays:
    """Read and check the arrays of a body file; an open body has several builds.

    Raises BodyError if the file is missing, no body, damaged, or not SMPL-X shaped.
    """
    if not path.is_file():
        raise BodyError(f"There is no body file at {path}.")
    if not zipfile.is_zipfile(path):
        raise BodyError(
            f"{path.name} is not a body file: an SMPL-X .npz is needed "
            "(a .pkl body has to be downloaded again as .npz)."
        )
    with path.open("rb") as file:
        sha256 = hashlib.file_digest(file, "sha256").hexdigest()
    try:
        with np.load(path, allow_pickle=False) as archive:
            if "open_body_format" in archive.files:
                arrays = _open_body(archive, path.name, sha256, body_build)
            else:
                arrays = _licensed_body(archive, path, sha256)
    except BodyError:
        raise
    except Exception as error:  # zipfile and numpy's header reader raise many kinds of errors
        raise BodyError(
            f"{path.name} is damaged and cannot be read as a body; download it again."
        ) from error
    if np.abs(arrays.weights.sum(axis=1) - 1).max() > 0.01:
        raise BodyError(f"{path.name}: the skinning weights of a vertex do not sum to one.")
    return arrays


def _open_body(
    file: Mapping[str, Shaped[np.ndarray, " ..."]], name: str, sha256: str, build: str
) -> BodyArrays:
    """Convert the arrays of `tools.bake`, which are trusted except for their format."""
    version = int(file["open_body_format"])
    if version != OPEN_BODY_FORMAT:
        raise BodyError(
            f"{name} is an open body of format {version}; "
            f"this program reads format {OPEN_BODY_FORMAT}."
        )
    template = file["template"].astype(np.float32)
    num_vertices = len(template)
    builds = [BODY_BUILDS[0], *map(str, file["build_names"])]
    if at := builds.index(build):
        levels, steps = file["build_levels"], file["build_steps"].astype(np.float32)
        template = template + levels[at - 1].astype(np.float32) * steps[at - 1]
    joints, shares = file["weight_joints"], file["weight_shares"].astype(np.float32)
    shares /= np.maximum(shares.sum(1, keepdims=True), 1)
    rows = np.repeat(np.arange(num_vertices), joints.shape[1])
    used = shares.ravel() > 0
    weights = sp.csr_array(
        (shares.ravel()[used], (rows[used], joints.ravel()[used])), shape=(num_vertices, NUM_JOINTS)
    )
    names = tuple(map(str, file["expression_names"]))
    steps = file["expression_steps"].astype(np.float32)
    corrected = file["pose_vertices"].astype(np.int32)
    return BodyArrays(
        name="open body",
        sha256=sha256,
        expression_basis="arkit52",
        expression_names=names,
        template=template,
        faces=file["faces"].astype(np.int32),
        weights=weights,
        rest_joints=file["rest_joints"].astype(np.float32),
        shape_dirs=np.zeros((num_vertices, 3, 0), np.float32),
        shape_joint_dirs=np.zeros((NUM_JOINTS, 3, 0), np.float32),
        expression_vertices=file["expression_vertices"].astype(np.int32),
        expression_dirs=file["expression_levels"].astype(np.float32) * steps[:, None, None],
        expression_joint_dirs=np.zeros((len(names), NUM_JOINTS, 3), np.float32),
        pose_vertices=np.unique(corrected),
        pose_dirs=_sparse_pose_dirs(
            corrected, file["pose_joints"].astype(np.int32), file["pose_offsets"].astype(np.float32)
        ),
        regions=file["regions"].astype(np.int32),
    )


def _sparse_pose_dirs(
    vertices: Int32[np.ndarray, " K"],
    joints: Int32[np.ndarray, " K"],
    offsets: Float32[np.ndarray, "K 3 9"],
) -> sp.csr_array:
    """Build a (3 P, 486) matrix from blocks: ``offsets[k]`` moves vertex k by its joint's R - I."""
    corrected, row = np.unique(vertices, return_inverse=True)
    rows = (3 * row[:, None] + np.arange(3))[:, :, None]
    columns = (9 * (joints[:, None] - 1) + np.arange(9))[:, None, :]
    rows, columns = (np.broadcast_to(index, offsets.shape).ravel() for index in (rows, columns))
    return sp.csr_array(
        (offsets.ravel(), (rows, columns)), shape=(3 * len(corrected), NUM_POSE_FEATURES)
    )


def _licensed_body(
    file: Mapping[str, Shaped[np.ndarray, " ..."]], path: Path, sha256: str
) -> BodyArrays:
    """Convert and check the arrays of a downloaded SMPL-X file."""

    def numbers(key: str, *shape: int | None) -> np.ndarray:
        """Return the checked array ``key``; ``None`` in ``shape`` leaves that axis free."""
        try:
            array = file[key]
        except KeyError:
            raise BodyError(
                f"{path.name} is not an SMPL-X body: it has no array '{key}'."
            ) from None
        except ValueError as error:
            if "Object arrays" not in str(error):
                raise
            raise BodyError(
                f"{path.name} holds '{key}' as a pickled object, which is not opened because it "
                "could run code; use the .npz of the SMPL-X download page."
            ) from error
        fits = len(array.shape) == len(shape) and all(
            want in (None, have) for want, have in zip(shape, array.shape, strict=True)
        )
        if not fits:
            wanted = ", ".join("any" if size is None else str(size) for size in shape)
            raise BodyError(f"{path.name}: '{key}' has shape {array.shape}; ({wanted}) is needed.")
        if array.dtype.kind not in "fiu":
            raise BodyError(f"{path.name}: '{key}' holds {array.dtype}, not numbers.")
        if not np.isfinite(array).all():
            raise BodyError(f"{path.name}: '{key}' holds values that are not finite.")
        return array.astype(np.float32 if array.dtype.kind == "f" else np.int64, copy=False)

    def floats(key: str, *shape: int | None) -> np.ndarray:
        return numbers(key, *shape).astype(np.float32, copy=False)

    template, faces = floats("v_template", None, 3), numbers("f", None, 3)
    num_vertices = len(template)
    for what, count, most in (
        ("vertices", num_vertices, MAX_VERTICES),
        ("faces", len(faces), MAX_FACES),
    ):
        if not 0 < count <= most:
            raise BodyError(f"{path.name} has {count} {what}; 1 to {most} can be drawn.")
    outside = faces[(faces < 0) | (faces >= num_vertices)]
    if outside.size:
        raise BodyError(
            f"{path.name}: 'f' refers to vertex {outside[0]:g}, but the vertices are 0 to "
            f"{num_vertices - 1}."
        )
    kintree = numbers("kintree_table", 2, None)
    if kintree.shape[1] != NUM_JOINTS:
        raise BodyError(
            f"{path.name} has {kintree.shape[1]} joints; SMPL-X has {NUM_JOINTS} "
            "(SMPL and SMPL-H files cannot be used)."
        )
    if tuple(kintree[0, 1:]) != PARENTS[1:]:
        raise BodyError(f"{path.name}: 'kintree_table' is not the joint tree of SMPL-X.")
    shape_dirs = floats("shapedirs", num_vertices, 3, None)
    # 2019 files: 10 betas, then expressions. 2020 files: 300 betas, then 100 expressions.
    num_betas = 300 if shape_dirs.shape[2] > 300 else min(10, shape_dirs.shape[2])
    expressions = shape_dirs[:, :, num_betas : num_betas + MAX_EXPRESSIONS]
    regressor = floats("J_regressor", NUM_JOINTS, num_vertices)
    moved = np.flatnonzero(np.abs(expressions).max(axis=(1, 2), initial=0) > 0)
    posedirs = floats("posedirs", num_vertices, 3, NUM_POSE_FEATURES)
    corrected = np.flatnonzero(np.abs(posedirs).max(axis=(1, 2)) > 0)
    betas = np.ascontiguousarray(shape_dirs[:, :, :num_betas])
    return BodyArrays(
        name=path.stem,
        sha256=sha256,
        expression_basis="flame100",
        expression_names=(),
        template=template,
        faces=faces.astype(np.int32),
        weights=sp.csr_array(floats("weights", num_vertices, NUM_JOINTS)),
        rest_joints=regressor @ template,
        shape_dirs=betas,
        shape_joint_dirs=np.einsum("jv,vcb->jcb", regressor, betas, optimize=True),
        expression_vertices=moved.astype(np.int32),
        expression_dirs=np.ascontiguousarray(expressions[moved].transpose(2, 0, 1)),
        expression_joint_dirs=np.einsum("jv,vce->ejc", regressor, expressions, optimize=True),
        pose_vertices=corrected.astype(np.int32),
        pose_dirs=np.ascontiguousarray(posedirs[corrected].reshape(-1, NUM_POSE_FEATURES)),
        regions=None,
    )
