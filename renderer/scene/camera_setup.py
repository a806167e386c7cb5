"""Stage of a comparison: one camera and floor for all bodies, and the layout of close-ups."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Float32, Int
from scipy import ndimage

from conventions.joints import FINGERS, JOINT_INDEX, JOINT_NAMES
from conventions.views import Framing
from renderer.body.body import Body, BodyMotion
from renderer.scene.camera import Camera, Orbit, extreme_positions_per_joint, fit_camera

CLOSE_UP_VIEWS: dict[str, tuple[str, ...]] = {
    "face": ("face",),
    "hands": ("right_hand", "left_hand"),
}
"""Views of each close-up from left to right: from the front, the right hand is on the left."""

_CLOSE_UP_FLESH = {
    "face": ("head", "jaw", "eye", "neck", "spine3", "collar", "shoulder"),
    **{
        f"{side}_hand": tuple(f"{side}_{part}" for part in ("shoulder", "elbow", "wrist", *FINGERS))
        for side in ("left", "right")
    },
}
"""Parts of joint names whose vertices a close-up draws: a hand alone is hidden by nothing, and
takes a tenth of the time of a body."""
FOLLOWED_CLOSE_UP_JOINTS = {
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
"""Joints that the camera of a close-up follows; the other views show all joints."""

CLOSE_UP_SIGMA_FRAMES, WALK_SIGMA_FRAMES = 12.0, 30.0
"""Smoothing of following cameras (frames), slow so that jitter of the motion stays visible."""
HAND_CAMERA_SIGMA_FRAMES = 2.0
"""Smoothing of hand close-ups (frames): their camera removes gestures, below 2 Hz, so that a hand
stays large and centred, and leaves tremor, above 5 Hz, unchanged.
"""
MAX_LEAD_M, CLOSE_UP_LEAD_M = 0.3, 0.15
"""Largest distance (m) of a following camera from the point that it follows: without a limit, a
body that starts to walk or jumps away would make all bodies small."""
FINGERTIP_M = 0.035
"""Largest distance (m) of a fingertip from its last joint."""

MAX_STATIC_PELVIS_RANGE_M = 1.5
"""Range of the bodies (m) above which cameras follow them: a static one would have to show the
whole path, with small bodies."""

ORBIT_CENTRE_HEIGHT_M = 1.0
"""Height of the orbit centre above the floor (m)."""

BELOW_KNEES = ("ankle", "foot")
KNEE_FLESH_M = 0.1

_PIECE_FRAMES = 512

FEET = [JOINT_INDEX[f"{side}_{name}"] for side in ("left", "right") for name in ("ankle", "foot")]


@dataclass(frozen=True)
class Panel:
    """Rectangle of a picture, in pixels from its upper left corner, with its view."""

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
        """Rows and columns of the panel."""
        return (slice(self.top, self.top + self.height), slice(self.left, self.left + self.width))


def layout_panels(
    view: str, body_width: int, body_height: int, close_ups: Sequence[str]
) -> tuple[Panel, ...]:
    """Return the panels: the body, then the close-ups, with the face above and the hands below.

    The size is that of the body's panel; each close-up adds half its width to the height.
    """
    tall = body_width // 2 - body_width // 2 % 2
    above = tall if "face" in close_ups else 0
    panels = [Panel(view, 0, above, body_width, body_height)]
    if "face" in close_ups:
        panels.append(Panel("face", 0, 0, body_width, tall))
    if "hands" in close_ups:
        right, left = CLOSE_UP_VIEWS["hands"]
        top = above + body_height
        panels.append(Panel(right, 0, top, body_width // 2, tall))
        panels.append(Panel(left, body_width // 2, top, body_width - body_width // 2, tall))
    return tuple(panels)


@dataclass(frozen=True)
class SubMesh:
    """Part of a mesh."""

    vertices: Int[np.ndarray, " N"]
    """Indices of the vertices in the whole mesh."""
    faces: Int[np.ndarray, "F 3"]
    """Faces as indices into ``vertices``."""


def drawn_close_up_joints(view: str) -> list[int]:
    """Return the joints of the vertices that a close-up shows."""
    parts = _CLOSE_UP_FLESH[view]
    return [j for j, name in enumerate(JOINT_NAMES) if any(part in name for part in parts)]


def close_up_mesh(body: Body, view: str) -> SubMesh:
    """Return the part that a close-up shows; an arm ends closed in the middle of the upper arm."""
    is_near = np.isin(body.dominant_joints, drawn_close_up_joints(view))
    side = view.removesuffix("_hand")
    if is_arm := side != view:
        shoulder, elbow = (JOINT_INDEX[f"{side}_{name}"] for name in ("shoulder", "elbow"))
        arm, here = (
            a - body.rest_joints[shoulder] for a in (body.rest_joints[elbow], body.template)
        )
        is_near &= (body.dominant_joints != shoulder) | ((here - arm / 2) @ arm >= 0)
    is_whole = is_near[body.faces].all(axis=1)
    faces = body.faces[is_whole]
    if is_arm:
        faces = np.concatenate([faces, _cap_hole(faces, body.faces[~is_whole])])
    vertices = np.unique(faces)
    place = np.zeros(body.num_vertices, np.int32)
    place[vertices] = np.arange(len(vertices), dtype=np.int32)
    return SubMesh(vertices, place[faces])


def _cap_hole(
    remaining: Int[np.ndarray, "F 3"], others: Int[np.ndarray, "G 3"]
) -> Int[np.ndarray, "N 3"]:
    """Return faces that close the one end where faces were cut off: a fan from one corner."""
    edges, theirs = (faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2) for faces in (remaining, others))
    count = 1 + max(edges.max(), theirs.max())
    cut = edges[np.isin(edges @ (count, 1), theirs @ (1, count))]
    return np.column_stack([np.broadcast_to(cut[0, 0], len(cut)), cut[:, ::-1]])


@dataclass(frozen=True)
class PanelCamera:
    """Camera of a panel."""

    view: str
    camera: Camera
    """Camera; if it follows, relative to the point that it follows."""
    smoothing_sigma_frames: float | None = None
    """Smoothing of following (frames); None for a static camera."""
    followed_path_override: Float[np.ndarray, "T 3"] | None = None
    """Positions (T, 3) of the tracked point, metres; None follows the drawn motion."""

    @property
    def is_following(self) -> bool:
        return self.smoothing_sigma_frames is not None


@dataclass(frozen=True)
class CameraSetup:
    """Cameras and floor for a set of motions. Metres, y up."""

    panel_cameras: tuple[PanelCamera, ...]
    """Cameras of the body's panel, then of the close-ups."""
    floor_m: float
    centre_xz: tuple[float, float] = (0.0, 0.0)
    """Centre (x, z) of the area below the joints (m)."""
    horizontal_span_m: float = 0.0
    """Longer side of that area (m)."""

    @property
    def camera(self) -> Camera:
        """Camera of the body's panel."""
        return self.panel_cameras[0].camera

    def pixel_size_m(self, panel_camera: PanelCamera, height_px: int) -> float:
        """Return the size of a pixel (m) at the centre or tracked point; 0 behind the camera."""
        x, z = (0.0, 0.0) if panel_camera.is_following else self.centre_xz
        up_m = (
            0.0
            if panel_camera.view in FOLLOWED_CLOSE_UP_JOINTS
            else self.floor_m + ORBIT_CENTRE_HEIGHT_M
        )
        camera = panel_camera.camera
        away_m = float(camera.axes()[2] @ np.subtract(camera.eye, (x, up_m, z)))
        return max(away_m, 0.0) * 2.0 * float(np.tan(camera.yfov_rad / 2.0)) / height_px

    def with_orbit(self, orbit: Orbit) -> "CameraSetup":
        """Return the stage with the main camera moved around the middle of the bodies."""
        if not orbit.is_moved:
            return self
        first, *others = self.panel_cameras
        x, z = (0.0, 0.0) if first.is_following else self.centre_xz
        middle = np.array([x, self.floor_m + ORBIT_CENTRE_HEIGHT_M, z])
        moved = replace(first, camera=orbit.apply(first.camera, middle))
        return replace(self, panel_cameras=(moved, *others))

    def followed_positions(self, body: Body, motion: BodyMotion) -> list[Float[np.ndarray, "T 3"]]:
        """Return the positions of each camera's tracked point per frame, metres."""
        positions = None
        tracks = []
        for panel_camera in self.panel_cameras:
            if panel_camera.followed_path_override is not None:
                tracks.append(panel_camera.followed_path_override)
            elif panel_camera.smoothing_sigma_frames is None:
                tracks.append(np.zeros((motion.num_frames, 3)))
            else:
                positions = _joint_positions(body, motion) if positions is None else positions
                tracks.append(
                    _track(body, positions, panel_camera.view, panel_camera.smoothing_sigma_frames)
                )
        return tracks

    def with_camera_paths(
        self, followed_positions: Sequence[Float[np.ndarray, "T 3"]]
    ) -> "CameraSetup":
        """Return the stage with cameras that follow these positions, whatever is drawn."""
        panel_cameras = [
            replace(panel_camera, followed_path_override=path)
            for panel_camera, path in zip(self.panel_cameras, followed_positions, strict=True)
        ]
        return replace(self, panel_cameras=tuple(panel_cameras))


