"""Where one comparison takes place: one camera and one floor for all of its bodies, and close-ups
beside the picture: which there are, where they stand, and what is drawn in them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Float32, Int
from scipy import ndimage

from conventions.joints import FINGERS, JOINT_INDEX, JOINT_NAMES
from conventions.views import Framing
from renderer.body.body import Body, BodyMotion
from renderer.scene.camera import Camera, Orbit, frame_points, outermost

CLOSE_UP_VIEWS: dict[str, tuple[str, ...]] = {
    "face": ("face",),
    "hands": ("right_hand", "left_hand"),
}
"""Views of each close-up from the left to the right: from the front, the right hand is left."""

_DRAWN = {
    "face": ("head", "jaw", "eye", "neck", "spine3", "collar", "shoulder"),
    **{
        f"{side}_hand": tuple(f"{side}_{part}" for part in ("shoulder", "elbow", "wrist", *FINGERS))
        for side in ("left", "right")
    },
}
"""Joints, by parts of their names, whose flesh is drawn: a hand alone is hidden by nothing, and
takes a tenth of the time of a body."""
CLOSE_UP_JOINTS = {
    "face": [JOINT_INDEX[name] for name in ("head", "jaw", "left_eye", "right_eye")],
    **{
        f"{side}_hand": [
            index
            for index, name in enumerate(JOINT_NAMES)
            if name == f"{side}_wrist" or (name.startswith(side) and name[-1] in "123")
        ]
        for side in ("left", "right")
    },
}
"""Joints that the camera of a close-up follows; the other views show them all."""

CLOSE_UP_SIGMA_FRAMES, WALK_SIGMA_FRAMES = 12.0, 30.0
"""A camera that follows moves slowly, so that the jitter of what it shows can be seen."""
STEADY_SIGMA_FRAMES = 2.0
"""Of the hands beside a picture: their camera takes away gestures, below 2 Hz, so that a hand stays
large in its place, and leaves them what trembles, above 5 Hz, as it is."""
FINGERTIP_M = 0.035
"""How far a fingertip reaches beyond its last joint, at most."""

FOLLOW_BEYOND_M = 1.5
"""Where the bodies of a comparison wander farther, cameras go with them: one that stood still would
have to show all of the way, and the bodies small."""

MIDDLE_M = 1.0
"""Height of what a camera is moved around, over the floor."""

BELOW_KNEES = ("ankle", "foot")
KNEE_FLESH_M = 0.1

_PIECE_FRAMES = 512

FEET = [JOINT_INDEX[f"{side}_{name}"] for side in ("left", "right") for name in ("ankle", "foot")]


@dataclass(frozen=True)
class Panel:
    """A rectangle of a picture, in pixels from its upper left corner, and the view shown in it."""

    view: str
    left: int
    top: int
    width: int
    height: int

    @property
    def aspect(self) -> float:
        return self.width / self.height

    @property
    def box(self) -> tuple[slice, slice]:
        """Its rows and columns."""
        return (
            slice(self.top, self.top + self.height),
            slice(self.left, self.left + self.width),
        )


def lay_out(view: str, width: int, height: int, close_ups: Sequence[str]) -> tuple[Panel, ...]:
    """The body, then the close-ups: the face stands above it, the hands below.

    Args:
        width, height: of the body's panel; each close-up adds half a width to the height.
    """
    tall = width // 2 - width // 2 % 2
    above = tall if "face" in close_ups else 0
    panels = [Panel(view, 0, above, width, height)]
    if "face" in close_ups:
        panels.append(Panel("face", 0, 0, width, tall))
    if "hands" in close_ups:
        right, left = CLOSE_UP_VIEWS["hands"]
        top = above + height
        panels.append(Panel(right, 0, top, width // 2, tall))
        panels.append(Panel(left, width // 2, top, width - width // 2, tall))
    return tuple(panels)


@dataclass(frozen=True)
class Cutout:
    """Part of a mesh."""

    vertices: Int[np.ndarray, " N"]
    """Their numbers in the whole mesh."""
    faces: Int[np.ndarray, "F 3"]
    """Among ``vertices``."""


def drawn_joints(view: str) -> list[int]:
    """Joints whose flesh a close-up shows."""
    parts = _DRAWN[view]
    return [j for j, name in enumerate(JOINT_NAMES) if any(part in name for part in parts)]


def cut_out(body: Body, view: str) -> Cutout:
    """The part of a body that a close-up shows. An arm ends closed in the middle of the upper arm:
    at the shoulder its end would be ragged."""
    is_kept = np.isin(body.main_joints, drawn_joints(view))
    side = view.removesuffix("_hand")
    if is_arm := side != view:
        shoulder, elbow = (JOINT_INDEX[f"{side}_{name}"] for name in ("shoulder", "elbow"))
        arm, here = (
            a - body.rest_joints[shoulder] for a in (body.rest_joints[elbow], body.template)
        )
        is_kept &= (body.main_joints != shoulder) | ((here - arm / 2) @ arm >= 0)
    is_whole = is_kept[body.faces].all(axis=1)
    faces = body.faces[is_whole]
    if is_arm:
        faces = np.concatenate([faces, _lid(faces, body.faces[~is_whole])])
    vertices = np.unique(faces)
    place = np.zeros(body.num_vertices, np.int32)
    place[vertices] = np.arange(len(vertices), dtype=np.int32)
    return Cutout(vertices, place[faces])


def _lid(kept: Int[np.ndarray, "F 3"], others: Int[np.ndarray, "G 3"]) -> Int[np.ndarray, "N 3"]:
    """Over the one end at which some faces were cut off from others: a fan from one corner."""
    edges, theirs = (faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2) for faces in (kept, others))
    count = 1 + max(edges.max(), theirs.max())
    cut = edges[np.isin(edges @ (count, 1), theirs @ (1, count))]
    return np.column_stack([np.broadcast_to(cut[0, 0], len(cut)), cut[:, ::-1]])


@dataclass(frozen=True)
class Shot:
    """The camera of a panel."""

    view: str
    camera: Camera
    """Where it follows: relative to the point that it follows."""
    sigma_frames: float | None = None
    """How slowly it goes with the body; None stands still."""
    way: Float[np.ndarray, "T 3"] | None = None
    """Where it goes in each frame, metres; None follows whatever motion is drawn."""

    @property
    def is_following(self) -> bool:
        return self.sigma_frames is not None


@dataclass(frozen=True)
class Stage:
    """Cameras, and the floor under the motions they were made for. Metres, y up."""

    shots: tuple[Shot, ...]
    """Of the body's panel, and after it of the close-ups."""
    floor_m: float
    centre_xz: tuple[float, float] = (0.0, 0.0)
    """Middle of the ground that the joints stay above."""
    extent_m: float = 0.0
    """Longer side of that ground."""

    @property
    def camera(self) -> Camera:
        """Of the body's panel."""
        return self.shots[0].camera

    def pixel_m(self, shot: Shot, height_px: int) -> float:
        """Return the size of a pixel (m) in the middle of the ground, or where a shot follows, of a
        picture of that height; 0 behind the camera."""
        x, z = (0.0, 0.0) if shot.is_following else self.centre_xz
        up_m = 0.0 if shot.view in CLOSE_UP_JOINTS else self.floor_m + MIDDLE_M
        camera = shot.camera
        away_m = float(camera.axes()[2] @ np.subtract(camera.eye, (x, up_m, z)))
        return max(away_m, 0.0) * 2.0 * float(np.tan(camera.yfov_rad / 2.0)) / height_px

    def seen_from(self, orbit: Orbit) -> "Stage":
        """The same stage before a camera that was moved around the middle of its bodies."""
        if not orbit.is_moved:
            return self
        first, *others = self.shots
        x, z = (0.0, 0.0) if first.is_following else self.centre_xz
        middle = np.array([x, self.floor_m + MIDDLE_M, z])
        moved = replace(first, camera=orbit.moved(first.camera, middle))
        return replace(self, shots=(moved, *others))

    def tracks(self, body: Body, motion: BodyMotion) -> list[Float[np.ndarray, "T 3"]]:
        """Where the camera of each shot stands in each frame, relative to it, metres."""
        positions = None
        tracks = []
        for shot in self.shots:
            if shot.way is not None:
                tracks.append(shot.way)
            elif shot.sigma_frames is None:
                tracks.append(np.zeros((motion.num_frames, 3)))
            else:
                positions = _joint_positions(body, motion) if positions is None else positions
                tracks.append(_track(positions, shot.view, shot.sigma_frames))
        return tracks

    def going(self, ways: Sequence[Float[np.ndarray, "T 3"]]) -> "Stage":
        """The same stage, whose cameras go these ways, whatever is drawn."""
        shots = (replace(shot, way=way) for shot, way in zip(self.shots, ways, strict=True))
        return replace(self, shots=tuple(shots))


