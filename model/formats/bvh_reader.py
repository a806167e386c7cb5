"""BVH files: our own (`renderer.files`), and any skeleton with two legs, a trunk and two arms.

Limbs and fingers are identified by the names of their joints, or by the tree and the lengths of
bones if the names are unclear. The rest pose determines which way is up and forward. Differences
between its limb and finger angles and ours are compensated: bones point as in the file.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from conventions.humanoid import BONE_END_JOINTS, JointMap, JointTree, NoHumanoidError, nearest_axis
from conventions.joints import JOINT_INDEX, JOINT_NAMES, NUM_JOINTS, PARENTS
from conventions.names import join_names
from model.formats.bvh_text import Joint, parse_bvh
from model.formats.motion_draft import MotionDraft
from model.formats.reading import AXES, METRES, Confidence, Kind, axis_vector
from model.motion.kinematics import open_body_skeleton
from model.motion.tracks import point_label
from model.storage.npz import MotionError

_MAX_REST_TILT_DEG = 60.0
"""Angle from our rest direction above which a limb's twist is uncertain (degrees)."""


def read_bvh(path: Path, overrides: dict[str, str]) -> MotionDraft:
    """Read a motion; the face and missing joints stay at rest; raises MotionError."""
    text = parse_bvh(path)
    skeleton = _Skeleton(text.joints, path.name)
    identified, is_ours = skeleton.identify_joints()
    draft = MotionDraft(path.name, overrides, np.zeros((1, NUM_JOINTS, 3)), is_metric_y_up=True)
    for what in text.notes:
        draft.assume("frames", str(len(text.rows)), what)
    world = skeleton.world_rotations(text.rows)
    pelvis = skeleton.joint_positions(identified["pelvis"][0], text.rows, world)
    is_posed = not is_ours and not skeleton.is_standing(identified)
    if is_posed:
        world = skeleton.use_first_frame_as_rest(text.rows, world)
        identified, _ = skeleton.identify_joints()
        reason = (
            "the rest pose is not a human pose; the first frame was used instead, so limbs may "
            "be twisted"
        )
        draft.assume("layout", "first frame", reason, "unsure")
    turn = Rotation.identity() if is_ours else skeleton.rotation_to_smplx_axes(identified, draft)
    places = skeleton.rest @ turn.as_matrix().T
    turns = {} if is_ours else _rest_turns(places, identified)
    turns |= _trunk_turns(places, identified) if is_posed else {}
    draft.poses = _poses(world, identified, turns, turn)
    scale = _scale(skeleton.rest, identified, draft)
    rest = open_body_skeleton().rest_joints.double().numpy()
    if pelvis is not None:
        draft.trans = turn.apply(scale * pelvis) - rest[0]
    else:
        draft.missing_parts.add("place")
        draft.assume("place", "none", "no joint has position channels; the body stays in one place")
    if not is_ours:
        _add_assumptions(draft, skeleton, identified, turns)
    draft.missing_parts.add("face")
    draft.assume(
        "face", "none", "BVH files have no face; the face stays at rest", is_own_convention=is_ours
    )
    draft.set_frame_rate(round(1 / text.frame_duration_s, 3), "from the file", "stated")
    return draft


def _add_assumptions(
    draft: MotionDraft, skeleton: _Skeleton, joint_map: JointMap, turns: dict[str, Rotation]
) -> None:
    without = sum(not joint_map.get(name) for name in JOINT_NAMES)
    count = len(skeleton.rest)
    unused = count - sum(len(theirs) for theirs in joint_map.values())
    how = "names and hierarchy"
    if skeleton.doubts:
        doubts = join_names(list(dict.fromkeys(skeleton.doubts)))
        how = f"hierarchy, as their names do not say which joint is the {doubts}"
    reason = (
        f"mapped onto SMPL-X by their {how}; {unused} are not used, {without} SMPL-X joints stay "
        "at rest"
    )
    draft.assume("joints", str(count), reason, "unsure" if skeleton.doubts else "sure")
    degrees = {name: float(np.degrees(turn.magnitude())) for name, turn in turns.items()}
    if degrees and all(each.kind != "layout" for each in draft.assumptions):
        most = max(degrees, key=lambda name: degrees[name])
        limbs = [value for name, value in degrees.items() if not name[-1].isdigit()]
        confidence: Confidence = (
            "unsure" if max(limbs, default=0.0) > _MAX_REST_TILT_DEG else "sure"
        )
        reason = (
            f"the rest pose differs from SMPL-X's by up to {degrees[most]:.0f}° "
            f"({point_label(most)}); limbs and fingers were turned to the directions in the file"
        )
        draft.assume("layout", "rest pose", reason, confidence)
    if not any(
        name[-1].isdigit() and joint_map.get(f"left_{name}") for name in ("index1", "middle1")
    ):
        draft.missing_parts.add("hands")
    if not joint_map.get("left_hip"):
        draft.missing_parts.add("legs")


