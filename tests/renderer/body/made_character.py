"""Characters made of the open body: another rig, rest pose, scale and order of the same mesh."""

import json
import struct

import numpy as np
from scipy.spatial.transform import Rotation

from conventions.joints import JOINT_NAMES, NUM_JOINTS, PARENTS
from renderer.body.body import Body, BodyMotion
from renderer.files.glb import GlbBinary, glb_bytes, join_glb_chunks

_FINGER = {name: name.title() for name in ("thumb", "index", "middle", "ring", "pinky")}
_MIXAMO = {
    "pelvis": "Hips", "spine1": "Spine", "spine2": "Spine1", "spine3": "Spine2", "neck": "Neck",
    "head": "Head", "jaw": "Jaw", "collar": "Shoulder", "shoulder": "Arm", "elbow": "ForeArm",
    "wrist": "Hand", "hip": "UpLeg", "knee": "Leg", "ankle": "Foot", "foot": "ToeBase",
    "eye": "Eye",
    **{f"{name}{i}": f"Hand{title}{i}" for name, title in _FINGER.items() for i in (1, 2, 3)},
}  # fmt: skip
VRM_NAMES = {
    "pelvis": "hips", "spine1": "spine", "spine2": "chest", "spine3": "upperChest", "neck": "neck",
    "head": "head", "jaw": "jaw", "collar": "Shoulder", "shoulder": "UpperArm",
    "elbow": "LowerArm", "wrist": "Hand", "hip": "UpperLeg", "knee": "LowerLeg", "ankle": "Foot",
    "foot": "Toes", "eye": "Eye",
    **{
        f"{name}{i}": f"{'Little' if name == 'pinky' else title}{part}"
        for name, title in _FINGER.items()
        for i, part in enumerate(("Proximal", "Intermediate", "Distal"), start=1)
    },
    "thumb1": "ThumbMetacarpal", "thumb2": "ThumbProximal", "thumb3": "ThumbDistal",
}  # fmt: skip


def named(joint: str, table: dict[str, str], left: str, right: str) -> str:
    """Return another rig's name of a joint."""
    side, _, part = joint.partition("_")
    return {"left": left, "right": right}[side] + table[part] if part else table[joint]


def parse(content: bytes) -> tuple[dict, bytes]:
    """Split a GLB file into its document and binary chunk."""
    (length,) = struct.unpack_from("<I", content, 12)
    return json.loads(content[20 : 20 + length]), content[28 + length :]


def _vrm(node: int) -> dict:
    """Return VRM 1.0's description of a character, as yet without bones."""
    shapes = {"aa": 24, "blinkLeft": 8}  # of ARKit's in alphabetical order, as the open body has
    preset = {
        name: {"morphTargetBinds": [{"node": int(node), "index": index, "weight": 1.0}]}
        for name, index in shapes.items()
    }
    meta = {"name": "hero", "authors": ["nobody"], "licenseUrl": "https://vrm.dev/licenses/1.0/"}
    return {
        "specVersion": "1.0",
        "meta": meta,
        "humanoid": {"humanBones": {}},
        "expressions": {"preset": preset},
    }


