"""Reading a body from disk: the open body, or a licensed SMPL-X ``.npz``, and what is wrong with
it.

Both become one :class:`BodyArrays`. Nothing in a file is ever unpickled (licensed files hold a few
pickled arrays, which are not needed to pose the body), and no memory is taken before the size of an
array is known.
"""

import hashlib
import math
import tokenize
import zipfile
import zlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float32, Int32, Int64

from conventions.joints import NUM_JOINTS, PARENTS
from conventions.views import BUILDS
from renderer.body.look import REGION_NAMES

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


OPEN_BODY_PATH = Path(__file__).parents[1] / "assets" / "open_body.npz"
OPEN_BODY_FORMAT = 2

MAX_UNPACKED_BYTES = 4 << 30
NUM_POSE_FEATURES = 9 * (NUM_JOINTS - 1)
MAX_EXPRESSIONS = 100


_DAMAGE = (
    zipfile.BadZipFile,
    zlib.error,
    EOFError,
    KeyError,
    NotImplementedError,  # a compression that zipfile does not know
    OSError,
    RuntimeError,  # an encrypted member
    SyntaxError,  # an array header that is no literal
    tokenize.TokenError,
    UnicodeDecodeError,
)
"""What a damaged archive raises while it is read."""


@dataclass(frozen=True, eq=False)
class BodyArrays:
    """What linear blend skinning needs, in metres, y up, in the zero pose."""

    name: str
    sha256: str
    expression_basis: str
    """Which motion files may drive the face: ``arkit52`` (open body) or ``flame100`` (SMPL-X)."""
    expression_names: tuple[str, ...]
    """Names of the expression components where the file gives them, else empty."""
    template: Float32[np.ndarray, "V 3"]
    faces: Int32[np.ndarray, "F 3"]
    weights: sp.csr_array
    """(V, 55): share of each joint in the motion of each vertex; rows sum to one."""
    rest_joints: Float32[np.ndarray, "J 3"]
    shape_dirs: Float32[np.ndarray, "V 3 B"]
    """Vertex offset per unit of each beta; B = 0 on the open body."""
    shape_joints: Float32[np.ndarray, "J 3 B"]
    expression_vertices: Int32[np.ndarray, " M"]
    """Vertices that any expression moves."""
    expression_dirs: Float32[np.ndarray, "E M 3"]
    expression_joints: Float32[np.ndarray, "E J 3"]
    pose_vertices: Int32[np.ndarray, " P"]
    """Vertices that have pose correctives."""
    pose_dirs: sp.csr_array | Float32[np.ndarray, "P3 N"]
    """(3 P, 486): corrective offset per entry of (R - I) of joints 1 to 54; sparse or dense."""
    regions: Int32[np.ndarray, " V"] | None
    """Index of the painted region of each vertex (``renderer.body.look``), if the file has it."""

    @cached_property
    def main_joints(self) -> Int64[np.ndarray, " V"]:
        """The joint that each vertex follows most."""
        return self.weights.toarray().argmax(axis=1)  # 50 times as fast as of a sparse matrix


def read_body_file(path: Path, build: str = BUILDS[0]) -> BodyArrays:
    """The arrays of the body in ``path``.

    Args:
        build: which of its builds, where the file is an open body.

    Raises:
        BodyError: if the file is missing, no body, damaged, or not SMPL-X shaped.
    """
    if not path.is_file():
        raise BodyError(f"There is no body file at {path}.")
    try:
        with zipfile.ZipFile(path) as archive:
            unpacked = sum(member.file_size for member in archive.infolist())
    except _DAMAGE as error:
        raise BodyError(
            f"{path.name} is no body file: an SMPL-X .npz is needed "
            "(a .pkl body has to be downloaded again as .npz)."
        ) from error
    if unpacked > MAX_UNPACKED_BYTES:
        raise BodyError(
            f"{path.name} would unpack to {unpacked / 2**30:.1f} GiB; "
            f"a body has at most {MAX_UNPACKED_BYTES >> 30} GiB."
        )
    with path.open("rb") as file:
        sha256 = hashlib.file_digest(file, "sha256").hexdigest()
    try:
        with np.load(path, allow_pickle=False) as archive:
            reader = BodyNpz(path.name, archive)
            arrays = (
                _open_body(reader, sha256, build)
                if "open_body_format" in archive.files
                else _licensed_body(reader, path.stem, sha256)
            )
    except _DAMAGE as error:
        raise BodyError(f"{path.name} is damaged and cannot be read as a body.") from error
    _check(path.name, arrays)
    return arrays