class _Skeleton(JointTree):
    """The joints of a file, and their assignment to ours."""

    def __init__(self, joints: list[Joint], name: str) -> None:
        self._joints = joints
        rest = np.array([joint.offset for joint in joints], np.float64)
        for index, joint in enumerate(joints):
            if joint.parent >= 0:
                rest[index] += rest[joint.parent]
        super().__init__(
            name, [joint.name for joint in joints], [joint.parent for joint in joints], rest
        )

    def identify_joints(self) -> tuple[JointMap, bool]:
        """Return the joint map, and whether all names are ours; raises MotionError if no body."""
        exact = {joint.name: index for index, joint in enumerate(self._joints)}
        if all(name in exact for name in JOINT_NAMES):
            return {name: [exact[name]] for name in JOINT_NAMES}, True
        try:
            return self.joint_map(), False
        except NoHumanoidError as error:
            raise MotionError(str(error)) from error

    def use_first_frame_as_rest(
        self, rows: Float[np.ndarray, "T C"], world: list[Rotation]
    ) -> list[Rotation]:
        """Use the first frame as the rest pose, and return rotations relative to it."""
        for index, joint in enumerate(self._joints):
            step = self._step(joint, rows[:1])
            step = np.array(joint.offset) if step is None else step[0]
            up = joint.parent
            self.rest[index] = step if up < 0 else self.rest[up] + world[up][0].apply(step)
        return [each * each[0].inv() for each in world]

    def rotation_to_smplx_axes(self, joint_map: JointMap, draft: MotionDraft) -> Rotation:
        """Return the rotation, in quarter turns, from the file's axes to ours: y up, facing z."""
        up, across, hang = self.body_axes_and_leg_cosine(joint_map)
        if hang < 0.5:
            raise MotionError(
                f"{self.source}: the legs are not below the trunk in the rest pose or in the"
                " first frame, so the limbs cannot be mapped to SMPL-X. Put a T-pose or A-pose"
                " into the first frame (or use Apply Pose as Rest Pose in Blender)."
            )
        y = nearest_axis(up)
        x = nearest_axis(across - y * (across @ y))
        overrides = draft.overrides.get("up"), draft.overrides.get("facing")
        if overrides[0] is not None or overrides[1] in AXES:
            y = y if overrides[0] is None else axis_vector(overrides[0])
            z = np.cross(x, y) if overrides[1] not in AXES else axis_vector(overrides[1])
            x = np.cross(y, z)
            if not np.linalg.norm(x):
                raise MotionError(
                    f"{self.source}: the settings up and facing must be different axes."
                )
            draft.applied_override_kinds.add("up")
        z = np.cross(x, y)
        stands, faces = (
            ("-" if axis.sum() < 0 else "") + "xyz"[int(np.abs(axis).argmax())] for axis in (y, z)
        )
        by_rest: Confidence = "sure" if "left_hip" in joint_map else "unsure"
        tells: tuple[tuple[Kind, str, str, bool], ...] = (
            ("up", stands, stands + faces, stands == "y"),
            ("facing", faces, "xyz".replace(stands[-1], ""), faces == "z" or stands != "y"),
        )
        for kind, value, axes, is_ours in tells:
            alternatives = tuple(
                axis for axis in AXES if axis[-1] in axes
            )  # possible together with it
            if draft.overrides.get(kind) in AXES:
                draft.assume(kind, value, "set by you", "user", alternatives)
            elif by_rest == "unsure" or not is_ours:
                turned = "" if is_ours else "; rotated to y up, facing z"
                draft.assume(kind, value, f"from the rest pose{turned}", by_rest, alternatives)
        return Rotation.from_matrix(np.stack([x, y, z]))

    def world_rotations(self, rows: Float[np.ndarray, "T C"]) -> list[Rotation]:
        """Compute the world rotation of each joint."""
        world: list[Rotation] = []
        for joint in self._joints:
            at = [i for i, each in enumerate(joint.channels) if each.endswith("rotation")]
            turn = Rotation.identity(len(rows))
            if at:
                order = "".join(joint.channels[i][0] for i in at)
                angles = rows[:, [joint.first_channel + i for i in at]]
                turn = Rotation.from_euler(order, angles, degrees=True)
            world.append(turn if joint.parent < 0 else world[joint.parent] * turn)
        return world

    def joint_positions(
        self, index: int, rows: Float[np.ndarray, "T C"], world: list[Rotation]
    ) -> Float[np.ndarray, "T 3"] | None:
        """Compute a joint's positions from position channels up to it; None without any."""
        place: np.ndarray | None = None
        for at in self.path_from_ancestor(0, index):
            joint = self._joints[at]
            step = self._step(joint, rows)
            if joint.parent < 0:
                place = step
            elif place is not None or step is not None:
                start = self.rest[joint.parent] if place is None else place
                offset = np.array(joint.offset) if step is None else step
                place = start + world[joint.parent].apply(offset)
        return place

    def _step(self, joint: Joint, rows: Float[np.ndarray, "T C"]) -> np.ndarray | None:
        """Return a joint's offset from its parent in the parent's axes; None without positions."""
        axes = {
            "XYZ".index(each[0]): joint.first_channel + i
            for i, each in enumerate(joint.channels)
            if each.endswith("position")
        }
        if not axes:
            return None
        offset, angle_axes = np.array(joint.offset), list(axes)
        step = np.tile(offset, (len(rows), 1))
        angles = rows[:, list(axes.values())]
        mean = angles.mean(axis=0)
        far = np.linalg.norm(mean - offset[angle_axes]) > np.linalg.norm(mean)
        # Positions nearer to zero than to the rest offset are relative to that offset.
        step[:, angle_axes] = angles + offset[angle_axes] if joint.parent >= 0 and far else angles
        return step


