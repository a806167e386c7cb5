"""GLB files, read back and posed by a small reader that shares no code with the writer."""

import json
import struct
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from conventions.joints import JOINT_NAMES
from conventions.views import BODY_BUILDS
from renderer.body.body import Body, BodyMotion, load_body
from renderer.body.body_file import OPEN_BODY_PATH, read_body_npz
from renderer.body.skinning import VertexNormals
from renderer.files.glb import BUILD_OFFSET_STEP_M, body_build_offsets_bytes, glb_bytes
from tests.renderer.body.test_body import max_distance_mm, random_motion, smplx_file

DTYPES = {5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}


@pytest.fixture(scope="module")
def body() -> Body:
    return load_body()


class Glb:
    """The parts of a GLB file as arrays."""

    def __init__(self, content: bytes) -> None:
        magic, version, total = struct.unpack_from("<4sII", content)
        assert (magic, version, total) == (b"glTF", 2, len(content))
        length, kind = struct.unpack_from("<I4s", content, 12)
        assert kind == b"JSON" and length % 4 == 0
        self.document = json.loads(content[20 : 20 + length])
        size, kind = struct.unpack_from("<I4s", content, 20 + length)
        assert kind == b"BIN\0"
        self._binary = content[28 + length :]
        assert len(self._binary) == size == self.document["buffers"][0]["byteLength"]

    def _raw(self, view: int, component: int, shape: tuple[int, ...]) -> np.ndarray:
        offset = self.document["bufferViews"][view]["byteOffset"]
        assert offset % 4 == 0
        count = int(np.prod(shape))
        array = np.frombuffer(self._binary, DTYPES[component], count, offset)
        assert array.nbytes == self.document["bufferViews"][view]["byteLength"]
        return array.reshape(shape)

    def array(self, accessor: int) -> np.ndarray:
        entry = self.document["accessors"][accessor]
        shape = (entry["count"], WIDTHS[entry["type"]])
        if "sparse" in entry:
            sparse = entry["sparse"]
            array = np.zeros(shape)
            indices, values = sparse["indices"], sparse["values"]
            rows = self._raw(indices["bufferView"], indices["componentType"], (sparse["count"],))
            assert (np.diff(rows.astype(int)) > 0).all(), "glTF wants ascending indices"
            values_shape = (sparse["count"], shape[1])
            array[rows] = self._raw(values["bufferView"], entry["componentType"], values_shape)
        else:
            array = self._raw(entry["bufferView"], entry["componentType"], shape).astype(float)
            if entry.get("normalized"):
                array = array / np.iinfo(DTYPES[entry["componentType"]]).max
        if "min" in entry:
            np.testing.assert_allclose(array.min(0), entry["min"], atol=1e-6)
            np.testing.assert_allclose(array.max(0), entry["max"], atol=1e-6)
        return array

    def posed(self, frame: int) -> np.ndarray:
        """Vertices of one key frame by the rules of glTF 2.0."""
        document = self.document
        nodes = [dict(node) for node in document["nodes"]]
        weights = np.array(document["meshes"][0].get("weights", []))
        animation = document["animations"][0]
        for channel in animation["channels"]:
            sampler = animation["samplers"][channel["sampler"]]
            times, values = self.array(sampler["input"]), self.array(sampler["output"])
            values = values.reshape(len(times), -1)[frame]
            target = channel["target"]
            if target["path"] == "weights":
                weights = values
            else:
                nodes[target["node"]][target["path"]] = values
        worlds: dict[int, np.ndarray] = {}

        def place(node: int, parent: np.ndarray) -> None:
            matrix = np.eye(4)
            quaternion = np.array(nodes[node].get("rotation", [0, 0, 0, 1]))
            assert np.linalg.norm(quaternion) == pytest.approx(1, abs=1e-4)
            matrix[:3, :3] = Rotation.from_quat(quaternion).as_matrix()
            matrix[:3, 3] = nodes[node].get("translation", [0, 0, 0])
            worlds[node] = parent @ matrix
            for child in nodes[node].get("children", []):
                place(child, worlds[node])

        for root in document["scenes"][0]["nodes"]:
            place(root, np.eye(4))
        skin, primitive = document["skins"][0], document["meshes"][0]["primitives"][0]
        binds = self.array(skin["inverseBindMatrices"]).reshape(-1, 4, 4).transpose(0, 2, 1)
        matrices = np.stack([worlds[node] for node in skin["joints"]]) @ binds
        attributes = primitive["attributes"]
        rest = self.array(attributes["POSITION"]).copy()
        for weight, target in zip(weights, primitive.get("targets", []), strict=True):
            rest += weight * self.array(target["POSITION"])
        joints = self.array(attributes["JOINTS_0"]).astype(int)
        shares = self.array(attributes["WEIGHTS_0"])
        np.testing.assert_allclose(shares.sum(1), 1, atol=1e-6)
        blended = np.einsum("vk,vkab->vab", shares, matrices[joints])
        return np.einsum("vab,vb->va", blended, np.c_[rest, np.ones(len(rest))])[:, :3]