def _open_body(reader: BodyNpz, sha256: str, build: str) -> BodyArrays:
    version = int(reader.integers("open_body_format"))
    if version != OPEN_BODY_FORMAT:
        raise BodyError(
            f"{reader.file_name} is an open body of format {version}; "
            f"this version reads format {OPEN_BODY_FORMAT}."
        )
    template = _of_build(reader, build)
    num_vertices = len(template)
    joints = reader.indices("weight_joints", NUM_JOINTS, num_vertices, None)
    shares = reader.floats("weight_shares", *joints.shape)
    shares /= np.maximum(shares.sum(1, keepdims=True), 1)
    rows = np.repeat(np.arange(num_vertices), joints.shape[1])
    used = shares.ravel() > 0
    weights = sp.csr_array(
        (shares.ravel()[used], (rows[used], joints.ravel()[used])),
        shape=(num_vertices, NUM_JOINTS),
    )
    names = reader.names("expression_names")
    moved = reader.indices("expression_vertices", num_vertices, None)
    steps = reader.floats("expression_steps", len(names))
    levels = reader.integers("expression_levels", len(names), len(moved), 3)
    corrected = reader.indices("pose_vertices", num_vertices, None)
    return BodyArrays(
        name="open body",
        sha256=sha256,
        expression_basis="arkit52",
        expression_names=names,
        template=template,
        faces=reader.faces("faces", num_vertices),
        weights=weights,
        rest_joints=reader.floats("rest_joints", NUM_JOINTS, 3),
        shape_dirs=np.zeros((num_vertices, 3, 0), np.float32),
        shape_joints=np.zeros((NUM_JOINTS, 3, 0), np.float32),
        expression_vertices=moved,
        expression_dirs=levels.astype(np.float32) * steps[:, None, None],
        expression_joints=np.zeros((len(names), NUM_JOINTS, 3), np.float32),
        pose_vertices=np.unique(corrected).astype(np.int32),
        pose_dirs=_sparse_pose_dirs(
            corrected,
            reader.indices("pose_joints", NUM_JOINTS, len(corrected)),
            reader.floats("pose_offsets", len(corrected), 3, 9),
        ),
        regions=reader.indices("regions", len(REGION_NAMES), num_vertices),
    )


def _of_build(reader: BodyNpz, build: str) -> Float32[np.ndarray, "V 3"]:
    """The template of the first build, moved to ``build`` where that is another."""
    template = reader.template("template")
    if build == BUILDS[0]:
        return template
    names = reader.names("build_names")
    if build not in names:
        known = ", ".join((BUILDS[0], *names))
        raise BodyError(f"{reader.file_name} has no build '{build}'; it has {known}.")
    steps = reader.floats("build_steps", len(names))
    levels = reader.integers("build_levels", len(names), *template.shape)
    index = names.index(build)
    return template + levels[index].astype(np.float32) * steps[index]


def _sparse_pose_dirs(
    vertices: Int32[np.ndarray, " K"],
    joints: Int32[np.ndarray, " K"],
    offsets: Float32[np.ndarray, "K 3 9"],
) -> sp.csr_array:
    """(3 P, 486) matrix from blocks: ``offsets[k]`` moves vertex k by (R - I) of its joint."""
    corrected, row = np.unique(vertices, return_inverse=True)
    rows = (3 * row[:, None] + np.arange(3))[:, :, None]
    columns = (9 * (joints[:, None] - 1) + np.arange(9))[:, None, :]
    rows, columns = (np.broadcast_to(index, offsets.shape).ravel() for index in (rows, columns))
    return sp.csr_array(
        (offsets.ravel(), (rows, columns)), shape=(3 * len(corrected), NUM_POSE_FEATURES)
    )


def _licensed_body(reader: BodyNpz, name: str, sha256: str) -> BodyArrays:
    template = reader.template("v_template")
    num_vertices = len(template)
    kintree = reader.integers("kintree_table", 2, None)
    if kintree.shape[1] != NUM_JOINTS:
        raise BodyError(
            f"{reader.file_name} has {kintree.shape[1]} joints; SMPL-X has {NUM_JOINTS} "
            "(SMPL and SMPL-H files do not fit)."
        )
    if tuple(kintree[0, 1:]) != PARENTS[1:]:
        raise BodyError(f"{reader.file_name}: 'kintree_table' is not the joint tree of SMPL-X.")
    shape_dirs = reader.floats("shapedirs", num_vertices, 3, None)
    # 2019 files: 10 betas, then expressions. 2020 files: 300 betas, then 100 expressions.
    num_betas = 300 if shape_dirs.shape[2] > 300 else min(10, shape_dirs.shape[2])
    expressions = shape_dirs[:, :, num_betas : num_betas + MAX_EXPRESSIONS]
    regressor = reader.floats("J_regressor", NUM_JOINTS, num_vertices)
    moved = np.flatnonzero(np.abs(expressions).max(axis=(1, 2), initial=0) > 0)
    posedirs = reader.floats("posedirs", num_vertices, 3, NUM_POSE_FEATURES)
    corrected = np.flatnonzero(np.abs(posedirs).max(axis=(1, 2)) > 0)
    betas = np.ascontiguousarray(shape_dirs[:, :, :num_betas])
    return BodyArrays(
        name=name,
        sha256=sha256,
        expression_basis="flame100",
        expression_names=(),
        template=template,
        faces=reader.faces("f", num_vertices),
        weights=sp.csr_array(reader.floats("weights", num_vertices, NUM_JOINTS)),
        rest_joints=regressor @ template,
        shape_dirs=betas,
        shape_joints=np.einsum("jv,vcb->jcb", regressor, betas, optimize=True),
        expression_vertices=moved.astype(np.int32),
        expression_dirs=np.ascontiguousarray(expressions[moved].transpose(2, 0, 1)),
        expression_joints=np.einsum("jv,vce->ejc", regressor, expressions, optimize=True),
        pose_vertices=corrected.astype(np.int32),
        pose_dirs=np.ascontiguousarray(posedirs[corrected].reshape(-1, NUM_POSE_FEATURES)),
        regions=None,
    )


def _check(file_name: str, arrays: BodyArrays) -> None:
    row_sums = arrays.weights.sum(axis=1)
    if np.abs(row_sums - 1).max() > 0.01:
        raise BodyError(f"{file_name}: the skinning weights of a vertex do not sum to one.")
