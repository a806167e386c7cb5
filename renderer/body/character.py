"""Reader of a visitor's character, a humanoid in .vrm or .glb, as a body that any motion poses.

Bones are found by VRM's humanoid map, or by names and the tree (`conventions.humanoid`). Each limb
is turned to the zero pose of SMPL-X, so the world rotations of its bones are those of the motion.
Its proportions stay; it is scaled so that its legs are as long as the open body's.
"""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from conventions import humanoid
from conventions.humanoid import BONE_END_JOINTS, JointMap, JointTree, NoHumanoidError
from conventions.joints import FINGERTIP_VERTICES, JOINT_INDEX, JOINT_NAMES, NUM_JOINTS, PARENTS
from conventions.names import join_names, pluralise
from renderer.body import body_file
from renderer.body.body_file import BodyArrays, BodyError, Rig
from renderer.body.face_shapes import FaceBlendshapes
from renderer.body.gltf import Gltf, read_glb_bytes
from renderer.body.texture import TextureAtlasBuilder

SUFFIXES = (".glb", ".vrm")
MAX_TARGET_VALUES = 40_000_000
"""Most values of all blendshapes that are read."""
MAX_REACH_M = 20.0
"""Largest coordinate (m) of a vertex of a person at the origin."""
MAX_UPPER_ARM_TWIST_DEG = 30.0
"""Twist of the hand that the upper arm shares; the forearm takes more, as when a palm turns up."""

_SIDES = ("left", "right")
_ARM = ("shoulder", "elbow", "wrist")
_TRUNK = ("spine1", "spine2", "spine3")
_EYE = re.compile(r"eye(ball)?(left|right|[lr])?[0-9]*$")
_VRM_FINGERS = {"Index": "index", "Middle": "middle", "Ring": "ring", "Little": "pinky"}
VRM_BONE_TO_JOINT: dict[str, str] = {
    "hips": "pelvis", "spine": "spine1", "chest": "spine2", "upperChest": "spine3",
    "neck": "neck", "head": "head", "jaw": "jaw", "leftEye": "left_eye", "rightEye": "right_eye",
    **{
        f"{side}{theirs}": f"{side}_{ours}"
        for side in ("left", "right")
        for theirs, ours in (
            ("UpperLeg", "hip"), ("LowerLeg", "knee"), ("Foot", "ankle"), ("Toes", "foot"),
            ("Shoulder", "collar"), ("UpperArm", "shoulder"), ("LowerArm", "elbow"),
            ("Hand", "wrist"), ("ThumbMetacarpal", "thumb1"), ("ThumbProximal", "thumb2"),
            ("ThumbDistal", "thumb3"),
            *(
                (f"{finger}{part}", f"{name}{number}")
                for finger, name in _VRM_FINGERS.items()
                for number, part in enumerate(("Proximal", "Intermediate", "Distal"), start=1)
            ),
        )
    },
}  # fmt: skip
"""Joint of each bone of VRM 1.0."""
_VRM0_THUMBS = {
    f"{side}Thumb{part}": f"{side}_thumb{number}"
    for side in ("left", "right")
    for number, part in enumerate(("Proximal", "Intermediate", "Distal"), start=1)
}
"""Thumb joints of VRM 0.x, which are named one joint further out than in 1.0."""


def read_character(path: Path) -> BodyArrays:
    """Read a character, turned to the zero pose; raises BodyError unless a skinned humanoid."""
    content = read_glb_bytes(path)
    try:
        with np.errstate(all="ignore"):  # the result is checked as a whole
            return _Character(Gltf(content, path.name)).body_arrays(path, content)
    except BodyError:
        raise
    except NoHumanoidError as error:
        raise BodyError(str(error)) from error
    except Exception as error:  # as many kinds as there are ways to damage a file
        raise BodyError(
            f"{path.name} is damaged and cannot be read as a character; export it again."
        ) from error


