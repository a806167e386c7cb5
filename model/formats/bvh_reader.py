"""BVH files: our own (`renderer.files`), and any skeleton with two legs, a trunk and two arms.

Limbs and fingers are identified by the names of their joints, or by the tree and the lengths of
bones if the names are unclear. The rest pose determines which way is up and forward. Differences
between its limb and finger angles and ours are compensated: bones point as in the file.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from conventions.joints import JOINT_INDEX, JOINT_NAMES, NUM_JOINTS, PARENTS
from conventions.names import listed
from model.formats.bvh_text import Joint, read_text
from model.formats.motion_draft import Draft
from model.formats.reading import AXES, METRES, Kind, Sure, axis_of
from model.motion.kinematics import open_body_skeleton
from model.motion.tracks import point_words
from model.storage.npz import MotionError

_FINGERS = ("Index", "Middle", "Pinky", "Ring", "Thumb")
BONES: dict[str, str] = {
    f"{side}_{start}": f"{side}_{end}"
    for side in ("left", "right")
    for start, end in [
        *(("collar", "shoulder"), ("shoulder", "elbow"), ("elbow", "wrist"), ("wrist", "middle1")),
        *(("hip", "knee"), ("knee", "ankle"), ("ankle", "foot")),
        *(
            (f"{finger.lower()}{i}", f"{finger.lower()}{i + 1}")
            for finger in _FINGERS
            for i in (1, 2)
        ),
    ]
}
"""Bones of limbs and fingers, from their joint to the next."""
_LEFT = re.compile(r"(^|[^a-z])(l|left)([^a-z]|$)|^left|left$")
_RIGHT = re.compile(r"(^|[^a-z])(r|right)([^a-z]|$)|^right|right$")
_FINGER_NAMES = {
    "thumb": "thumb|handt(?=[0-9]|$)",
    "index": "index|handi(?=[0-9]|$)",
    "middle": "mid|handm(?=[0-9]|$)",
    "ring": "ring|handr(?=[0-9]|$)",
    "pinky": "pink|handp(?=[0-9]|$)",
}
"""Regular expressions of finger names; ``RHandM1`` is BEAT's."""


@dataclass(frozen=True)
class LimbNames:
    """Regular expressions of a limb's joints, matched with lower-case names without punctuation."""

    end: str
    """Pattern of the wrist or ankle."""
    lower: str
    """Pattern of the elbow or knee."""
    upper: str
    """Pattern of unambiguous names of the shoulder or hip joint."""
    either: str
    """Pattern of the upper or the lower part, depending on the others: ``LeftUpLeg`` and
    ``LeftLeg``."""
    before: str
    """Pattern of the joint before the limb, or else of the upper part: ``LeftShoulder``."""


ARM = LimbNames(
    "hand|wrist", "forearm|lo(w|wer)?arm|armlo|elbow|radius", "up(per)?arm|armup|humer", "arm",
    "shoulder|shldr",
)  # fmt: skip
LEG = LimbNames(
    "foot|ankle", "lo(w|wer)?leg|leglo|knee|shin|calf|tibia", "up(per)?leg|legup|thigh|femur",
    "leg", "hip",
)  # fmt: skip
SIMILAR_LENGTHS = 0.8
"""Ratio of the lengths of two pairs of bones above which the limb is uncertain (CMU: 0.88; our
body: 0.77)."""
_STEEP_DEG = 60.0
"""Angle from our rest direction above which a limb's twist is uncertain (degrees)."""
Found = dict[str, list[int]]
"""Indices of the file's joints for each of ours, with rotations that are combined."""