def make_camera_setup(
    body: Body,
    motions: Sequence[BodyMotion],
    view: str = "front",
    aspect: float = 1.0,
    close_ups: Sequence[Panel] = (),
    framing: Framing = "whole",
) -> CameraSetup:
    """Make the stage that shows all of these motions, each alone, with equal cameras.

    The joints of every frame are framed, each with the reach of the mesh around it: far cheaper
    than posing every vertex, and the picture's margin covers what skinning adds. Hand close-ups
    frame only as much of the arm as there is room for.

    Args:
        aspect: width of the picture by its height.
        close_ups: panels that show parts of the body next to the picture.
        framing: framing of a view that is not a close-up.
    """
    reach = _flesh_radius(body)
    if framing == "knees":
        knees = [JOINT_INDEX[f"{side}_knee"] for side in ("left", "right")]
        reach[knees] = np.minimum(reach[knees], KNEE_FLESH_M)
    joints = FOLLOWED_CLOSE_UP_JOINTS.get(view, _framed(framing))
    sigma = CLOSE_UP_SIGMA_FRAMES if view in FOLLOWED_CLOSE_UP_JOINTS else WALK_SIGMA_FRAMES
    setups = [(view, aspect, joints, reach[joints], sigma)]
    for panel in close_ups:
        joints, is_face = FOLLOWED_CLOSE_UP_JOINTS[panel.view], panel.view == "face"
        flesh = reach[joints] if is_face else np.minimum(reach[joints], FINGERTIP_M)
        sigma = CLOSE_UP_SIGMA_FRAMES if is_face else HAND_CAMERA_SIGMA_FRAMES
        setups.append((panel.view, panel.aspect, joints, flesh, sigma))
    places: list[list[np.ndarray]] = [[] for _ in setups]
    from_afar, pelvises, floors, corners = [], [], [], []
    for motion in motions:
        positions = _joint_positions(body, motion)
        from_afar.append(
            extreme_positions_per_joint(positions[:, setups[0][2]], view, aspect=aspect)
        )
        for place, (name, ratio, joints, _, sigma) in zip(places, setups, strict=True):
            relative = positions[:, joints] - _track(body, positions, name, sigma)[:, None]
            place.append(extreme_positions_per_joint(relative, name, aspect=ratio))
        pelvises += [positions[:, 0].min(axis=0), positions[:, 0].max(axis=0)]
        floors.append(_floor(body, positions))
        corners += [positions.min(axis=(0, 1)), positions.max(axis=(0, 1))]
    wandered_m = float(np.ptp(pelvises, axis=0).max())
    panel_cameras = []
    for place, (name, ratio, _, flesh, sigma) in zip(places, setups, strict=True):
        if (
            not panel_cameras
            and view not in FOLLOWED_CLOSE_UP_JOINTS
            and wandered_m <= MAX_STATIC_PELVIS_RANGE_M
        ):
            place, sigma = from_afar, None
        points = np.concatenate(place)
        radius = np.broadcast_to(flesh, points.shape[:2]).ravel()
        camera = fit_camera(points.reshape(-1, 3), name, aspect=ratio, radius_m=radius)
        panel_cameras.append(PanelCamera(name, camera, sigma))
    low, high = np.min(corners, axis=0), np.max(corners, axis=0)
    return CameraSetup(
        panel_cameras=tuple(panel_cameras),
        floor_m=float(np.median(floors)),
        centre_xz=(float(low[0] + high[0]) / 2.0, float(low[2] + high[2]) / 2.0),
        horizontal_span_m=float(max(high[0] - low[0], high[2] - low[2])),
    )


