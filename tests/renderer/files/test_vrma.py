"""A .vrma file is read as its specification says, without the program's readers."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from conventions.joints import JOINT_INDEX, JOINT_NAMES
from renderer.body.body import JAW_OPEN_RAD, load_body
from renderer.files.vrma import vrma_bytes
from tests.renderer.body.made_character import VRM_NAMES, lively, named, parse

NUM_FRAMES = 40
BONES = {
    joint: named(joint, VRM_NAMES, "left", "right")
    for joint in JOINT_NAMES
    if joint not in ("jaw", "left_eye", "right_eye")
}


class Read:
    """Content of a .vrma file."""

    def __init__(self, content: bytes) -> None:
        self.document, self._binary = parse(content)
        self.extension = self.document["extensions"]["VRMC_vrm_animation"]
        (animation,) = self.document["animations"]
        self.moved = {
            (channel["target"]["node"], channel["target"]["path"]): self._values(
                animation["samplers"][channel["sampler"]]["output"]
            )
            for channel in animation["channels"]
        }

    def _values(self, index: int) -> np.ndarray:
        accessor = self.document["accessors"][index]
        view = self.document["bufferViews"][accessor["bufferView"]]
        kind = {5126: "<f4", 5122: "<i2"}[accessor["componentType"]]
        width = {"VEC3": 3, "VEC4": 4}[accessor["type"]]
        count = accessor["count"] * width
        values = np.frombuffer(self._binary, kind, count, view["byteOffset"]).reshape(-1, width)
        return values / 32767 if kind == "<i2" else values

    def node(self, bone: str) -> int:
        return self.extension["humanoid"]["humanBones"][bone]["node"]

    def bones(self, is_moving: bool) -> dict[str, tuple[np.ndarray, Rotation]]:
        """Return position and world rotation of each bone, at rest or in each frame."""
        nodes = self.document["nodes"]
        parents = {child: at for at, node in enumerate(nodes) for child in node.get("children", ())}
        world: dict[int, tuple[np.ndarray, Rotation]] = {}
        for at in sorted(self.node(bone) for bone in BONES.values()):
            place, turn = np.array(nodes[at]["translation"]), Rotation.identity()
            if is_moving:
                place = self.moved.get((at, "translation"), place)
                turn = Rotation.from_quat(self.moved[at, "rotation"])
            if at in parents:
                above, parent = world[parents[at]]
                place, turn = above + parent.apply(place), parent * turn
            world[at] = place, turn
        return {joint: world[self.node(bone)] for joint, bone in BONES.items()}


@pytest.fixture(scope="module")
def body():
    return load_body()


@pytest.fixture(scope="module")
def motion():
    return lively(NUM_FRAMES)


@pytest.fixture(scope="module")
def read(body, motion) -> Read:
    return Read(vrma_bytes(body, motion, [(0.5, "beat")]))


def test_bones_rest_in_a_t_pose(read):
    assert read.extension["specVersion"] == "1.0"
    assert set(read.extension["humanoid"]["humanBones"]) == set(BONES.values())
    at = {joint: place for joint, (place, _) in read.bones(is_moving=False).items()}
    thumb = np.sqrt(0.5)
    for side, out in (("left", 1), ("right", -1)):
        for start, end, way in (
            ("shoulder", "elbow", (out, 0, 0)),
            ("elbow", "wrist", (out, 0, 0)),
            ("index1", "index3", (out, 0, 0)),
            ("pinky1", "pinky3", (out, 0, 0)),
            ("thumb1", "thumb3", (out * thumb, 0, thumb)),
            ("hip", "ankle", (0, -1, 0)),
        ):
            bone = at[f"{side}_{end}"] - at[f"{side}_{start}"]
            assert np.allclose(bone / np.linalg.norm(bone), way, atol=1e-6), (side, start)
        foot = at[f"{side}_foot"] - at[f"{side}_ankle"]
        assert foot[2] > 0.1 and abs(foot[0]) < 1e-9
        assert 0.02 < at[f"{side}_foot"][1] < 0.06, "the soles are on the floor"
    palm = np.cross(at["left_index1"] - at["left_wrist"], at["left_pinky1"] - at["left_wrist"])
    assert palm[1] > 0.9 * np.linalg.norm(palm), "palms face down"


def test_every_bone_moves_as_the_body(read, body, motion):
    bones = read.bones(is_moving=True)
    expected = body.joint_positions(motion)
    world = body.global_transforms_without_trans(motion)[0]
    rest = read.bones(is_moving=False)
    for joint, (places, turns) in bones.items():
        index = JOINT_INDEX[joint]
        assert np.linalg.norm(places - expected[:, index], axis=1).max() < 0.001, joint
        if joint.endswith(("spine3", "neck", "head")):  # their T-pose is the zero pose
            assert (turns.inv() * Rotation.from_matrix(world[:, index])).magnitude().max() < 0.009
    assert "left_index3" in rest
    translated = {node for node, path in read.moved if path == "translation"}
    faces = {each["node"] for each in read.extension["expressions"]["preset"].values()}
    assert translated == faces | {read.node("hips")}


def test_body_without_a_knee(body, motion):
    rest = body.rest_joints.copy()
    rest[JOINT_INDEX["left_knee"]] = rest[JOINT_INDEX["left_ankle"]]
    lame = replace(body, rest_joints=rest)
    bones = Read(vrma_bytes(lame, motion)).bones(is_moving=True)
    expected = lame.joint_positions(motion)
    for joint in ("left_knee", "left_ankle", "left_foot"):
        apart = bones[joint][0] - expected[:, JOINT_INDEX[joint]]
        assert np.linalg.norm(apart, axis=1).max() < 0.001, joint


def test_face_moves_by_presets_and_eyes_by_the_gaze(read, body, motion):
    presets = read.extension["expressions"]["preset"]
    weights = {name: read.moved[each["node"], "translation"] for name, each in presets.items()}
    jaw = motion.poses[:, 3 * JOINT_INDEX["jaw"]].clip(0, JAW_OPEN_RAD) / JAW_OPEN_RAD
    opened = (motion.expressions[:, body.expression_names.index("jawOpen")] + jaw).clip(0, 1)
    assert opened.max() > 0.5 and np.abs(weights["aa"][:, 0] - opened).max() < 1e-6
    assert all((0 <= each).all() and (each <= 1).all() for each in weights.values())
    eyes = motion.poses.reshape(-1, 55, 3)[:, [JOINT_INDEX["left_eye"], JOINT_INDEX["right_eye"]]]
    ways = Rotation.from_quat(read.moved[read.extension["lookAt"]["node"], "rotation"])
    both = Rotation.from_rotvec(eyes.reshape(-1, 3)).apply([0, 0, 1]).reshape(-1, 2, 3).mean(axis=1)
    both /= np.linalg.norm(both, axis=1, keepdims=True)
    assert np.abs(ways.apply([0, 0, 1]) - both).max() < 0.05
    markers = read.document["animations"][0]["extras"]["markers"]
    assert json.dumps(markers) == '[{"time": 0.5, "frame": 15, "name": "beat"}]'