def read_bvh(path: Path, told: dict[str, str]) -> Draft:
    """Read a motion with the joints that the file has; the face stays at rest.

    Raises:
        MotionError: for damaged files, and skeletons that are no person's.
    """
    text = read_text(path)
    skeleton = _Skeleton(text.joints, path.name)
    found, is_ours = skeleton.found()
    draft = Draft(path.name, told, np.zeros((1, NUM_JOINTS, 3)), is_scaled=True)
    for what in text.said:
        draft.assume("frames", str(len(text.rows)), what)
    world = skeleton.moved(text.rows)
    pelvis = skeleton.way(found["pelvis"][0], text.rows, world)
    is_posed = not is_ours and not skeleton.stands(found)
    if is_posed:
        world = skeleton.begin_at_rest(text.rows, world)
        found, _ = skeleton.found()
        why = "its rest pose is no person's; its first frame was taken for it, so limbs may twist"
        draft.assume("layout", "first frame", why, "unsure")
    turn = Rotation.identity() if is_ours else skeleton.to_ours(found, draft)
    places = skeleton.rest @ turn.as_matrix().T
    turns = {} if is_ours else _rest_turns(places, found)
    turns |= _trunk_turns(places, found) if is_posed else {}
    draft.poses = _poses(world, found, turns, turn)
    scale = _scale(skeleton.rest, found, draft)
    rest = open_body_skeleton().rest_joints.double().numpy()
    if pelvis is not None:
        draft.trans = turn.apply(scale * pelvis) - rest[0]
    else:
        draft.lacks.add("place")
        draft.assume("place", "none", "no joint has positions; the body stays in its place")
    if not is_ours:
        _tell(draft, skeleton, found, turns)
    draft.lacks.add("face")
    draft.assume("face", "none", "a BVH has none; it stays at rest", is_usual=is_ours)
    draft.goes_at(round(1 / text.frame_s, 3), "as the file says", "stated")
    return draft


def _tell(draft: Draft, skeleton: _Skeleton, found: Found, turns: dict[str, Rotation]) -> None:
    without = sum(not found.get(name) for name in JOINT_NAMES)
    count = len(skeleton.rest)
    unused = count - sum(len(theirs) for theirs in found.values())
    how = "names and tree"
    if skeleton.doubts:
        doubts = listed(list(dict.fromkeys(skeleton.doubts)))
        how = f"tree, and their names do not say which joint is the {doubts}"
    why = f"laid onto ours by their {how}; {unused} have no place, {without} of ours stay at rest"
    draft.assume("joints", str(count), why, "unsure" if skeleton.doubts else "sure")
    degrees = {name: float(np.degrees(turn.magnitude())) for name, turn in turns.items()}
    if degrees and all(each.kind != "layout" for each in draft.assumptions):
        most = max(degrees, key=lambda name: degrees[name])
        limbs = [value for name, value in degrees.items() if not name[-1].isdigit()]
        sure: Sure = "unsure" if max(limbs, default=0.0) > _STEEP_DEG else "sure"
        why = (
            f"it rests at other angles than our body, by up to {degrees[most]:.0f}°"
            f" ({point_words(most)}); limbs and fingers were turned to point as they do there"
        )
        draft.assume("layout", "rest pose", why, sure)
    if not any(name[-1].isdigit() and found.get(f"left_{name}") for name in ("index1", "middle1")):
        draft.lacks.add("hands")
    if not found.get("left_hip"):
        draft.lacks.add("legs")