class _Character:
    """A file's humanoid in the axes and units of SMPL-X, with its skeleton in the zero pose."""

    def __init__(self, gltf: Gltf) -> None:
        self._gltf = gltf
        with np.load(body_file.OPEN_BODY_PATH, allow_pickle=False) as archive:
            self._rest = archive["rest_joints"].astype(np.float64)
            template = archive["template"].astype(np.float64)
            self._names = tuple(map(str, archive["expression_names"]))
        self._sole_m = float(template[:, 1].min())
        self._tips = {name: template[vertex] for name, vertex in FINGERTIP_VERTICES.items()}
        self._origins = gltf.world[:, :3, 3]
        self.bones = self._bones()
        self._axes, self._scale = self._similarity()
        self._owner = self._owners()
        at = self._scale * self._origins @ self._axes.T
        self._at = {name: at[node] for name, node in self.bones.items()}
        tips = {
            name: at[child]
            for name in self._tips
            if (node := self.bones.get(f"{name}3")) is not None
            for child in gltf.nodes[node].get("children", ())[:1]
        }
        self.turns = rest_to_zero_pose_rotations(self._at, tips, self._rest, self._tips)
        self.joints = self._zero_pose_joints()

    def _bones(self) -> dict[str, int]:
        """Return the node of each joint that the character has."""
        names = [str(node.get("name", "")) for node in self._gltf.nodes]
        exact = {name: names.index(name) for name in JOINT_NAMES if name in names}
        bones = self._vrm_bones() or (exact if len(exact) == NUM_JOINTS else {})
        if not bones:
            tree, nodes = self._tree(names)
            bones = {name: nodes[each[0]] for name, each in tree.joint_map().items() if each}
            bones |= self._face_bones(names, bones.get("head", -1), set(bones.values()))
        trunk = [bones.pop(name) for name in _TRUNK if name in bones]
        # The last bone carries neck and arms, so it must have all of the trunk's rotation.
        bones |= dict(zip(_TRUNK[:2] if len(trunk) > 2 else _TRUNK[:1], trunk[:-1], strict=False))
        bones |= {"spine3": trunk[-1]} if trunk else {}
        arms = [f"{side}_{part}" for side in _SIDES for part in _ARM]
        missing = [name for name in ("pelvis", *arms) if name not in bones]
        if missing or len(set(bones.values())) < len(bones):
            raise BodyError(
                f"{self._gltf.name} has no separate bone for "
                f"{join_names(missing or ['each joint'])}; a pelvis and two complete arms are "
                "needed."
            )
        return bones

    def _vrm_bones(self) -> dict[str, int]:
        extensions = self._gltf.document.get("extensions", {})
        joints = VRM_BONE_TO_JOINT
        if "VRMC_vrm" in extensions:
            bones = extensions["VRMC_vrm"]["humanoid"]["humanBones"].items()
        else:
            joints = VRM_BONE_TO_JOINT | _VRM0_THUMBS
            bones = extensions.get("VRM", {}).get("humanoid", {}).get("humanBones", ())
            bones = [(bone["bone"], bone) for bone in bones]
        return {
            joints[name]: int(bone["node"])
            for name, bone in bones
            if name in joints and 0 <= int(bone["node"]) < len(self._gltf.nodes)
        }

    def _tree(self, names: list[str]) -> tuple[JointTree, list[int]]:
        """Return the largest tree of bones, and the nodes that are its joints."""
        gltf = self._gltf
        used: set[int] = set()
        for node in (node for skin in gltf.document.get("skins", ()) for node in skin["joints"]):
            while node >= 0 and node not in used:
                used.add(node)
                node = gltf.parents[node]
        trees: list[list[int]] = []
        for node in (each for each in gltf.order if each in used):
            trees += [[]] if gltf.parents[node] < 0 else []
            trees[-1].append(node)
        if not trees:
            raise BodyError(
                f"{gltf.name} has no skin, so its mesh is not attached to bones; rig it as a "
                "humanoid first, for example with Mixamo."
            )
        nodes = max(trees, key=len)
        place = {node: index for index, node in enumerate(nodes)}
        parents = [place.get(gltf.parents[node], -1) for node in nodes]
        rest = self._origins[nodes]
        return JointTree(gltf.name, [names[node] for node in nodes], parents, rest), nodes

    def _face_bones(self, names: list[str], head: int, taken: set[int]) -> dict[str, int]:
        """Find jaw and eyes by name among the nodes below the head."""
        matches: dict[str, int] = {}
        for node in self._gltf.order if head >= 0 else ():
            up = node
            while up >= 0 and up != head:
                up = self._gltf.parents[up]
            plain = humanoid.letters_and_digits(names[node])
            if up < 0 or node in taken or "mesh" in self._gltf.nodes[node]:
                continue
            if "jaw" in plain:
                matches.setdefault("jaw", node)
            side = humanoid.side_of(names[node])
            if side and _EYE.search(plain):
                matches.setdefault(f"{side}_eye", node)
        return matches

    def _similarity(self) -> tuple[Float64[np.ndarray, "3 3"], float]:
        """Return the rotation of the file's axes to ours, and the factor of its lengths."""
        tree = JointTree(self._gltf.name, [], [], self._origins)
        joint_map: JointMap = {name: [node] for name, node in self.bones.items()}
        if "right_hip" not in joint_map:
            joint_map.pop("left_hip", None)
        up, across, hang = tree.body_axes_and_leg_cosine(joint_map)
        if hang < 0.5:
            raise BodyError(
                f"{self._gltf.name} does not stand in its rest pose; export it in a T-pose or "
                "A-pose."
            )
        y = humanoid.nearest_axis(up)
        x = across - y * (across @ y)
        x /= np.linalg.norm(x)
        legs = ("hip", "knee", "ankle")
        has_legs = all(f"{side}_{part}" in self.bones for side in _SIDES for part in legs)

        def length(places: dict[str, Float64[np.ndarray, " 3"]]) -> float:
            limbs = [
                [places[f"{side}_{part}"] for part in (legs if has_legs else _ARM)]
                for side in _SIDES
            ]
            return float(np.linalg.norm(np.diff(limbs, axis=1), axis=2).sum())

        ours = {name: self._rest[index] for name, index in JOINT_INDEX.items()}
        scale = length(ours) / length({name: self._origins[at] for name, at in self.bones.items()})
        if not 1e-6 < scale < 1e6:
            raise BodyError(
                f"The limbs of {self._gltf.name} cannot be scaled to human length; export it again."
            )
        return np.stack([x, y, np.cross(x, y)]), scale

    def _owners(self) -> list[int]:
        """Return the joint whose bone each node follows: its own or its nearest ancestor's.

        Raises BodyError if a bone does not follow from the one before it on a person.
        """
        joint_of = {node: JOINT_INDEX[name] for name, node in self.bones.items()}
        owners = [0] * len(self._gltf.nodes)
        for node in self._gltf.order:
            parent = self._gltf.parents[node]
            above = owners[parent] if parent >= 0 else 0
            owners[node] = joint_of.get(node, above)
            joint, is_below = owners[node], False
            while joint >= 0 and not is_below:
                is_below, joint = joint == above, PARENTS[joint]
            if not is_below:
                raise BodyError(
                    f"{self._gltf.name}: the bone of {JOINT_NAMES[owners[node]]} is a child of the "
                    f"bone of {JOINT_NAMES[above]}, unlike in a human skeleton."
                )
        return owners

    def _zero_pose_joints(self) -> Float64[np.ndarray, "J 3"]:
        """Return the joints of the zero pose; one without a bone is where the next one is."""
        joints = np.full((NUM_JOINTS, 3), np.nan)
        joints[0] = self._rest[0]
        indices = [0] * NUM_JOINTS
        for joint in range(1, NUM_JOINTS):
            parent = indices[PARENTS[joint]]
            indices[joint] = joint if JOINT_NAMES[joint] in self._at else parent
            if indices[joint] == joint:
                step = self._at[JOINT_NAMES[joint]] - self._at[JOINT_NAMES[parent]]
                joints[joint] = joints[parent] + self.turns[parent].apply(step)
        for joint in reversed(range(1, NUM_JOINTS)):
            above = PARENTS[joint]
            if np.isnan(joints[above, 0]) and not np.isnan(joints[joint, 0]):
                joints[above] = joints[joint]
        for joint in range(1, NUM_JOINTS):
            if np.isnan(joints[joint, 0]):
                above = PARENTS[joint]
                joints[joint] = joints[above] + self._rest[joint] - self._rest[above]
        return joints

    def body_arrays(self, path: Path, content: bytes) -> BodyArrays:
        """Return the mesh in the zero pose, with its weights, expressions and texture."""
        gltf = self._gltf
        maker, shapes = TextureAtlasBuilder(gltf), FaceBlendshapes(gltf, self._names)
        to_ours = np.eye(4)
        to_ours[:3, :3] = self._scale * self._axes
        zero = np.tile(np.eye(4), (NUM_JOINTS, 1, 1))
        zero[:, :3, :3] = [turn.as_matrix() for turn in self.turns]
        at = np.array([self._at.get(name, np.zeros(3)) for name in JOINT_NAMES])
        zero[:, :3, 3] = self.joints - (zero[:, :3, :3] @ at[..., None])[..., 0]
        posed = zero[self._owner] @ to_ours  # of each node: from the scene to the zero pose
        parts: list[tuple[np.ndarray, np.ndarray, sp.csr_array, np.ndarray]] = []
        num_vertices = num_faces = num_values = 0
        for node in gltf.order:
            if "mesh" not in gltf.nodes[node]:
                continue
            mesh = gltf.nodes[node]["mesh"]
            for number, primitive in enumerate(gltf.element("meshes", mesh)["primitives"]):
                if primitive.get("mode", 4) != 4:
                    continue  # points, lines, strips and fans
                count = int(gltf.element("accessors", primitive["attributes"]["POSITION"])["count"])
                targets = shapes.driven_targets(mesh, number)
                num_values += 3 * count * len(targets)
                num_vertices += count
                if num_vertices > body_file.MAX_VERTICES or num_values > MAX_TARGET_VALUES:
                    raise BodyError(
                        f"{path.name} has more than {body_file.MAX_VERTICES} vertices or "
                        f"{MAX_TARGET_VALUES // 10**6} million blendshape values; "
                        "export a coarser mesh."
                    )
                positions = gltf.accessor_array(primitive["attributes"]["POSITION"]).astype(
                    np.float64
                )
                faces = self._faces(primitive, count)
                num_faces += len(faces)
                if num_faces > body_file.MAX_FACES:
                    raise BodyError(
                        f"{path.name} has more than {body_file.MAX_FACES} triangles; "
                        "export a coarser mesh."
                    )
                weights, blended = self._skinning(primitive, node, posed, count)
                shapes.add_primitive(mesh, number, blended[:, :, :3], targets)
                maker.add_primitive(primitive, count)
                placed = np.einsum("vab,vb->va", blended[:, :, :3], positions) + blended[:, :, 3]
                normals = np.zeros((count, 3))
                if "NORMAL" in primitive["attributes"]:
                    stored = gltf.accessor_array(primitive["attributes"]["NORMAL"]).astype(
                        np.float64
                    )
                    normals = np.einsum("vab,vb->va", blended[:, :, :3], stored)
                parts.append((placed, faces + num_vertices - count, weights, normals))
        if not parts:
            raise BodyError(f"{path.name} has no triangle mesh.")
        template = np.concatenate([placed for placed, *_ in parts])
        weights = sp.csr_array(sp.vstack([each for _, _, each, _ in parts]), dtype=np.float32)
        soles = weights[:, [JOINT_INDEX[f"{s}_{p}"] for s in _SIDES for p in ("ankle", "foot")]]
        is_sole = np.asarray(soles.sum(axis=1)).ravel() > 0.5
        lift = self._sole_m - template[is_sole if is_sole.any() else slice(None), 1].min()
        template[:, 1] += lift
        self.joints[:, 1] += lift
        vertices, directions = shapes.expression_offsets()
        numbers = (template, self.joints, directions)
        if not all(np.isfinite(each).all() for each in numbers) or np.abs(template).max() > (
            MAX_REACH_M
        ):
            raise BodyError(
                f"After its limbs were scaled to human length, {path.name} has vertices that are "
                f"not finite or more than {MAX_REACH_M:.0f} m from the origin; export it again."
            )
        jaw = None if "jaw" in self.bones or not shapes.is_driven("jawOpen") else "jawOpen"
        return BodyArrays(
            name=path.name,
            sha256=hashlib.sha256(content).hexdigest(),
            expression_basis="arkit52",
            expression_names=self._names,
            template=template.astype(np.float32),
            faces=np.concatenate([faces for _, faces, _, _ in parts]).astype(np.int32),
            weights=weights,
            rest_joints=self.joints.astype(np.float32),
            shape_dirs=np.zeros((len(template), 3, 0), np.float32),
            shape_joint_dirs=np.zeros((NUM_JOINTS, 3, 0), np.float32),
            expression_vertices=vertices.astype(np.int32),
            expression_dirs=directions.astype(np.float32),
            expression_joint_dirs=np.zeros((len(directions), NUM_JOINTS, 3), np.float32),
            pose_vertices=np.zeros(0, np.int32),
            pose_dirs=sp.csr_array((0, body_file.NUM_POSE_FEATURES), dtype=np.float32),
            regions=None,
            texture=maker.build(template, np.concatenate([each for *_, each in parts])),
            jaw_component=None if jaw is None else self._names.index(jaw),
            rig=Rig(
                path=path,
                joint_nodes=tuple(self.bones.get(name, -1) for name in JOINT_NAMES),
                R_rest_to_zero_pose=np.array([turn.as_matrix() for turn in self.turns]),
                R_file_to_body=self._axes,
                file_to_body_scale=self._scale,
                target_weights=shapes.target_weights_by_mesh(),
            ),
            remarks=self._remarks(shapes, maker.missing),
        )

    def _faces(self, primitive: dict, count: int) -> np.ndarray:
        if "indices" in primitive:
            corners = self._gltf.accessor_array(primitive["indices"])[:, 0].astype(np.int64)
        else:
            corners = np.arange(count)
        faces = corners[: len(corners) // 3 * 3].reshape(-1, 3)
        if len(faces) and not 0 <= faces.min() <= faces.max() < count:
            raise BodyError(
                f"{self._gltf.name} is damaged: a triangle refers to a missing vertex; export it "
                "again."
            )
        return faces

    def _skinning(
        self, primitive: dict, node: int, posed: Float64[np.ndarray, "nodes 4 4"], count: int
    ) -> tuple[sp.csr_array, np.ndarray]:
        """Return weights (V, 55), and the matrix (3, 4) of each vertex to the zero pose."""
        gltf, attributes = self._gltf, primitive["attributes"]
        if "skin" not in gltf.nodes[node] or "JOINTS_0" not in attributes:
            matrix = (posed[node] @ gltf.world[node])[:3]
            weights = sp.csr_array(
                (np.ones(count), (np.arange(count), np.full(count, self._owner[node]))),
                shape=(count, NUM_JOINTS),
            )
            return weights, np.broadcast_to(matrix, (count, 3, 4))
        skin = gltf.element("skins", gltf.nodes[node]["skin"])
        joints = np.array(skin["joints"], np.int64)
        if len(joints) == 0 or not 0 <= joints.min() <= joints.max() < len(gltf.nodes):
            raise BodyError(
                f"{gltf.name} is damaged: a skin refers to a missing joint; export it again."
            )
        binds = np.tile(np.eye(4), (len(joints), 1, 1))
        if "inverseBindMatrices" in skin:
            stored = gltf.accessor_array(skin["inverseBindMatrices"])[: len(joints)]
            binds = stored.reshape(-1, 4, 4).transpose(0, 2, 1).astype(np.float64)
        matrices = (posed[joints] @ gltf.world[joints] @ binds)[:, :3]
        sets = [n for n in range(2) if f"JOINTS_{n}" in attributes and f"WEIGHTS_{n}" in attributes]
        which = np.hstack([gltf.accessor_array(attributes[f"JOINTS_{n}"]) for n in sets]).astype(
            np.int64
        )
        shares = np.hstack([gltf.accessor_array(attributes[f"WEIGHTS_{n}"]) for n in sets]).clip(0)
        shares = shares.astype(np.float64)
        if which.shape[0] != count or shares.shape != which.shape or which.max() >= len(joints):
            raise BodyError(
                f"{gltf.name} is damaged: its skinning weights do not match its vertices and "
                "joints; export it again."
            )
        total = shares.sum(axis=1, keepdims=True)
        shares[:, :1] += total <= 0  # a vertex without weights follows its first joint
        shares /= shares.sum(axis=1, keepdims=True)
        rows = np.repeat(np.arange(count), which.shape[1])
        owners = np.array(self._owner)[joints][which]
        weights = sp.csr_array((shares.ravel(), (rows, owners.ravel())), shape=(count, NUM_JOINTS))
        weights.eliminate_zeros()
        by_joint = sp.csr_array((shares.ravel(), (rows, which.ravel())), shape=(count, len(joints)))
        return weights, (by_joint @ matrices.reshape(-1, 12)).reshape(-1, 3, 4)

    def _remarks(self, shapes: FaceBlendshapes, num_missing: int) -> tuple[str, ...]:
        """Return sentences on what of the character moves and what does not."""
        name = self._gltf.name
        without = [each.replace("_", " ") for each in JOINT_NAMES if each not in self.bones]
        remarks = [f"{name} has {NUM_JOINTS - len(without)} of SMPL-X's 55 joints"]
        if without:
            shown = without if len(without) <= 8 else [*without[:7], f"{len(without) - 7} more"]
            remarks[0] += f"; joints without a bone do not move: {join_names(shown)}"
        remarks.append(shapes.remark)
        remarks.append(
            "The character keeps its own proportions, so a hand that touches the body in the "
            "motion may miss it here; metrics are computed on the bundled open body's skeleton"
        )
        if num_missing:
            remarks.append(f"Left out as unreadable: {pluralise(num_missing, 'texture')}")
        return tuple(f"{each}." for each in remarks)


Positions = dict[str, np.ndarray]
"""Position of each joint or fingertip."""
Turns = dict[str, Rotation]
"""World rotation of each joint."""


def _frame(
    along: Float64[np.ndarray, " 3"], across: Float64[np.ndarray, " 3"]
) -> Float64[np.ndarray, "3 3"]:
    """Return an orthonormal frame whose first column points along a vector, as columns."""
    x = along / np.linalg.norm(along)
    y = across - x * (across @ x)
    y /= np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)], axis=1)


