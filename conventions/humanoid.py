"""Assignment of a humanoid skeleton's joints to those of SMPL-X, by their names and the tree.

Limbs and fingers are identified by the names of their joints, or by the tree and the lengths of
bones if the names are unclear. Readers of motion files and of characters share these tables.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Float

from conventions.names import pluralise

_FINGERS = ("Index", "Middle", "Pinky", "Ring", "Thumb")
BONE_END_JOINTS: dict[str, str] = {
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
class LimbNamePatterns:
    """Regular expressions of a limb's joints, matched with lower-case names without punctuation."""

    end: str
    """Pattern of the wrist or ankle."""
    lower: str
    """Pattern of the elbow or knee."""
    upper: str
    """Pattern of unambiguous names of the shoulder or hip joint."""
    upper_or_lower: str
    """Pattern of the upper or lower part, depending on the others: ``LeftUpLeg`` or ``LeftLeg``."""
    joint_before_limb: str
    """Pattern of the joint before the limb, or else of the upper part: ``LeftShoulder``."""


ARM = LimbNamePatterns(
    "hand|wrist", "forearm|lo(w|wer)?arm|armlo|elbow|radius", "up(per)?arm|armup|humer", "arm",
    "shoulder|shldr",
)  # fmt: skip
LEG = LimbNamePatterns(
    "foot|ankle", "lo(w|wer)?leg|leglo|knee|shin|calf|tibia", "up(per)?leg|legup|thigh|femur",
    "leg", "hip",
)  # fmt: skip
SIMILAR_LENGTHS = 0.8
"""Length ratio of two bone pairs above which the limb is uncertain (CMU: 0.88; our body: 0.77)."""
JointMap = dict[str, list[int]]
"""Indices of the file's joints for each of ours, with rotations that are combined."""


class NoHumanoidError(ValueError):
    """Error for a skeleton without a trunk and two arms; the message is one sentence."""