def nearest_vertices(body: Body) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices and faces of a tenth of the mesh, so that reading is quick."""
    vertices, corners = np.unique(body.faces[::10], return_inverse=True)
    return vertices, corners.reshape(-1, 3)


def lively(num_frames: int, seed: int = 0) -> BodyMotion:
    """Make a motion in which every joint turns by up to 40 degrees and the root travels."""
    rng = np.random.default_rng(seed)
    times = np.arange(num_frames)[:, None] / 30
    waves = rng.uniform(0.2, 1.5, 165), rng.uniform(0, 6, 165), rng.uniform(-0.4, 0.4, 165)
    poses = waves[2] * np.sin(2 * np.pi * waves[0] * times + waves[1])
    trans = 0.3 * np.sin(times + np.arange(3)) + [0, 1.3, 0]
    resting = BodyMotion.zero_pose(num_frames)
    expressions = np.zeros_like(resting.expressions)
    expressions[:, 24] = 0.5 + 0.5 * np.sin(times[:, 0])
    return BodyMotion(poses, trans, expressions, "arkit52", resting.betas)


def degrees_apart(first: np.ndarray, other: np.ndarray) -> float:
    """Return the largest angle between two sets of rotation matrices."""
    between = Rotation.from_matrix((np.swapaxes(first, -1, -2) @ other).reshape(-1, 3, 3))
    return float(np.degrees(between.magnitude().max()))


def a_pose(degrees: float = 48.0) -> np.ndarray:
    """Return local rotations (55, 3) of an A-pose: arms hang, legs stand apart, feet stay flat."""
    poses = np.zeros((NUM_JOINTS, 3))
    for name, angle in (("shoulder", -degrees), ("hip", 6.0), ("ankle", -6.0)):
        for side, sign in (("left", 1.0), ("right", -1.0)):
            poses[JOINT_NAMES.index(f"{side}_{name}"), 2] = np.radians(sign * angle)
    return poses


def character(
    body: Body,
    kind: str,
    seed: int = 0,
    scale: float = 100.0,
    rest_pose: np.ndarray | None = None,
) -> bytes:
    """Return the open body as a file of another program, ``mixamo``, ``vrm`` or ``vrm0``.

    The bones have frames of their own, the rest pose is an A-pose, the nodes are in another order,
    below an armature that is scaled, moved and, for VRM 0.x, turned to face -z.

    Args:
        rest_pose: local rotations (55, 3) of another rest pose.
    """
    rng = np.random.default_rng(seed)
    resting = BodyMotion.zero_pose(2)
    resting.expressions[1, :52] = 1.0  # so that all blendshapes are in the file
    document, binary = parse(glb_bytes(body, resting))
    binds = np.eye(4)[None] + np.zeros((NUM_JOINTS, 1, 1))
    binds[:, :3, 3] = -body.rest_joints
    frames = Rotation.random(NUM_JOINTS, rng=rng)
    pose = Rotation.from_rotvec(a_pose() if rest_pose is None else rest_pose)
    nodes = [{"name": "body", "mesh": 0, "skin": 0}]
    turn = np.pi if kind == "vrm0" else 0.0
    armature = {
        "name": "Armature",
        "scale": [scale] * 3,
        "rotation": Rotation.from_rotvec([0.0, turn, 0.0]).as_quat().tolist(),
        "translation": [3.0, 1.31 * scale, -2.0],
    }
    joints = []
    for joint, parent in enumerate(PARENTS):
        local = pose[joint] * frames[joint]
        offset = body.rest_joints[joint]
        if parent >= 0:
            local = frames[parent].inv() * local
            offset = frames[parent].inv().apply(offset - body.rest_joints[parent])
        joints.append(
            {
                "name": JOINT_NAMES[joint],
                "rotation": local.as_quat().tolist(),
                "translation": offset.tolist(),
            }
        )
        bind = np.eye(4)
        bind[:3, :3] = frames[joint].inv().as_matrix()
        binds[joint] = bind @ binds[joint]
    # A skirt's bone, whose weights its parent's joint gets, and nodes in another order.
    everything = [*nodes, armature, *joints, {"name": "Skirt", "translation": [0, -0.1, 0.1]}]
    parents = [-1, -1, *(1 if p < 0 else p + 2 for p in PARENTS), 2]
    order = rng.permutation(len(everything))
    place = np.argsort(order)
    shuffled = [everything[each] for each in order]
    for index, parent in enumerate(parents):
        if parent >= 0:
            shuffled[place[parent]].setdefault("children", []).append(int(place[index]))
    skin_joints = [int(place[2 + joint]) for joint in range(NUM_JOINTS)]
    names = {
        "mixamo": lambda name: "mixamorig:" + named(name, _MIXAMO, "Left", "Right"),
        "vrm": lambda name: f"J_{JOINT_NAMES.index(name)}",
        "vrm0": lambda name: f"J_{JOINT_NAMES.index(name)}",
    }[kind]
    for name, node in zip(JOINT_NAMES, skin_joints, strict=True):
        shuffled[node]["name"] = names(name)
        bone = named(name, VRM_NAMES, "left", "right")
        if kind == "vrm":
            vrm = document.setdefault("extensions", {}).setdefault("VRMC_vrm", _vrm(place[0]))
            vrm["humanoid"]["humanBones"][bone] = {"node": node}
        elif kind == "vrm0":
            bone = bone.replace("ThumbProximal", "ThumbIntermediate")
            bone = bone.replace("ThumbMetacarpal", "ThumbProximal")
            vrm = document.setdefault("extensions", {}).setdefault("VRM", {})
            bones = vrm.setdefault("humanoid", {}).setdefault("humanBones", [])
            bones.append({"bone": bone, "node": node})
    buffer = GlbBinary()
    stored = binds.transpose(0, 2, 1).astype(np.float32).reshape(-1, 16)
    buffer.add_accessor(stored)
    buffer.views[0]["byteOffset"] = len(binary)
    buffer.accessors[0]["bufferView"] = len(document["bufferViews"])
    document["bufferViews"] += buffer.views
    document["accessors"] += buffer.accessors
    matrices = len(document["accessors"]) - 1
    document["skins"] = [{"joints": skin_joints, "inverseBindMatrices": matrices}]
    document |= {"nodes": shuffled, "animations": [], "cameras": []}
    document["extensionsUsed"] = list(document.get("extensions", ()))
    roots = [int(place[index]) for index, parent in enumerate(parents) if parent < 0]
    document["scenes"] = [{"nodes": roots}]
    binary += bytes(buffer.content)
    document["buffers"] = [{"byteLength": len(binary)}]
    return join_glb_chunks(document, binary)