class _Skeleton:
    """The joints of a file, and their assignment to ours."""

    def __init__(self, joints: list[Joint], name: str) -> None:
        self._joints = joints
        self._name = name
        self.doubts: list[str] = []
        """Joints that neither names nor lengths identify with certainty."""
        self._children: list[list[int]] = [[] for _ in joints]
        self.rest = np.zeros((len(joints), 3))
        """Joint positions (J, 3) in the rest pose, in the file's axes."""
        for index, joint in enumerate(joints):
            self.rest[index] = joint.offset
            if joint.parent >= 0:
                self._children[joint.parent].append(index)
                self.rest[index] += self.rest[joint.parent]
        self._sizes = [1] * len(joints)
        for index in reversed(range(len(joints))):
            if joints[index].parent >= 0:
                self._sizes[joints[index].parent] += self._sizes[index]
        self._labels = _plain_labels([joint.name for joint in joints])

    def found(self) -> tuple[Found, bool]:
        """Return the assignment of joints, and whether all joints have our names.

        Raises:
            MotionError: if they are no body's.
        """
        exact = {joint.name: index for index, joint in enumerate(self._joints)}
        if all(name in exact for name in JOINT_NAMES):
            return {name: [exact[name]] for name in JOINT_NAMES}, True
        return self._by_structure(), False

    def _by_structure(self) -> Found:
        """Assign joints by the tree: two legs and a trunk at the pelvis, arms at the chest."""
        forks = (at for at in self._down(0) if len(self._limbs(at)) >= 3)
        pelvis = next((at for at in forks if self._trunk(at) is not None), 0)
        trunk = self._trunk(pelvis)
        if trunk is None:
            raise self._unknown("no trunk from which two arms go")
        chest = next((at for at in self._down(trunk) if len(self._limbs(at)) >= 2), None)
        if chest is None:
            raise self._unknown("no joint from which two arms go")
        below = range(trunk, trunk + self._sizes[trunk])
        branches = (
            [each for each in self._limbs(at) if each != trunk]
            for at in range(pelvis, len(self._joints))
            if at not in below
        )
        legs = next((self._mirrored(each, LEG) for each in branches if len(each) >= 2), ())
        if not legs and len(self._limbs(chest)) > 3:
            raise self._unknown("no joint from which two legs and a trunk go")
        arms = self._mirrored(self._limbs(chest), ARM)
        ahead, left = np.zeros(3), np.zeros(3)
        if legs:
            soles = [self._down(leg)[-2:] for leg in legs]
            ahead = sum((self.rest[toe] - self.rest[ankle] for ankle, toe in soles), ahead)
            up = self.rest[chest] - self.rest[[sole[-1] for sole in soles]].mean(axis=0)
            left = np.cross(up, ahead)
        others = [each for each in self._children[chest] if each not in arms]
        head = max(others, key=lambda each: self._sizes[each], default=None)
        spine = self._path(trunk, chest)
        found: Found = {"pelvis": [pelvis], "spine1": spine[:1], "spine2": spine[1:2]}
        found |= {"spine3": spine[2:]} | ({} if head is None else self._neck(self._down(head)))
        for side, arm in zip(("left", "right"), self._sided(arms, left), strict=True):
            found |= self._limb(arm, side, ("collar", "shoulder", "elbow", "wrist", ""), ARM)
            found |= self._fingers(found[f"{side}_wrist"][-1], side, ahead)
        for side, leg in zip(("left", "right"), self._sided(legs, left) if legs else ()):  # noqa: B905
            found |= self._limb(leg, side, ("", "hip", "knee", "ankle", "foot"), LEG)
        return found

    def _unknown(self, why: str) -> MotionError:
        names = ", ".join(joint.name[:24] for joint in self._joints[:12])
        return MotionError(
            f"{self._name} has {len(self._joints)} joints and {why} ({names} …); a trunk and"
            " two arms are needed. Retarget it to a Mixamo or SMPL-X skeleton first."
        )

    def _down(self, index: int) -> list[int]:
        """Return the path from a joint along the largest branches."""
        path = [index]
        while self._children[path[-1]]:
            path.append(max(self._children[path[-1]], key=lambda each: self._sizes[each]))
        return path

    def _limbs(self, index: int) -> list[int]:
        """Return the children of a joint with at least two descendants each."""
        return [each for each in self._children[index] if self._sizes[each] >= 3]

    def _trunk(self, pelvis: int) -> int | None:
        """Return the branch with the arms: the one that divides again."""
        for each in sorted(self._limbs(pelvis), key=lambda each: -self._sizes[each]):
            if any(len(self._limbs(at)) >= 2 for at in self._down(each)[:-1]):
                return each
        return None

    def _mirrored(self, limbs: list[int], names: LimbNames) -> tuple[int, int]:
        """Return the two branches with such a limb's names, or else of the most similar lengths."""
        pattern = re.compile(f"{names.end}|{names.lower}")
        named = [
            each
            for each in limbs
            if any(map(pattern.search, self._labels[each : each + self._sizes[each]]))
        ]
        limbs = named if len(named) >= 2 else limbs
        if len(limbs) < 2:
            raise self._unknown("fewer than two limbs at its trunk")
        return min(combinations(limbs, 2), key=lambda two: self._apart(*two))

    def _apart(self, one: int, other: int) -> float:
        """Compute the difference in length of two branches; infinite for the neck's."""
        if any(re.search(r"neck|head", self._labels[each]) for each in (one, other)):
            return np.inf
        lengths = [
            np.linalg.norm(np.diff(self.rest[self._down(each)], axis=0), axis=1).sum()
            for each in (one, other)
        ]
        return abs(float(lengths[0] - lengths[1]))

    def _path(self, start: int, end: int) -> list[int]:
        path = [end]
        while path[-1] != start:
            path.append(self._joints[path[-1]].parent)
        return path[::-1]

    def _sided(self, two: tuple[int, int], left: np.ndarray) -> tuple[int, int]:
        """Order two branches left and right, by name, or else by the direction of the feet."""
        swapped = (two[1], two[0])
        for order in (two, swapped):
            sides = [_side(self._joints[each].name, self._labels[each]) for each in order]
            if sides in (["left", "right"], ["left", ""], ["", "right"]):
                return order
        return two if (self.rest[two[0]] - self.rest[two[1]]) @ left > 0 else swapped

    def _limb(self, start: int, side: str, names: tuple[str, ...], known: LimbNames) -> Found:
        """Find a limb's joints by name, or else by length: the two longest consecutive bones."""
        path = [at for at in self._down(start) if not re.search("twist|roll", self._labels[at])]
        places = self.rest[path]
        lengths = np.linalg.norm(np.diff(places, axis=0), axis=1)
        if len(lengths) < 2:
            raise self._unknown(f"a limb of {len(path)} joints")
        before, *three, after = names
        first, middle, end = self._named_limb(path, known) or self._longest(lengths, three[1])
        starts = {three[0]: path[first:middle], three[1]: path[middle:end], three[2]: [path[end]]}
        found: Found = {f"{side}_{name}": joints for name, joints in starts.items()}
        if first and before:
            found[f"{side}_{before}"] = path[:first]
        beyond = path[end + 1 :]
        if after and beyond:
            toes = [at for at in beyond if re.search("toe|ball", self._labels[at])]
            shin = places[end] - places[end - 1]
            steps = self.rest[beyond] - places[end]
            far = np.linalg.norm(steps, axis=1) * np.linalg.norm(shin)
            ball = int(np.argmax(steps @ shin < 0.8 * far))  # not a heel below the ankle; else 0
            found[f"{side}_{after}"] = [toes[0] if toes else beyond[ball]]
        return found

    def _named_limb(self, path: list[int], names: LimbNames) -> tuple[int, int, int] | None:
        """Find where a limb's upper part, lower part and end start on a path, by name."""

        def of(pattern: str, stop: int) -> list[int]:
            return [at for at in range(stop) if re.search(pattern, self._labels[path[at]])]

        ends = of(names.end, len(path))
        if not ends:
            return None
        end = ends[0]
        above = f"{names.upper}|{names.either}|{names.before}"
        lowers = of(names.lower, end)
        lowers = lowers or [at for at in of(names.either, end)[-1:] if of(above, at)]
        if not lowers:
            return None
        lower = lowers[0]
        uppers = of(names.upper, lower) or of(names.either, lower) or of(names.before, lower)[-1:]
        return (uppers[0], lower, end) if uppers else None

    def _longest(self, lengths: np.ndarray, middle: str) -> tuple[int, int, int]:
        """Return the start, middle and end of the two consecutive bones with the longest sum."""
        sums = lengths[:-1] + lengths[1:]
        first = int(np.argmax(sums))
        if np.delete(sums, first).max(initial=0.0) > SIMILAR_LENGTHS * sums[first]:
            self.doubts.append(middle)
        return first, first + 1, first + 2

    def _neck(self, heads: list[int]) -> Found:
        named = [at for at, each in enumerate(heads) if "head" in self._labels[each]]
        end = named[0] if named else min(1, len(heads) - 1)
        found: Found = {"head": [heads[end]]}
        return found | ({"neck": heads[:end]} if end else {})

    def _fingers(self, wrist: int, side: str, ahead: np.ndarray) -> Found:
        """Find finger joints by names with numbers, or else by chains.

        Chains are named, or ordered: the thumb starts nearest to the wrist, the others lie in a
        row.
        """
        found: Found = {}
        for finger, spelling in _FINGER_NAMES.items():
            for at in range(wrist + 1, wrist + self._sizes[wrist]):
                number = re.search(rf"(?:{spelling})[a-z]*0?([123])(?!\d)", self._labels[at])
                if number:
                    found.setdefault(f"{side}_{finger}{number[1]}", [at])
        if found:
            return found
        starts = self._children[wrist]
        if len(starts) == 1 and len(self._children[starts[0]]) >= 4:  # a palm
            starts = self._children[starts[0]]
        chains = [chain for each in starts if len(chain := self._down(each)) >= 2]
        named: dict[str, list[int]] = {}
        thumb = self._thumb_number(wrist)
        for number, (finger, spelling) in enumerate(_FINGER_NAMES.items(), start=thumb):
            for chain in chains:
                labels = [self._labels[at] for at in chain]
                if any(re.search(f"{spelling}|finger{number}", label) for label in labels):
                    named.setdefault(finger, chain)
        if len(named) < len(chains) == 5:
            places = np.array([self.rest[chain[0]] - self.rest[wrist] for chain in chains])
            thumb = int(np.argmin(np.linalg.norm(places, axis=1)))
            others = sorted((i for i in range(5) if i != thumb), key=lambda i: -places[i] @ ahead)
            names = ("thumb", "index", "middle", "ring", "pinky")
            named = {name: chains[i] for name, i in zip(names, [thumb, *others], strict=True)}
        for finger, chain in named.items():
            lengths = np.linalg.norm(np.diff(self.rest[chain], axis=0), axis=1)
            is_palm = finger != "thumb" and len(chain) >= 4 and int(lengths.argmax()) == 0
            is_palm |= "carpal" in self._labels[chain[0]]
            for segment, joint in enumerate(chain[is_palm:][:3], start=1):
                found[f"{side}_{finger}{segment}"] = [joint]
        return found

    def _thumb_number(self, wrist: int) -> int:
        """Return the number of the thumb among numbered fingers: 0 (3ds Max) or 1 (MakeHuman)."""
        labels = self._labels[wrist : wrist + self._sizes[wrist]]
        return 0 if any("finger0" in label for label in labels) else 1

    def _upright(self, found: Found) -> tuple[np.ndarray, np.ndarray, float]:
        """Return up along the trunk, left across it, and the cosine between legs and down.

        Without legs the last value tells how far the arms are below the shoulders.
        """
        at = {name: self.rest[theirs[0]] for name, theirs in found.items() if theirs}
        parts = ("hip", "shoulder") if "left_hip" in at else ("shoulder",)
        across = sum((at[f"left_{e}"] - at[f"right_{e}"] for e in parts), np.zeros(3))

        def middle(part: str) -> np.ndarray:
            return (at[f"left_{part}"] + at[f"right_{part}"]) / 2

        hips = middle("hip") if "left_hip" in at else at["pelvis"]
        trunk = middle("shoulder") - hips
        up = trunk / max(float(np.linalg.norm(trunk)), 1e-9)
        across -= up * (across @ up)
        if "left_hip" in at:
            below = hips - (middle("knee") + middle("ankle")) / 2
        else:
            below = trunk - 2 * (middle("wrist") - middle("shoulder"))
        hang = float(up @ below) / max(float(np.linalg.norm(below)), 1e-9)
        return up, across, hang if np.linalg.norm(across) > 1e-6 else 0.0

    def stands(self, found: Found) -> bool:
        """Check whether the rest pose is that of a standing person."""
        return self._upright(found)[2] >= 0.5

    def begin_at_rest(
        self, rows: Float[np.ndarray, "T C"], world: list[Rotation]
    ) -> list[Rotation]:
        """Use the first frame as the rest pose, and return rotations relative to it."""
        for index, joint in enumerate(self._joints):
            step = self._step(joint, rows[:1])
            step = np.array(joint.offset) if step is None else step[0]
            up = joint.parent
            self.rest[index] = step if up < 0 else self.rest[up] + world[up][0].apply(step)
        return [each * each[0].inv() for each in world]

    def to_ours(self, found: Found, draft: Draft) -> Rotation:
        """Return the rotation, in quarter turns, from the file's axes to ours: y up, facing z."""
        up, across, hang = self._upright(found)
        if hang < 0.5:
            raise MotionError(
                f"{self._name}: neither in its rest pose nor in its first frame do legs hang below"
                " the trunk, so limbs cannot be laid onto ours; put a T-pose or A-pose into its"
                " first frame (or, in Blender, Apply Pose as Rest Pose)."
            )
        y = _nearest_axis(up)
        x = _nearest_axis(across - y * (across @ y))
        told = draft.told.get("up"), draft.told.get("facing")
        if told[0] is not None or told[1] in AXES:
            y = y if told[0] is None else axis_of(told[0])
            z = np.cross(x, y) if told[1] not in AXES else axis_of(told[1])
            x = np.cross(y, z)
            if not np.linalg.norm(x):
                raise MotionError(f"{self._name} cannot face the way that is up.")
            draft.settled.add("up")
        z = np.cross(x, y)
        stands, faces = (
            ("-" if axis.sum() < 0 else "") + "xyz"[int(np.abs(axis).argmax())] for axis in (y, z)
        )
        by_rest: Sure = "sure" if "left_hip" in found else "unsure"
        tells: tuple[tuple[Kind, str, str, bool], ...] = (
            ("up", stands, stands + faces, stands == "y"),
            ("facing", faces, "xyz".replace(stands[-1], ""), faces == "z" or stands != "y"),
        )
        for kind, value, axes, is_ours in tells:
            others = tuple(axis for axis in AXES if axis[-1] in axes)  # possible together with it
            if draft.told.get(kind) in AXES:
                draft.assume(kind, value, "as you say", "told", others)
            elif by_rest == "unsure" or not is_ours:
                turned = "" if is_ours else "; turned"
                draft.assume(kind, value, f"by its rest pose{turned}", by_rest, others)
        return Rotation.from_matrix(np.stack([x, y, z]))

    def moved(self, rows: Float[np.ndarray, "T C"]) -> list[Rotation]:
        """Compute the world rotation of each joint."""
        world: list[Rotation] = []
        for joint in self._joints:
            at = [i for i, each in enumerate(joint.channels) if each.endswith("rotation")]
            turn = Rotation.identity(len(rows))
            if at:
                order = "".join(joint.channels[i][0] for i in at)
                angles = rows[:, [joint.first + i for i in at]]
                turn = Rotation.from_euler(order, angles, degrees=True)
            world.append(turn if joint.parent < 0 else world[joint.parent] * turn)
        return world

    def way(
        self, index: int, rows: Float[np.ndarray, "T C"], world: list[Rotation]
    ) -> Float[np.ndarray, "T 3"] | None:
        """Compute a joint's positions from position channels up to it; None without any."""
        place: np.ndarray | None = None
        for at in self._path(0, index):
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
            "XYZ".index(each[0]): joint.first + i
            for i, each in enumerate(joint.channels)
            if each.endswith("position")
        }
        if not axes:
            return None
        offset, known = np.array(joint.offset), list(axes)
        step = np.tile(offset, (len(rows), 1))
        told = rows[:, list(axes.values())]
        mean = told.mean(axis=0)
        far = np.linalg.norm(mean - offset[known]) > np.linalg.norm(mean)
        # Positions nearer to zero than to the rest offset are relative to that offset.
        step[:, known] = told + offset[known] if joint.parent >= 0 and far else told
        return step


