"""Small BVH files with the joint names and trees of known conventions, and a second reader of BVH.

Names and trees follow public files; offsets are round numbers.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

FRAMES = 3
_BONES = {"upper arm": 0, "forearm": 1, "thigh": 3, "shin": 4}
"""Where each begins in `Convention.limb_joints`; it ends at the next."""
OUR_JOINTS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")


@dataclass(frozen=True)
class Convention:
    """Names and tree of one convention."""

    tree: str
    """A joint a line with its offset, children two spaces further in. A branch with ``{S}`` or
    ``{s}`` (the side and its first letter) is of the left, and stands for the right as well."""
    limb_joints: str
    """Shoulder, elbow, wrist, hip joint, knee and ankle."""
    sides: tuple[str, str] = ("Left", "Right")
    prefix: str = ""
    order: str = "ZXY"
    is_placed: bool = False
    """Whether all joints have positions."""
    finger: str = ""
    """First joint of the middle finger."""
    is_unsure: bool = False
    """Whether limbs rest so far from ours that their twist is unknown."""

    def bones(self) -> dict[str, tuple[tuple[str, str], tuple[str, str]]]:
        """Their and our joints at the ends of each limb bone, by its name."""
        theirs = self.limb_joints.split()
        bones = {}
        for side, ours in zip(self.sides, ("left", "right"), strict=True):
            for name, at in _BONES.items():
                ends = (theirs[at].format(S=side), theirs[at + 1].format(S=side))
                our_ends = (f"{ours}_{OUR_JOINTS[at]}", f"{ours}_{OUR_JOINTS[at + 1]}")
                bones[f"{ours} {name}"] = ends, our_ends
            if self.finger:
                ends = (theirs[2].format(S=side), self.finger.format(S=side))
                bones[f"{ours} hand"] = ends, (f"{ours}_wrist", f"{ours}_middle1")
        return bones


_MIXAMO = "{S}Arm {S}ForeArm {S}Hand {S}UpLeg {S}Leg {S}Foot"
CONVENTIONS: dict[str, Convention] = {
    "CMU": Convention(  # shoulder and upper arm together are longer than the arm; offsets of 0
        """
Hips 0 95 0
  {s}HipJoint 0 0 0
    {S}UpLeg 8 -8 5
      {S}Leg 14 -40 0
        {S}Foot 15 -41 0
          {S}ToeBase 1 -1 11
  LowerBack 0 0 0
    Spine 0 11 -1
      Spine1 0 11 1
        Neck 0 0 0
          Neck1 0 6 0
            Head 0 6 -1
        {S}Shoulder 0 0 0
          {S}Arm 22 5 -2
            {S}ForeArm 26 0 0
              {S}Hand 15 0 0
                {S}FingerBase 0 0 0
                  {S}HandIndex1 4 0 0
                {s}Thumb 0 0 0""",
        _MIXAMO,
        order="ZYX",
    ),
    "Mixamo": Convention(
        """
Hips 0 95 0
  Spine 0 10 -1
    Spine1 0 12 0
      Spine2 0 13 0
        Neck 0 14 0
          Head 0 9 1
        {S}Shoulder 5 11 0
          {S}Arm 12 0 -1
            {S}ForeArm 27 0 0
              {S}Hand 25 0 0
                {S}HandThumb1 3 -2 3
                  {S}HandThumb2 3 0 1
                    {S}HandThumb3 3 0 0
                {S}HandIndex1 9 0 3
                  {S}HandIndex2 4 0 0
                    {S}HandIndex3 3 0 0
                {S}HandMiddle1 9.5 0 0
                  {S}HandMiddle2 4.5 0 0
                    {S}HandMiddle3 3 0 0
  {S}UpLeg 9 -4 0
    {S}Leg 0 -42 0
      {S}Foot 0 -41 -1
        {S}ToeBase 0 -7 13""",
        _MIXAMO,
        prefix="mixamorig:",
        order="XYZ",
        finger="{S}HandMiddle1",
    ),
    "Biovision": Convention(  # arms hang
        """
