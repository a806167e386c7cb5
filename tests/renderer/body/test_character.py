"""A character is read as a body that any motion poses, and written with the motion in it."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from conventions.joints import FINGERS, JOINT_NAMES
from renderer.body.body import Body, BodyMotion, load_body
from renderer.body.body_file import BodyError
from renderer.body.gltf import Gltf
from renderer.body.lod import CLUSTERED_FACES, character_lod_faces
from renderer.files.character_glb import character_glb_bytes
from renderer.files.glb import glb_bytes, join_glb_chunks
from tests.renderer.body.made_character import (
    a_pose,
    character,
    degrees_apart,
    lively,
    nearest_vertices,
    parse,
)

MAX_DISTANCE_M, MAX_ANGLE_DEG = 0.001, 0.5
KINDS = ("mixamo", "vrm", "vrm0")


@pytest.fixture(scope="module")
def open_body() -> Body:
    return load_body()


@pytest.fixture(scope="module", params=KINDS)
def read(request, open_body, tmp_path_factory) -> Body:
    suffix = ".glb" if request.param == "mixamo" else ".vrm"
    path = tmp_path_factory.mktemp("character") / f"hero{suffix}"
    path.write_bytes(character(open_body, request.param))
    return load_body(path)


@pytest.mark.parametrize("seconds", [3, pytest.param(60, marks=pytest.mark.slow)])
def test_every_joint_moves_as_the_open_bodys(read, open_body, seconds):
    motion = lively(30 * seconds)
    apart = read.joint_positions(motion) - open_body.joint_positions(motion)
    assert np.linalg.norm(apart, axis=-1).max() < MAX_DISTANCE_M
    world = read.global_transforms_without_trans(BodyMotion.zero_pose())[0]
    rest = open_body.global_transforms_without_trans(
        BodyMotion(a_pose().reshape(1, -1), np.zeros((1, 3)), np.zeros((1, 100)), "arkit52", [])
    )[0]
    assert (
        degrees_apart(world[0] @ read.rig.R_rest_to_zero_pose @ rest[0], np.eye(3)[None])
        < MAX_ANGLE_DEG
    )
    assert np.abs(read.template - open_body.template).max() < 0.001
    assert np.abs((read.weights - open_body.weights).toarray()).max() < 0.1  # the export keeps four
    moved = np.zeros((2, 52, open_body.num_vertices, 3))
    for offsets, body in zip(moved, (read, open_body), strict=True):
        offsets[:, body.expression_vertices] = body.expression_dirs
    assert np.abs(moved[0] - moved[1]).max() < 0.0005


@pytest.mark.parametrize("seconds", [3, pytest.param(60, marks=pytest.mark.slow)])
def test_own_file_moves_as_the_open_body(read, open_body, seconds):
    motion = lively(30 * seconds)
    positions, rotations = played(character_glb_bytes(read, motion), read)
    expected = open_body.joint_positions(motion)
    assert np.linalg.norm(positions - expected, axis=-1).max() < MAX_DISTANCE_M
    truth = open_body.global_transforms_without_trans(motion)[0]
    assert degrees_apart(rotations, truth) < MAX_ANGLE_DEG


def played(content: bytes, body: Body) -> tuple[np.ndarray, np.ndarray]:
    """Play a file's animation: joint positions in our axes, and rotations from the zero pose.

    Nodes are composed as the glTF specification says, without the reader's code for it.
    """
    gltf = Gltf(content, "played.glb")
    document = gltf.document
    (animation,) = document["animations"]
    moved: dict[tuple[int, str], np.ndarray] = {}
    for channel in animation["channels"]:
        sampler = animation["samplers"][channel["sampler"]]
        target = channel["target"]
        moved[target["node"], target["path"]] = gltf.accessor_array(sampler["output"])
    num_frames = len(next(iter(moved.values())))

    def local(node: int) -> np.ndarray:
        described = document["nodes"][node]
        parts = [
            np.broadcast_to(moved.get((node, path), described.get(path, usual)), (num_frames, size))
            for path, usual, size in (
                ("translation", (0, 0, 0), 3),
                ("rotation", (0, 0, 0, 1), 4),
                ("scale", (1, 1, 1), 3),
            )
        ]
        matrix = np.tile(np.eye(4), (num_frames, 1, 1))
        matrix[:, :3, :3] = Rotation.from_quat(parts[1]).as_matrix() * parts[2][:, None, :]
        matrix[:, :3, 3] = parts[0]
        return matrix

    world: dict[int, np.ndarray] = {}
    for node in gltf.order:
        above = world.get(gltf.parents[node], np.eye(4))
        world[node] = above @ local(node)
    rig = body.rig
    positions, rotations = np.zeros((num_frames, 55, 3)), np.zeros((num_frames, 55, 3, 3))
    for joint, node in enumerate(rig.joint_nodes):
        positions[:, joint] = rig.file_to_body_scale * world[node][:, :3, 3] @ rig.R_file_to_body.T
        turned = world[node][:, :3, :3] @ np.linalg.inv(gltf.world[node][:3, :3])
        rotations[:, joint] = (
            rig.R_file_to_body @ turned @ rig.R_file_to_body.T @ rig.R_rest_to_zero_pose[joint].T
        )
    return positions, rotations


RPM = Path(__file__).parents[4] / "shared" / "data" / "characters" / "humanoid_rpm_t.glb"


def test_visitors_figure_has_its_face_and_texture():
    if not RPM.is_file():
        pytest.skip(f"There is no research character at {RPM}.")
    body = load_body(RPM)
    assert body.rig is not None
    assert [
        name for name, node in zip(JOINT_NAMES, body.rig.joint_nodes, strict=True) if node < 0
    ] == ["jaw"]
    assert body.expression_names[body.jaw_component or 0] == "jawOpen"
    assert (np.abs(body.expression_dirs).max(axis=(1, 2)) > 1e-4).sum() == 52
    assert body.texture is not None
    assert max(body.texture.pixels.shape[:2]) <= 2048
    # Dark hair, light skin: each vertex has the texel of its own material.
    rows, columns = (body.texture.uv[:, ::-1] * body.texture.pixels.shape[:2]).astype(int).T
    texels = body.texture.pixels[rows, columns].astype(float)
    crown = body.template[:, 1] > body.template[:, 1].max() - 0.02
    assert texels[crown, :3].mean() < 60
    palm = np.linalg.norm(
        body.template - body.rest_joints[JOINT_NAMES.index("left_index1")], axis=1
    )
    assert texels[palm < 0.02, 0].mean() > 150


def test_character_without_a_face_is_written_for_the_stage(open_body, tmp_path):
    document, binary = parse(character(open_body, "mixamo"))
    for primitive in document["meshes"][0]["primitives"]:
        del primitive["targets"]
    path = tmp_path / "hero.glb"
    path.write_bytes(join_glb_chunks(document, binary))
    body = load_body(path)
    assert "no known blendshapes" in " ".join(body.remarks)
    mesh = parse(glb_bytes(body, lively(2)))[0]["meshes"][0]
    assert "targets" not in mesh["primitives"][0]


def test_coarser_meshes_keep_the_surface_and_every_finger(read):
    meshes = character_lod_faces(read)
    assert all(len(faces) <= most for faces, most in zip(meshes, CLUSTERED_FACES, strict=True))

    def area_m2(faces: np.ndarray) -> float:
        a, b, c = np.moveaxis(read.template[faces], 1, 0)
        return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()) / 2

    for faces in meshes[:3]:  # the last is for shadows
        assert (np.sort(faces, axis=1)[:, :-1] < np.sort(faces, axis=1)[:, 1:]).all()
        assert abs(area_m2(faces) / area_m2(read.faces) - 1) < 0.1
        drawn = {JOINT_NAMES[joint] for joint in read.dominant_joints[faces].ravel()}
        tips = {f"{side}_{finger}3" for side in ("left", "right") for finger in FINGERS}
        assert tips <= drawn


def mutants(content: bytes, count: int, seed: int) -> list[bytes]:
    """Damage a file: single bytes, its end, and values of its description."""
    rng = np.random.default_rng(seed)
    document, binary = parse(content)
    wrong = (-1, 10**12, 0, 2.5, None, "x", [], {}, [1e39] * 3, float("nan"), True, 7)
    found = []
    for number in range(count):
        kind = number % 4
        if kind == 0:
            damaged = bytearray(content)
            for at in rng.integers(0, len(content), 40):
                damaged[at] = rng.integers(256)
            found.append(bytes(damaged))
        elif kind == 1:
            found.append(content[: rng.integers(0, len(content))])
        else:
            changed = json.loads(json.dumps(document))
            place, key = changed, None
            for _ in range(rng.integers(2, 7)):
                keys = list(place) if isinstance(place, dict) else range(len(place))
                if not len(keys):
                    break
                parent, key = place, keys[rng.integers(len(keys))]
                place = place[key]
                if not isinstance(place, dict | list):
                    break
            parent[key] = wrong[rng.integers(len(wrong))]
            found.append(join_glb_chunks(changed, binary))
    return found


@pytest.mark.parametrize("count", [24, pytest.param(600, marks=pytest.mark.slow)])
def test_damaged_file_is_read_or_refused_in_a_sentence(open_body, tmp_path, count):
    small = open_body.submesh(*nearest_vertices(open_body))
    path = tmp_path / "hero.glb"
    for content in mutants(character(small, "vrm"), count, seed=count):
        path.write_bytes(content)
        try:
            body = load_body(path)
        except BodyError as error:
            assert str(error).endswith("."), error
        else:
            assert np.isfinite(body.template).all()
            (vertices,) = body.posed_vertices(lively(1))
            assert np.isfinite(vertices).all()


def positions_of(document: dict) -> dict:
    """Return the accessor of the first mesh's vertices."""
    return document["accessors"][document["meshes"][0]["primitives"][0]["attributes"]["POSITION"]]


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda d: d.update(extensionsUsed=["KHR_draco_mesh_compression"]), "Draco"),
        (lambda d: d.update(extensionsUsed=["EXT_meshopt_compression"]), "meshopt"),
        (lambda d: d["buffers"][0].update(uri="file:///etc/passwd"), "other files"),
        (lambda d: d["nodes"][0].update(children=[0]), "has two parents|form a cycle"),
        (lambda d: d.update(skins=[]), "damaged|no skin"),
        (lambda d: d.update(nodes=[{}] * 6000), "6000 nodes"),
        (lambda d: positions_of(d).update(count=10**9), "100000 vertices"),
    ],
)
def test_refusal_says_what_is_wrong(open_body, tmp_path, change, sentence):
    document, binary = parse(character(open_body, "mixamo"))
    change(document)
    path = tmp_path / "hero.glb"
    path.write_bytes(join_glb_chunks(document, binary))
    with pytest.raises(BodyError, match=sentence):
        load_body(path)