def _nearest_axis(vector: np.ndarray) -> np.ndarray:
    largest = int(np.abs(vector).argmax())
    return np.eye(3)[largest] * np.sign(vector[largest])


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())


def _plain_labels(names: list[str]) -> list[str]:
    """Simplify names to lower case, without punctuation and their common prefix."""
    plain = [_plain(name) for name in names]
    first, last = min(plain, default=""), max(plain, default="")
    shared = next((i for i, (a, b) in enumerate(zip(first, last)) if a != b), 0)  # noqa: B905
    return [label[shared:] for label in plain] if shared >= 3 else plain


def _side(name: str, label: str) -> str:
    """Return the side in a joint's name, or "" if there is none."""
    spaced = re.sub(r"([a-z])([A-Z])", r"\1_\2", name).lower()
    is_left = bool(_LEFT.search(spaced) or label.startswith("left"))
    is_right = bool(_RIGHT.search(spaced) or label.startswith("right"))
    if is_left == is_right:
        is_left = name[:1] in "lL" and name[1:2].isupper()
        is_right = name[:1] in "rR" and name[1:2].isupper()
    return "" if is_left == is_right else "left" if is_left else "right"


def _poses(
    world: list[Rotation], found: Found, turns: dict[str, Rotation], axes: Rotation
) -> Float[np.ndarray, "T 55 3"]:
    """Compute our joints' local rotations; one that the file lacks follows its parent."""
    ours: list[Rotation] = []
    poses = np.zeros((len(world[0]), NUM_JOINTS, 3))
    for joint, parent in enumerate(PARENTS):
        name = JOINT_NAMES[joint]
        theirs = found.get(name)
        if not theirs:
            ours.append(ours[parent])
            continue
        turned = axes * world[theirs[-1]] * axes.inv()
        turned = turned * turns[name] if name in turns else turned
        ours.append(turned)
        local = turned if parent < 0 else ours[parent].inv() * turned
        poses[:, joint] = local.as_rotvec()
    return poses