def _aligned(first: Float64[np.ndarray, " 3"], other: Float64[np.ndarray, " 3"]) -> Rotation:
    """Return the smallest rotation from one direction to another."""
    if min(np.linalg.norm(first), np.linalg.norm(other)) < 1e-6:
        return Rotation.identity()
    return Rotation.align_vectors(other, first)[0]


def _twist(
    first: Float64[np.ndarray, " 3"],
    other: Float64[np.ndarray, " 3"],
    axis: Float64[np.ndarray, " 3"],
) -> float:
    """Return the angle (rad) about an axis from one direction to another."""
    axis = axis / max(float(np.linalg.norm(axis)), 1e-12)
    flat = first @ other - (first @ axis) * (other @ axis)
    return float(np.arctan2(np.cross(first, other) @ axis, flat))


def _about(axis: Float64[np.ndarray, " 3"], angle: float) -> Rotation:
    return Rotation.from_rotvec(angle * axis / max(float(np.linalg.norm(axis)), 1e-12))


def rest_to_zero_pose_rotations(
    joints: Positions,
    tips: Positions,
    body_joints: Float64[np.ndarray, "J 3"],
    body_tips: Positions,
) -> list[Rotation]:
    """Return the world rotation of each bone from the character's rest pose to the zero pose.

    Limbs and fingers point as ours do; hands also lie as ours do, and feet keep their pitch, since
    a character stands on its soles. Trunk, head and collarbones stay as they are: their bones begin
    at other places than ours in every rig.
    """
    ours = {name: body_joints[index] for name, index in JOINT_INDEX.items()}
    turns: Turns = {}
    for joint, name in enumerate(JOINT_NAMES):
        turns[name] = turns[JOINT_NAMES[PARENTS[joint]]] if joint else Rotation.identity()
        side, _, part = name.partition("_")
        end = BONE_END_JOINTS.get(name, "")
        if name not in joints or part == "collar":
            continue
        if part == "wrist":
            turns |= _hand_turns(side, turns, joints, ours)
        elif part == "ankle":
            turns |= _foot_turns(side, turns, joints, ours)
        elif end in joints:
            along = turns[name].apply(joints[end] - joints[name])
            turns[name] = _aligned(along, ours[end] - ours[name]) * turns[name]
        elif name[:-1] in tips and name.endswith("3"):
            along = turns[name].apply(tips[name[:-1]] - joints[name])
            turns[name] = _aligned(along, body_tips[name[:-1]] - ours[name]) * turns[name]
    return [turns[name] for name in JOINT_NAMES]