class JointTree:
    """Joints of a skeleton in depth-first order, with the assignment to those of SMPL-X."""

    def __init__(
        self,
        source: str,
        joint_names: Sequence[str],
        parents: Sequence[int],
        rest: Float[np.ndarray, "J 3"],
    ) -> None:
        """Prepare the assignment.

        Args:
            source: name of the file, for messages.
            joint_names: name of each joint; a joint follows its parent and its parent's earlier
                branches.
            parents: index of each joint's parent, -1 for the first joint.
            rest: joint positions in the rest pose, in any unit.
        """
        self.source = source
        self._joint_names = joint_names
        self._parents = parents
        self.rest = rest
        """Joint positions (J, 3) in the rest pose, in the file's axes."""
        self.doubts: list[str] = []
        """Joints that neither names nor lengths identify with certainty."""
        self._children: list[list[int]] = [[] for _ in parents]
        self._sizes = [1] * len(parents)
        for index in reversed(range(len(parents))):
            if parents[index] >= 0:
                self._children[parents[index]].insert(0, index)
                self._sizes[parents[index]] += self._sizes[index]
        self._labels = _plain_labels(joint_names)

    def joint_map(self) -> JointMap:
        """Assign joints by names and tree: two legs and a trunk at the pelvis, arms at the chest.

        Raises NoHumanoidError if there is no trunk with two arms.
        """
        forks = (at for at in self._down(0) if len(self._limbs(at)) >= 3)
        pelvis = next((at for at in forks if self._trunk(at) is not None), 0)
        trunk = self._trunk(pelvis)
        if trunk is None:
            raise self._unknown("no joint of its trunk has two arms")
        chest = next((at for at in self._down(trunk) if len(self._limbs(at)) >= 2), None)
        if chest is None:
            raise self._unknown("no joint has two arms")
        below = range(trunk, trunk + self._sizes[trunk])
        branches = (
            [each for each in self._limbs(at) if each != trunk]
            for at in range(pelvis, len(self._parents))
            if at not in below
        )
        legs = next((self._mirrored(each, LEG) for each in branches if len(each) >= 2), ())
        if not legs and len(self._limbs(chest)) > 3:
            raise self._unknown("no joint has two legs and a trunk")
        arms = self._mirrored(self._limbs(chest), ARM)
        ahead, left = np.zeros(3), np.zeros(3)
        if legs:
            soles = [self._down(leg)[-2:] for leg in legs]
            ahead = sum((self.rest[toe] - self.rest[ankle] for ankle, toe in soles), ahead)
            up = self.rest[chest] - self.rest[[sole[-1] for sole in soles]].mean(axis=0)
            left = np.cross(up, ahead)
        others = [each for each in self._children[chest] if each not in arms]
        head = max(others, key=lambda each: self._sizes[each], default=None)
        spine = self.path_from_ancestor(trunk, chest)
        joint_map: JointMap = {"pelvis": [pelvis], "spine1": spine[:1], "spine2": spine[1:2]}
        joint_map |= {"spine3": spine[2:]} | ({} if head is None else self._neck(self._down(head)))
        for side, arm in zip(("left", "right"), self._sided(arms, left), strict=True):
            joint_map |= self._limb(arm, side, ("collar", "shoulder", "elbow", "wrist", ""), ARM)
            joint_map |= self._fingers(joint_map[f"{side}_wrist"][-1], side, ahead)
        for side, leg in zip(
            ("left", "right"), self._sided(legs, left) if legs else (), strict=False
        ):
            joint_map |= self._limb(leg, side, ("", "hip", "knee", "ankle", "foot"), LEG)
        return joint_map

    def _unknown(self, why: str) -> NoHumanoidError:
        names = ", ".join(name[:24] for name in self._joint_names[:12])
        return NoHumanoidError(
            f"{self.source} is not recognised as a humanoid, because {why}; its"
            f" {len(self._parents)} joints are {names} …. A trunk and two arms are needed: retarget"
            " it to a Mixamo or SMPL-X skeleton first."
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

    def _mirrored(self, limbs: list[int], names: LimbNamePatterns) -> tuple[int, int]:
        """Return the two branches with such a limb's names, or else of the most similar lengths."""
        pattern = re.compile(f"{names.end}|{names.lower}")
        named = [
            each
            for each in limbs
            if any(map(pattern.search, self._labels[each : each + self._sizes[each]]))
        ]
        limbs = named if len(named) >= 2 else limbs
        if len(limbs) < 2:
            raise self._unknown("its trunk has fewer than two limbs")
        return min(combinations(limbs, 2), key=lambda two: self._length_difference(*two))

    def _length_difference(self, one: int, other: int) -> float:
        """Compute the difference in length of two branches; infinite for the neck's."""
        if any(re.search(r"neck|head", self._labels[each]) for each in (one, other)):
            return np.inf
        lengths = [
            np.linalg.norm(np.diff(self.rest[self._down(each)], axis=0), axis=1).sum()
            for each in (one, other)
        ]
        return abs(float(lengths[0] - lengths[1]))

    def path_from_ancestor(self, ancestor: int, joint: int) -> list[int]:
        """Return the joints from ``ancestor`` down to ``joint``; raises ValueError if unrelated."""
        path = [joint]
        while path[-1] != ancestor:
            path.append(self._parents[path[-1]])
            if path[-1] < 0:
                raise ValueError(f"Joint {ancestor} is not an ancestor of joint {joint}.")
        return path[::-1]

    def _sided(self, two: tuple[int, int], left: Float[np.ndarray, " 3"]) -> tuple[int, int]:
        """Order two branches left and right, by name, or else by the direction of the feet."""
        swapped = (two[1], two[0])
        for order in (two, swapped):
            sides = [side_of(self._joint_names[each], self._labels[each]) for each in order]
            if sides in (["left", "right"], ["left", ""], ["", "right"]):
                return order
        return two if (self.rest[two[0]] - self.rest[two[1]]) @ left > 0 else swapped

    def _limb(
        self, start: int, side: str, names: tuple[str, ...], assigned: LimbNamePatterns
    ) -> JointMap:
        """Find a limb's joints by name, or else by length: the two longest consecutive bones."""
        path = [at for at in self._down(start) if not re.search("twist|roll", self._labels[at])]
        places = self.rest[path]
        lengths = np.linalg.norm(np.diff(places, axis=0), axis=1)
        if len(lengths) < 2:
            raise self._unknown(f"a limb has only {pluralise(len(path), 'joint')}")
        before, *three, after = names
        first, middle, end = self._named_limb(path, assigned) or self._longest(lengths, three[1])
        starts = {three[0]: path[first:middle], three[1]: path[middle:end], three[2]: [path[end]]}
        limb: JointMap = {f"{side}_{name}": joints for name, joints in starts.items()}
        if first and before:
            limb[f"{side}_{before}"] = path[:first]
        beyond = path[end + 1 :]
        if after and beyond:
            toes = [at for at in beyond if re.search("toe|ball", self._labels[at])]
            shin = places[end] - places[end - 1]
            steps = self.rest[beyond] - places[end]
            far = np.linalg.norm(steps, axis=1) * np.linalg.norm(shin)
            ball = int(np.argmax(steps @ shin < 0.8 * far))  # not a heel below the ankle; else 0
            limb[f"{side}_{after}"] = [toes[0] if toes else beyond[ball]]
        return limb

    def _named_limb(self, path: list[int], names: LimbNamePatterns) -> tuple[int, int, int] | None:
        """Find where a limb's upper part, lower part and end start on a path, by name."""

        def of(pattern: str, stop: int) -> list[int]:
            return [at for at in range(stop) if re.search(pattern, self._labels[path[at]])]

        ends = of(names.end, len(path))
        if not ends:
            return None
        end = ends[0]
        above = f"{names.upper}|{names.upper_or_lower}|{names.joint_before_limb}"
        lowers = of(names.lower, end)
        lowers = lowers or [at for at in of(names.upper_or_lower, end)[-1:] if of(above, at)]
        if not lowers:
            return None
        lower = lowers[0]
        uppers = (
            of(names.upper, lower)
            or of(names.upper_or_lower, lower)
            or of(names.joint_before_limb, lower)[-1:]
        )
        return (uppers[0], lower, end) if uppers else None

    def _longest(self, lengths: Float[np.ndarray, " bones"], middle: str) -> tuple[int, int, int]:
        """Return the start, middle and end of the two consecutive bones with the longest sum."""
        sums = lengths[:-1] + lengths[1:]
        first = int(np.argmax(sums))
        if np.delete(sums, first).max(initial=0.0) > SIMILAR_LENGTHS * sums[first]:
            self.doubts.append(middle)
        return first, first + 1, first + 2

    def _neck(self, heads: list[int]) -> JointMap:
        named = [at for at, each in enumerate(heads) if "head" in self._labels[each]]
        end = named[0] if named else min(1, len(heads) - 1)
        joint_map: JointMap = {"head": [heads[end]]}
        return joint_map | ({"neck": heads[:end]} if end else {})

    def _fingers(self, wrist: int, side: str, ahead: Float[np.ndarray, " 3"]) -> JointMap:
        """Find finger joints by names with numbers, or else by chains.

        Chains are named, or ordered: the thumb starts nearest the wrist, the others lie in a row.
        """
        fingers: JointMap = {}
        for finger, spelling in _FINGER_NAMES.items():
            for at in range(wrist + 1, wrist + self._sizes[wrist]):
                number = re.search(rf"(?:{spelling})[a-z]*0?([123])(?!\d)", self._labels[at])
                if number:
                    fingers.setdefault(f"{side}_{finger}{number[1]}", [at])
        if fingers:
            return fingers
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
                fingers[f"{side}_{finger}{segment}"] = [joint]
        return fingers

    def _thumb_number(self, wrist: int) -> int:
        """Return the number of the thumb among numbered fingers: 0 (3ds Max) or 1 (MakeHuman)."""
        labels = self._labels[wrist : wrist + self._sizes[wrist]]
        return 0 if any("finger0" in label for label in labels) else 1

    def body_axes_and_leg_cosine(self, joint_map: JointMap) -> tuple[np.ndarray, np.ndarray, float]:
        """Return up along the trunk (unit), left across it (any length), cosine of legs and down.

        Without legs the last value tells how far the arms are below the shoulders.
        """
        at = {name: self.rest[theirs[0]] for name, theirs in joint_map.items() if theirs}
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

    def is_standing(self, joint_map: JointMap) -> bool:
        """Check whether the rest pose is that of a standing person."""
        return self.body_axes_and_leg_cosine(joint_map)[2] >= 0.5


def nearest_axis(vector: Float[np.ndarray, " 3"]) -> np.ndarray:
    """Return the unit vector along the axis that is nearest to a vector."""
    largest = int(np.abs(vector).argmax())
    return np.eye(3)[largest] * np.sign(vector[largest])


def letters_and_digits(name: str) -> str:
    """Simplify a name to lower-case letters and digits."""
    return re.sub(r"[^a-z0-9]", "", name.lower())


def _plain_labels(names: Sequence[str]) -> list[str]:
    """Simplify names to lower case, without punctuation and their common prefix."""
    plain = [letters_and_digits(name) for name in names]
    first, last = min(plain, default=""), max(plain, default="")
    shared = next((i for i, (a, b) in enumerate(zip(first, last, strict=False)) if a != b), 0)
    return [label[shared:] for label in plain] if shared >= 3 else plain


def side_of(name: str, plain_name: str = "") -> str:
    """Return the side in a joint's name or its simplified name, or "" if there is none."""
    spaced = re.sub(r"([a-z])([A-Z])", r"\1_\2", name).lower()
    is_left = bool(_LEFT.search(spaced) or plain_name.startswith("left"))
    is_right = bool(_RIGHT.search(spaced) or plain_name.startswith("right"))
    if is_left == is_right:
        is_left = name[:1] in "lL" and name[1:2].isupper()
        is_right = name[:1] in "rR" and name[1:2].isupper()
    return "" if is_left == is_right else "left" if is_left else "right"