def set_stage(
    body: Body,
    motions: Sequence[BodyMotion],
    view: str = "front",
    aspect: float = 1.0,
    close_ups: Sequence[Panel] = (),
    framing: Framing = "whole",
) -> Stage:
    """The stage that shows all of these motions, each in turn, with equal cameras.

    The joints of every frame are framed, each with the reach of the flesh around it: far cheaper
    than posing every vertex, and the picture's margin takes up what skinning adds. Of a hand beside
    the picture no more of the arm is framed than there is room for.

    Args:
        view: one of ``conventions.views.VIEWS``.
        aspect: width of the picture by its height.
        close_ups: panels that show parts of the body beside the picture.
        framing: of a view that is no close-up.
    """
    reach = _reach(body)
    if framing == "knees":
        knees = [JOINT_INDEX[f"{side}_knee"] for side in ("left", "right")]
        reach[knees] = np.minimum(reach[knees], KNEE_FLESH_M)
    joints = CLOSE_UP_JOINTS.get(view, _framed(framing))
    sigma = CLOSE_UP_SIGMA_FRAMES if view in CLOSE_UP_JOINTS else WALK_SIGMA_FRAMES
    seen = [(view, aspect, joints, reach[joints], sigma)]
    for panel in close_ups:
        joints, is_face = CLOSE_UP_JOINTS[panel.view], panel.view == "face"
        flesh = reach[joints] if is_face else np.minimum(reach[joints], FINGERTIP_M)
        sigma = CLOSE_UP_SIGMA_FRAMES if is_face else STEADY_SIGMA_FRAMES
        seen.append((panel.view, panel.aspect, joints, flesh, sigma))
    places: list[list[np.ndarray]] = [[] for _ in seen]
    from_afar, pelvises, floors, corners = [], [], [], []
    for motion in motions:
        positions = _joint_positions(body, motion)
        from_afar.append(outermost(positions[:, seen[0][2]], view, aspect=aspect))
        for found, (name, ratio, joints, _, sigma) in zip(places, seen, strict=True):
            relative = positions[:, joints] - _track(positions, name, sigma)[:, None]
            found.append(outermost(relative, name, aspect=ratio))
        pelvises += [positions[:, 0].min(axis=0), positions[:, 0].max(axis=0)]
        floors.append(_floor(body, positions))
        corners += [positions.min(axis=(0, 1)), positions.max(axis=(0, 1))]
    wandered_m = float(np.ptp(pelvises, axis=0)[[0, 2]].max())
    shots = []
    for found, (name, ratio, _, flesh, sigma) in zip(places, seen, strict=True):
        if not shots and view not in CLOSE_UP_JOINTS and wandered_m <= FOLLOW_BEYOND_M:
            found, sigma = from_afar, None
        points = np.concatenate(found)
        radius = np.broadcast_to(flesh, points.shape[:2]).ravel()
        camera = frame_points(points.reshape(-1, 3), name, aspect=ratio, radius_m=radius)
        shots.append(Shot(name, camera, sigma))
    low, high = np.min(corners, axis=0), np.max(corners, axis=0)
    return Stage(
        shots=tuple(shots),
        floor_m=float(np.median(floors)),
        centre_xz=(float(low[0] + high[0]) / 2.0, float(low[2] + high[2]) / 2.0),
        extent_m=float(max(high[0] - low[0], high[2] - low[2])),
    )