def test_file_read_back_stands_where_the_body_stands(body):
    motion = random_motion(num_frames=5)
    glb = Glb(glb_bytes(body, motion))
    posed = np.concatenate(list(body.posed_vertices(motion)))
    corrected = body.pose_vertices
    for frame in (0, 4):
        distance_mm = 1e3 * np.linalg.norm(glb.posed(frame) - posed[frame], axis=-1)
        assert np.median(distance_mm) < 0.5
        assert np.delete(distance_mm, corrected).max() < 3, "four joints a vertex, 16 bit turns"
        assert distance_mm.max() < 40, "only pose correctives may be missing"


def test_zero_pose_timing_faces_and_colours_are_exact(body):
    glb = Glb(glb_bytes(body, BodyMotion.zero_pose(31)))
    assert max_distance_mm(glb.posed(1), body.template) < 1e-3
    sampler = glb.document["animations"][0]["samplers"][0]
    np.testing.assert_allclose(glb.array(sampler["input"])[:, 0], np.arange(31) / 30, atol=1e-6)
    primitive = glb.document["meshes"][0]["primitives"][0]
    faces = glb.array(primitive["indices"]).reshape(-1, 3)
    np.testing.assert_array_equal(faces, body.faces)
    colors = glb.array(primitive["attributes"]["COLOR_0"])
    np.testing.assert_allclose(colors[:, :3], body.vertex_colors, atol=1e-4)
    assert [node["name"] for node in glb.document["nodes"][:55]] == list(JOINT_NAMES)


def test_only_expressions_that_move_and_that_the_body_has_are_stored(body):
    expressions = BodyMotion.zero_pose(4).expressions.copy()
    expressions[2, body.expression_names.index("jawOpen")] = 0.8
    motion = replace(BodyMotion.zero_pose(4), expressions=expressions)
    glb = Glb(glb_bytes(body, motion))
    assert glb.document["meshes"][0]["extras"]["targetNames"] == ["jawOpen"]
    (opened,) = body.posed_vertices(motion)
    assert max_distance_mm(glb.posed(2), opened[2]) < 0.01
    assert max_distance_mm(opened[2], opened[1]) > 10
    glb = Glb(glb_bytes(body, random_motion(num_frames=2, basis="flame100")))
    assert "targets" not in glb.document["meshes"][0]["primitives"][0]


def test_body_without_names_or_colours(tmp_path):
    licensed = load_body(smplx_file(tmp_path / "body.npz"))
    motion = random_motion(basis="flame100", num_expressions=10)
    glb = Glb(glb_bytes(licensed, motion))
    assert len(glb.document["meshes"][0]["weights"]) == 10
    assert glb.posed(0).shape == (10, 3)


def test_every_build_comes_back_within_a_step():
    first = read_body_npz(OPEN_BODY_PATH)
    normals_of = VertexNormals(first.faces, len(first.template))
    read = np.frombuffer(body_build_offsets_bytes(), "<i2").reshape(
        len(BODY_BUILDS) - 1, 2, *first.template.shape
    )
    for build, (offsets, normals) in zip(BODY_BUILDS[1:], read, strict=True):
        expected = read_body_npz(OPEN_BODY_PATH, build).template
        assert np.abs(expected - first.template).max() > 0.01, "it is another one"
        np.testing.assert_allclose(
            first.template + BUILD_OFFSET_STEP_M * offsets, expected, atol=BUILD_OFFSET_STEP_M
        )
        np.testing.assert_allclose(normals / 32_767, normals_of(expected), atol=2e-5)