def _poses(
    world: list[Rotation], joint_map: JointMap, turns: dict[str, Rotation], axes: Rotation
) -> Float[np.ndarray, "T 55 3"]:
    """Compute our joints' local rotations; one that the file lacks follows its parent."""
    ours: list[Rotation] = []
    poses = np.zeros((len(world[0]), NUM_JOINTS, 3))
    for joint, parent in enumerate(PARENTS):
        name = JOINT_NAMES[joint]
        theirs = joint_map.get(name)
        if not theirs:
            ours.append(ours[parent])
            continue
        turned = axes * world[theirs[-1]] * axes.inv()
        turned = turned * turns[name] if name in turns else turned
        ours.append(turned)
        local = turned if parent < 0 else ours[parent].inv() * turned
        poses[:, joint] = local.as_rotvec()
    return poses


def _rest_turns(places: Float[np.ndarray, "J 3"], joint_map: JointMap) -> dict[str, Rotation]:
    """Return rotations from the rest direction of each limb's bone of ours to the file's."""
    rest = open_body_skeleton().rest_joints.double().numpy()
    turns: dict[str, Rotation] = {}
    for start, end in BONE_END_JOINTS.items():
        first, last = joint_map.get(start), joint_map.get(end)
        if not first or not last:
            continue
        theirs = places[last[0]] - places[first[0]]
        ours = rest[JOINT_INDEX[end]] - rest[JOINT_INDEX[start]]
        if np.linalg.norm(theirs) < 1e-6:
            continue
        turns[start] = Rotation.align_vectors(theirs, ours)[0]
        if start.endswith("2"):  # the last bone of a finger has no joint at its end
            turns[f"{start[:-1]}3"] = turns[start]
    for side in ("left", "right"):  # a hand without fingers rests as its forearm does
        if f"{side}_elbow" in turns:
            turns.setdefault(f"{side}_wrist", turns[f"{side}_elbow"])
    return turns


def _trunk_turns(places: Float[np.ndarray, "J 3"], joint_map: JointMap) -> dict[str, Rotation]:
    """Return rotations from the rest pose of our trunk and head to the file's."""
    rest = open_body_skeleton().rest_joints.double().numpy()
    theirs = {name: places[at[0]] for name, at in joint_map.items() if at}
    ours = {name: rest[JOINT_INDEX[name]] for name in theirs}
    turns = {}
    for part, names in (
        ("hip", ("pelvis",)),
        ("shoulder", ("spine1", "spine2", "spine3", "neck", "head")),
    ):
        part = part if f"left_{part}" in theirs else "shoulder"
        across = [at[f"left_{part}"] - at[f"right_{part}"] for at in (theirs, ours)]
        up = [
            at["left_shoulder"] + at["right_shoulder"] - 2 * at["pelvis"] for at in (theirs, ours)
        ]
        turn = Rotation.align_vectors(*np.stack([across, up], axis=1))[0]
        turns |= dict.fromkeys(names, turn)
    return turns


def _scale(places: Float[np.ndarray, "J 3"], joint_map: JointMap, draft: MotionDraft) -> float:
    """Return the factor that makes the legs as long as ours."""
    rest = open_body_skeleton().rest_joints.double().numpy()
    limb, parts = "legs", ("left_hip", "left_knee", "left_ankle")
    if not joint_map.get(parts[0]):
        limb, parts = "arms", ("left_shoulder", "left_elbow", "left_wrist")

    def length(limb: Float[np.ndarray, "J 3"]) -> float:
        return float(np.linalg.norm(np.diff(limb, axis=0), axis=1).sum())

    theirs = length(places[[joint_map[part][0] for part in parts]])
    scale = length(rest[[JOINT_INDEX[part] for part in parts]]) / max(theirs, 1e-9)
    is_ours = abs(scale - 1.0) < 0.005
    unit = min(METRES, key=lambda each: abs(np.log(METRES[each] / scale)))
    reason = f"lengths were multiplied by {scale:.3g} to make the {limb} as long as SMPL-X's"
    unit_name = draft.resolve("units", unit, reason, "sure", tuple(METRES), is_ours)
    if "units" in draft.overrides:
        return METRES[unit_name]
    return 1.0 if is_ours else scale