Hips 0 95 0
  Chest 0 22 0
    Neck 0 19 0
      Head 0 6 0
    {S}Collar 1 16 2
      {S}UpArm 15 0 -2
        {S}LowArm 0 -29 0
          {S}Hand 0 -24 0
  {S}UpLeg 9 0 0
    {S}LowLeg 0 -44 0
      {S}Foot 0 -42 0""",
        "{S}UpArm {S}LowArm {S}Hand {S}UpLeg {S}LowLeg {S}Foot",
        is_unsure=True,
    ),
    "Xsens": Convention(
        """
Hips 0 95 0
  Chest 0 10 -1
    Chest2 0 10 0
      Chest3 0 9 0
        Chest4 0 9 0
          Neck 0 13 0
            Head 0 9 2
          {S}Collar 3 8 0
            {S}Shoulder 14 0 0
              {S}Elbow 29 0 0
                {S}Wrist 24 0 0
  {S}Hip 9 0 0
    {S}Knee 0 -43 0
      {S}Ankle 0 -41 0
        {S}Toe 0 -9 17""",
        "{S}Shoulder {S}Elbow {S}Wrist {S}Hip {S}Knee {S}Ankle",
        order="YXZ",
    ),
    "Rokoko": Convention(
        """
Hips 0 95 0
  {S}Thigh 9 -4 0
    {S}Shin 0 -42 0
      {S}Foot 0 -41 -1
        {S}Toe 0 -7 13
          {S}ToeTip 0 -1 6
  Spine1 0 9 0
    Spine2 0 9 0
      Spine3 0 9 0
        Spine4 0 9 0
          {S}Shoulder 3 11 0
            {S}Arm 14 0 0
              {S}ForeArm 27 0 0
                {S}Hand 25 0 0
          Neck 0 14 0
            Head 0 9 1""",
        "{S}Arm {S}ForeArm {S}Hand {S}Thigh {S}Shin {S}Foot",
    ),
    "BEAT": Convention(  # the forearm is the second arm
        """
Hips 0 95 0
  Spine 0 9 -3
    Spine1 0 11 -2
      Spine2 0 11 -1
        Spine3 0 11 0
          Neck 0 15 1
            Neck1 0 5 0
              Head 0 5 1
          {S}Shoulder 0 10 6
            {S}Arm 24 0 -6
              {S}Arm1 27 0 0
                {S}Hand 21 0 0
                  {S}HandM1 10 0 0
                    {S}HandM2 5 0 0
                      {S}HandM3 3 0 0
                  {S}HandR 1 0 -1
                    {S}HandR1 9 0 -1
                      {S}HandR2 5 0 0
                        {S}HandR3 3 0 0
                  {S}HandT1 2 -1 3
                    {S}HandT2 3 0 1
                      {S}HandT3 3 0 0
  {S}UpLeg 9 0 0
    {S}Leg 0 -42 0
      {S}Foot 0 -41 0
        {S}FootF 0 -7 7
          {S}ToeBase 0 -1 7""",
        "{S}Arm {S}Arm1 {S}Hand {S}UpLeg {S}Leg {S}Foot",
        sides=("L", "R"),
        order="XYZ",
        finger="{S}HandM1",
    ),
    "ZeroEGGS": Convention(  # ends of bones are joints
        """
Hips 0 95 0
  Spine 0 9 -2
    Spine1 0 9 0
      Spine2 0 12 0
        Spine3 0 12 0
          Neck 0 17 0
            Neck1 0 5 0
              Head 0 5 0
                HeadEnd 0 12 0
          {S}Shoulder 3 11 0
            {S}Arm 10 0 0
              {S}ForeArm 30 0 0
                {S}Hand 23 0 0
                  {S}HandThumb1 4 -3 3
                    {S}HandThumb2 3 0 0
                      {S}HandThumb3 3 0 0
                  {S}HandMiddle1 10 0 0
                    {S}HandMiddle2 4 0 0
                      {S}HandMiddle3 4 0 0
                {S}ForeArmEnd 23 0 0
              {S}ArmEnd 30 0 0
  {S}UpLeg 9 -4 0
    {S}Leg 0 -42 0
      {S}Foot 0 -41 -1
        {S}ToeBase 0 -7 13
          {S}ToeBaseEnd 0 0 6
      {S}LegEnd 0 -41 -1
    {S}UpLegEnd 0 -42 0""",
        _MIXAMO,
        order="ZYX",
        finger="{S}HandMiddle1",
    ),
    "Perception Neuron": Convention(  # bones of the palm before fingers
        """