def _rest_turns(places: Float[np.ndarray, "J 3"], found: Found) -> dict[str, Rotation]:
    """Return rotations from the rest direction of each limb's bone of ours to the file's."""
    rest = open_body_skeleton().rest_joints.double().numpy()
    turns: dict[str, Rotation] = {}
    for start, end in BONES.items():
        first, last = found.get(start), found.get(end)
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


def _trunk_turns(places: Float[np.ndarray, "J 3"], found: Found) -> dict[str, Rotation]:
    """Return rotations from the rest pose of our trunk and head to the file's."""
    rest = open_body_skeleton().rest_joints.double().numpy()
    theirs = {name: places[at[0]] for name, at in found.items() if at}
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


def _scale(places: Float[np.ndarray, "J 3"], found: Found, draft: Draft) -> float:
    """Return the factor that makes the legs as long as ours."""
    rest = open_body_skeleton().rest_joints.double().numpy()
    limb, parts = "legs", ("left_hip", "left_knee", "left_ankle")
    if not found.get(parts[0]):
        limb, parts = "arms", ("left_shoulder", "left_elbow", "left_wrist")

    def length(limb: np.ndarray) -> float:
        return float(np.linalg.norm(np.diff(limb, axis=0), axis=1).sum())

    theirs = length(places[[found[part][0] for part in parts]])
    scale = length(rest[[JOINT_INDEX[part] for part in parts]]) / max(theirs, 1e-9)
    is_ours = abs(scale - 1.0) < 0.005
    unit = min(METRES, key=lambda each: abs(np.log(METRES[each] / scale)))
    why = f"by its {limb}; lengths multiplied by {scale:.3g}, so that they are as long as ours"
    told = draft.settled_as("units", unit, why, "sure", tuple(METRES), is_ours)
    if "units" in draft.told:
        return METRES[told]
    return 1.0 if is_ours else scale