def _hand_turns(side: str, turns: Turns, theirs: Positions, ours: Positions) -> Turns:
    """Return rotations of wrist, elbow and shoulder: the palm as ours, its twist along the arm."""
    shoulder, elbow, wrist = (f"{side}_{part}" for part in _ARM)
    fingers = [f"{side}_{finger}1" for finger in ("index", "middle", "ring", "pinky")]
    fingers = [finger for finger in fingers if finger in theirs]
    if len(fingers) < 2:
        return {wrist: turns[elbow]}
    middle = fingers[1] if len(fingers) > 2 else fingers[0]
    frames, palms = [], []
    for places in (theirs, ours):
        ends = (fingers[0], fingers[-1], middle)
        first, last, along = (places[each] - places[wrist] for each in ends)
        palms.append(np.cross(first, last))
        frames.append(_frame(along, palms[-1]))
    hand = Rotation.from_matrix(frames[1] @ frames[0].T)
    palm = hand.apply(palms[0])
    limb, most = (shoulder, elbow, wrist), np.radians(MAX_UPPER_ARM_TWIST_DEG)
    return {wrist: hand} | _twisted(limb, turns, theirs, ours, palms[0], palm, most)


def _foot_turns(side: str, turns: Turns, theirs: Positions, ours: Positions) -> Turns:
    """Return rotations of ankle, knee and hip: the foot's heading as ours, its twist in the leg."""
    hip, knee, ankle, foot = (f"{side}_{part}" for part in ("hip", "knee", "ankle", "foot"))
    if foot not in theirs:
        return {ankle: Rotation.identity()}
    heading = (theirs[foot] - theirs[ankle]) * (1.0, 0.0, 1.0)  # its pitch is no twist
    up = np.array([0.0, 1.0, 0.0])
    turn = _about(up, _twist(heading, ours[foot] - ours[ankle], up))
    if hip not in theirs or knee not in theirs:
        return {ankle: turn}
    limb, ahead = (hip, knee, ankle), turn.apply(heading)
    return {ankle: turn} | _twisted(limb, turns, theirs, ours, heading, ahead, np.pi)


def _twisted(
    limb: tuple[str, str, str],
    turns: Turns,
    theirs: Positions,
    ours: Positions,
    normal: Float64[np.ndarray, " 3"],
    wanted: Float64[np.ndarray, " 3"],
    most: float,
) -> Turns:
    """Return rotations of a limb's two bones, twisted until a normal at its end lies as wanted.

    The upper bone twists at most by ``most`` (rad); the lower bone has the rest as well.
    """
    start, middle, end = limb
    first, second = turns[start], turns[middle]
    upper, lower = ours[middle] - ours[start], ours[end] - ours[middle]
    their_lower = theirs[end] - theirs[middle]
    total = 0.0
    for _ in range(4):  # the bones are not in line, so one twist changes the other's
        twist = _twist(second.apply(normal), wanted, lower)
        step = float(np.clip(total + twist, -most, most)) - total
        total += step
        first = _about(upper, step) * first
        second = _aligned(first.apply(their_lower), lower) * first
    second = _about(lower, _twist(second.apply(normal), wanted, lower)) * second
    return {start: first, middle: second}