Hips 0 95 0
  {S}UpLeg 9 -4 0
    {S}Leg 0 -42 0
      {S}Foot 0 -41 -1
  Spine 0 11 0
    Spine1 0 12 0
      Spine2 0 11 0
        {S}Shoulder 4 15 0
          {S}Arm 13 0 0
            {S}ForeArm 28 0 0
              {S}Hand 26 0 0
                {S}HandThumb1 3 0 3
                  {S}HandThumb2 4 0 0
                    {S}HandThumb3 3 0 0
                {S}InHandIndex 3 0 2
                  {S}HandIndex1 6 0 1
                    {S}HandIndex2 4 0 0
                      {S}HandIndex3 2 0 0
                {S}InHandMiddle 4 0 0
                  {S}HandMiddle1 6 0 0
                    {S}HandMiddle2 4 0 0
                      {S}HandMiddle3 3 0 0
        Spine3 0 6 0
          Neck 0 10 0
            Head 0 8 0""",
        _MIXAMO,
        order="YXZ",
        is_placed=True,
    ),
    "MakeHuman": Convention(  # limbs in two parts, fingers by number, A-pose, decimetres
        """
root 0 9.5 0
  pelvis{S} .5 .2 0
    upperleg01{S} .6 -.4 0
      upperleg02{S} 0 -2 0
        lowerleg01{S} 0 -2.2 0
          lowerleg02{S} 0 -2 -.1
            foot{S} 0 -2 -.1
              toe1-1{S} 0 -.7 1.3
                toe1-2{S} 0 0 .3
              toe2-1{S} .1 -.7 1.3
                toe2-2{S} 0 0 .2
                  toe2-3{S} 0 0 .1
              toe3-1{S} .2 -.7 1.2
                toe3-2{S} 0 0 .2
                  toe3-3{S} 0 0 .1
  spine05 0 .5 0
    spine04 0 .7 0
      spine03 0 .9 0
        spine02 0 1 0
          breast{S} .8 .5 1
          spine01 0 1 0
            clavicle{S} .2 1.2 .3
              shoulder01{S} .6 .2 -.4
                upperarm01{S} .7 -.1 -.2
                  upperarm02{S} 1.2 -.8 0
                    lowerarm01{S} 1.2 -.8 0
                      lowerarm02{S} 1 -.7 .1
                        wrist{S} 1 -.7 .1
                          finger1-1{S} .2 -.2 .3
                            finger1-2{S} .2 -.2 .2
                              finger1-3{S} .2 -.2 .1
                          metacarpal1{S} .1 -.1 .1
                            finger2-1{S} .6 -.4 .2
                              finger2-2{S} .3 -.2 0
                                finger2-3{S} .2 -.1 0
                          metacarpal2{S} .1 -.1 0
                            finger3-1{S} .6 -.4 .1
                              finger3-2{S} .3 -.2 0
                                finger3-3{S} .2 -.1 0
                          metacarpal3{S} .1 -.1 -.1
                            finger4-1{S} .6 -.4 0
                              finger4-2{S} .3 -.2 0
                                finger4-3{S} .2 -.1 0
                          metacarpal4{S} .1 -.1 -.2
                            finger5-1{S} .5 -.4 -.1
                              finger5-2{S} .2 -.2 0
                                finger5-3{S} .2 -.1 0
            neck01 0 2 0
              neck02 0 .4 0
                head 0 .5 0
                  jaw 0 .2 .5
                    tongue00 0 0 .2""",
        "upperarm01{S} lowerarm01{S} wrist{S} upperleg01{S} lowerleg01{S} foot{S}",
        sides=(".L", ".R"),
        order="XZY",
    ),
}
_TURNED = ("arm", "elbow", "leg", "knee", "thigh", "shin", "shoulder", "hip", "hand")
_WHOLE = ("02", "hips")
"""Parts of names whose joints hardly turn: the second half of a bone, the pelvis."""


def convention_text(name: str) -> str:
    """A file of `FRAMES` frames in which limbs turn much and all other joints little."""
    convention = CONVENTIONS[name]
    rng = np.random.default_rng(0)
    lines, columns = ["HIERARCHY"], []
    tree = [line for line in convention.tree.splitlines() if line]

    def depth(at: int) -> int:
        return (len(tree[at]) - len(tree[at].lstrip())) // 2 if at < len(tree) else -1

    def add(at: int, side: str = "") -> None:
        label, *numbers = tree[at].split()
        label = label.format(S=side, s=side[:1])
        sign = -1 if side == convention.sides[1] else 1
        offset = np.array(numbers, float) * (sign, 1, 1)
        is_placed = at == 0 or convention.is_placed
        channels = [f"{axis}position" for axis in "XYZ"] if is_placed else []
        channels += [f"{axis}rotation" for axis in convention.order]
        lines.append(f"{'JOINT' if at else 'ROOT'} {convention.prefix}{label}")
        lines.extend(["{", f"OFFSET {' '.join(f'{each:g}' for each in offset)}"])
        lines.append(f"CHANNELS {len(channels)} {' '.join(channels)}")
        if is_placed:
            columns.append(np.tile(offset, (FRAMES, 1)))
        label = label.lower()
        is_limb = any(each in label for each in _TURNED) and not any(e in label for e in _WHOLE)
        columns.append(rng.uniform(-1, 1, (FRAMES, 3)) * (25 if is_limb else 3))
        below = at + 1
        while depth(below) > depth(at):
            if depth(below) == depth(at) + 1:
                is_sided = "{" in tree[below]
                for each in (side,) if side or not is_sided else convention.sides:
                    add(below, each)
            below += 1
        if depth(at + 1) <= depth(at):
            lines.extend(["End Site", "{", "OFFSET 0 0 0", "}"])
        lines.append("}")

    add(0)
    rows = np.concatenate(columns, axis=1)
    lines += ["MOTION", f"Frames: {FRAMES}", "Frame Time: 0.0333333"]
    lines += [" ".join(f"{value:.4f}" for value in row) for row in rows]
    return "\n".join(lines) + "\n"


def joint_positions(path: Path) -> dict[str, np.ndarray]:
    """Read a BVH file and compute where its joints are: (T, 3) by name."""
    header, _, motion = path.read_text("latin-1").partition("MOTION")
    frames = int(motion.split()[1])
    rows = np.array(motion.split("Time:")[1].split()[1:], float).reshape(frames, -1)
    words = iter(header.split())
    places: dict[str, np.ndarray] = {}
    turns: dict[str, Rotation] = {}
    above: list[str] = []
    name, offset, column = "", np.zeros(3), 0
    for word in words:
        if word in ("ROOT", "JOINT", "End"):
            name = next(words).split(":")[-1]
        elif word == "{":
            above.append(name)
        elif word == "}":
            above.pop()
        elif word == "OFFSET":
            offset = np.array([float(next(words)) for _ in range(3)])
        elif word == "CHANNELS":
            place, turn = np.tile(offset, (frames, 1)), Rotation.identity(frames)
            for channel in [next(words) for _ in range(int(next(words)))]:
                if channel[1:].lower() == "position":
                    place[:, "XYZ".index(channel[0])] = rows[:, column]
                else:
                    turn *= Rotation.from_euler(channel[0], rows[:, column : column + 1], True)
                column += 1
            if len(above) > 1:
                place = places[above[-2]] + turns[above[-2]].apply(place)
                turn = turns[above[-2]] * turn
            places[name], turns[name] = place, turn
    assert column == rows.shape[1]
    return places