def _framed(framing: Framing) -> list[int]:
    """Joints that a view shows that is no close-up."""
    hidden = BELOW_KNEES if framing == "knees" else ()
    return [
        joint for joint, name in enumerate(JOINT_NAMES) if not any(part in name for part in hidden)
    ]


def frames_of(motion: BodyMotion, frames: slice | Sequence[int]) -> BodyMotion:
    """Some of the frames of a motion, as a motion."""
    chosen = frames if isinstance(frames, slice) else np.asarray(frames, dtype=np.intp)
    return replace(
        motion,
        poses=motion.poses[chosen],
        trans=motion.trans[chosen],
        expressions=motion.expressions[chosen],
    )


def _joint_positions(body: Body, motion: BodyMotion) -> Float32[np.ndarray, "T J 3"]:
    """All joints of a clip, computed in pieces so that memory follows the result alone."""
    starts = range(0, motion.num_frames, _PIECE_FRAMES)
    pieces = [
        body.joint_positions(frames_of(motion, slice(start, start + _PIECE_FRAMES)))
        for start in starts
    ]
    return np.concatenate(pieces)


def _track(
    positions: Float[np.ndarray, "T J 3"], view: str, sigma_frames: float
) -> Float[np.ndarray, "T 3"]:
    """The smoothed middle of a close-up's joints; of other views, of the pelvis over the ground."""
    if view in CLOSE_UP_JOINTS:
        middle = positions[:, CLOSE_UP_JOINTS[view]].mean(axis=1)
    else:
        middle = positions[:, 0] * np.array([1.0, 0.0, 1.0], np.float32)
    return ndimage.gaussian_filter1d(middle, sigma_frames, axis=0, mode="nearest")


def _reach(body: Body) -> Float[np.ndarray, " J"]:
    """Distance from each joint to the farthest vertex that mainly follows it, at rest."""
    owner = body.main_joints
    distance = np.linalg.norm(body.template - body.rest_joints[owner], axis=1)
    reach = np.zeros(len(body.rest_joints))
    np.maximum.at(reach, owner, distance)
    return reach


def _floor(body: Body, positions: Float[np.ndarray, "T J 3"]) -> float:
    """Height of the soles in the median frame: the lower foot is taken to stand."""
    sole = body.rest_joints[FEET, 1] - body.template[:, 1].min()
    return float(np.median((positions[:, FEET, 1] - sole).min(axis=1)))