def _framed(framing: Framing) -> list[int]:
    """Return the joints that a view without close-up shows."""
    hidden = BELOW_KNEES if framing == "knees" else ()
    return [j for j, name in enumerate(JOINT_NAMES) if not any(part in name for part in hidden)]


def select_frames(motion: BodyMotion, frames: slice | Sequence[int]) -> BodyMotion:
    """Return some of the frames of a motion, as a motion."""
    chosen = frames if isinstance(frames, slice) else np.asarray(frames, dtype=np.intp)
    return replace(
        motion,
        poses=motion.poses[chosen],
        trans=motion.trans[chosen],
        expressions=motion.expressions[chosen],
    )


def _joint_positions(body: Body, motion: BodyMotion) -> Float32[np.ndarray, "T J 3"]:
    """Return all joint positions of a clip, computed in pieces to limit memory."""
    starts = range(0, motion.num_frames, _PIECE_FRAMES)
    pieces = [
        body.joint_positions(select_frames(motion, slice(start, start + _PIECE_FRAMES)))
        for start in starts
    ]
    return np.concatenate(pieces)


def _track(
    body: Body, positions: Float[np.ndarray, "T J 3"], view: str, sigma_frames: float
) -> Float[np.ndarray, "T 3"]:
    """Return the smoothed centre of a close-up's joints, or of the pelvis on the ground.

    It stays near that point; the height of the pelvis counts for a body that rises far.
    """
    if view in FOLLOWED_CLOSE_UP_JOINTS:
        middle, lead_m = positions[:, FOLLOWED_CLOSE_UP_JOINTS[view]].mean(axis=1), CLOSE_UP_LEAD_M
    else:
        middle, lead_m = positions[:, 0].copy(), MAX_LEAD_M
        if np.ptp(middle[:, 1]) > MAX_STATIC_PELVIS_RANGE_M:
            stands_m = _floor(body, positions) + body.rest_joints[0, 1] - body.template[:, 1].min()
            middle[:, 1] -= stands_m
        else:
            middle[:, 1] = 0.0
    smooth = ndimage.gaussian_filter1d(middle, sigma_frames, axis=0, mode="nearest")
    away_m = np.linalg.norm(smooth - middle, axis=1, keepdims=True)
    return middle + (smooth - middle) * np.minimum(1.0, lead_m / np.maximum(away_m, 1e-9))


def _flesh_radius(body: Body) -> Float[np.ndarray, " J"]:
    """Return the distance from each joint to the farthest vertex that mainly follows it."""
    owner = body.dominant_joints
    distance = np.linalg.norm(body.template - body.rest_joints[owner], axis=1)
    reach = np.zeros(len(body.rest_joints))
    np.maximum.at(reach, owner, distance)
    return reach


def _floor(body: Body, positions: Float[np.ndarray, "T J 3"]) -> float:
    """Return the height of the soles in the median frame, with the lower foot on the floor."""
    sole = body.rest_joints[FEET, 1] - body.template[:, 1].min()
    return float(np.median((positions[:, FEET, 1] - sole).min(axis=1)))
