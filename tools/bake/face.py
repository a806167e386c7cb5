"""The head: skin, hair, brows and lips painted on it, and the eyeballs."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.interpolate import PchipInterpolator
from scipy.spatial import KDTree

from conventions.joints import JOINT_INDEX, NUM_JOINTS
from renderer.body.look import REGION_INDEX
from tools.bake import geometry
from tools.bake.geometry import Mesh
from tools.bake.mouth import mouth_and_lips

Points = Float[np.ndarray, "N 3"]
Heights = Float[np.ndarray, " N"]

# Hairline: height above the eyes for each distance behind the eyes, front to nape; metres.
HAIRLINE = (
    (-0.06, 0.068),
    (0.0, 0.061),
    (0.025, 0.048),
    (0.045, 0.030),
    (0.060, 0.018),
    (0.080, 0.014),
    (0.100, 0.008),
    (0.114, -0.012),
    (0.126, -0.040),
    (0.145, -0.060),
    (0.20, -0.068),
)
HAIR_THICKNESS_M = 0.011
HAIR_EDGE_M = 0.0025
"""Thickness at the hairline, enough to cover the skin, which is the coarser mesh."""
HAIR_RAMP_M = 0.03
HAIR_HEM_M = 0.006
SCALP_MARGIN_M = 0.035
"""The hair is cut out of the scalp and so much more around it."""
SKIN_UNDER_HAIR_M = 0.015

# Brow: height above the eyes and half thickness for each distance from the middle; metres.
BROW = (
    (0.010, 0.0215, 0.0018),
    (0.022, 0.0245, 0.0028),
    (0.036, 0.0275, 0.0022),
    (0.050, 0.0225, 0.0008),
)

# Rings of an eyeball, degrees from the gaze axis, and where its colours end.
EYE_RINGS_DEG = (0, 5, 9, 11, 12, 14, 18, 22, 26, 28, 29.5, 32, 36, 42, 50, 60, 72, 90, 120, 180)
EYE_SECTORS = 24
PUPIL_END_DEG, IRIS_END_DEG, IRIS_RIM_END_DEG = 11.5, 27.0, 29.0
CORNEA_BULGE = 0.035


class FacePaint:
    """Curves on the head for hair and brows, placed by the eye joints (metres, zero pose)."""

    def __init__(self, joints: Float[np.ndarray, "J 3"]) -> None:
        self.eyes = joints[[JOINT_INDEX["left_eye"], JOINT_INDEX["right_eye"]]].mean(0)
        self._hairline = PchipInterpolator(*np.array(HAIRLINE).T)
        distance, height, half = np.array(BROW).T
        self._brow_height = PchipInterpolator(distance, height)
        self._brow_half = PchipInterpolator(distance, half)

    def above_hairline(self, points: Points) -> Heights:
        behind = np.clip(self.eyes[2] - points[:, 2], HAIRLINE[0][0], HAIRLINE[-1][0])
        return points[:, 1] - self.eyes[1] - self._hairline(behind)

    def in_front(self, points: Points) -> Bool[np.ndarray, " N"]:
        """Around the brows."""
        x, y, z = (points - self.eyes).T
        return (np.abs(x) < 0.06) & (y > 0.005) & (y < 0.045) & (z > -0.02)

    def brow_fields(self) -> tuple[geometry.Field, ...]:
        """Fields that are all positive on the brows only."""
        start, end = BROW[0][0], BROW[-1][0]

        def sideways(points: Points) -> Heights:
            return np.clip(np.abs(points[:, 0]), start, end)

        def height(points: Points) -> Heights:
            return points[:, 1] - self.eyes[1] - self._brow_height(sideways(points))

        return (
            lambda points: self._brow_half(sideways(points)) - height(points),
            lambda points: self._brow_half(sideways(points)) + height(points),
            lambda points: np.abs(points[:, 0]) - start,
            lambda points: end - np.abs(points[:, 0]),
        )


def make_head(skin: Mesh, quads: Int[np.ndarray, "Q 4"], paint: FacePaint) -> Mesh:
    """Mouth, lips, brows and hair on the bare head.

    Args:
        skin: the head in quads.
        quads: the same quads in the vertex numbers of the base mesh.
        paint: where the curves run.
    """
    inside, lips = mouth_and_lips(quads)
    regions = np.full(len(quads), REGION_INDEX["skin"])
    regions[inside], regions[lips] = REGION_INDEX["mouth"], REGION_INDEX["lips"]
    head = geometry.paint(skin.triangles(), np.tile(regions, 2))

    for field in paint.brow_fields():
        head = geometry.cut(head, field, within=paint.in_front)
    regions = head.regions[head.faces[:, 0]].copy()
    middle = geometry.centres(head)
    brows = np.all([field(middle) > 0 for field in paint.brow_fields()], axis=0)
    is_skin = regions == REGION_INDEX["skin"]
    regions[is_skin & brows & paint.in_front(middle)] = REGION_INDEX["brows"]
    bare = paint.above_hairline(middle) < SKIN_UNDER_HAIR_M
    painted = geometry.paint(head.faces_only(bare), regions[bare])
    return geometry.join([painted, _hair(skin, paint)])


def _hair(skin: Mesh, paint: FacePaint) -> Mesh:
    """A cap on the scalp, finer than the skin so that its outline is round."""
    on_scalp = paint.above_hairline(skin.positions) > -SCALP_MARGIN_M
    scalp = geometry.subdivide(skin.faces_only(np.asarray(on_scalp[skin.faces].all(axis=1))))
    hair = geometry.cut(scalp, paint.above_hairline)
    hair = hair.faces_only(paint.above_hairline(geometry.centres(hair)) > 0)
    hairline = np.unique(geometry.border_edges(hair.faces))
    distance, _ = KDTree(hair.positions[hairline]).query(hair.positions)
    share = np.clip(distance / HAIR_RAMP_M, 0, 1)
    thickness = HAIR_EDGE_M + (HAIR_THICKNESS_M - HAIR_EDGE_M) * share * (2 - share)
    hair = hair.moved(hair.positions + thickness[:, None] * geometry.normals(hair))
    on_border = np.isin(np.arange(hair.num_vertices), hairline)
    hair = geometry.fold_border(hair, on_border, -HAIR_HEM_M * geometry.normals(hair))
    return hair.painted(REGION_INDEX["hair"])


def eyeball(side: str, old: Mesh, num_expressions: int) -> Mesh:
    """A round eye in place of the old one, gaze along +z, iris and pupil as rings."""
    centre, radius = _sphere(old.positions)
    polar = np.radians(EYE_RINGS_DEG)
    around = np.arange(EYE_SECTORS) * 2 * np.pi / EYE_SECTORS
    polar, around = (grid.ravel() for grid in np.meshgrid(polar, around, indexing="ij"))
    bulge = radius * (1 + CORNEA_BULGE * np.exp(-((polar / np.radians(24)) ** 4)))
    directions = np.stack(
        [np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], axis=1
    )
    carried = np.zeros((len(polar), old.carried.shape[1]))
    carried[:, :3] = centre + bulge[:, None] * directions
    carried[:, 3 + JOINT_INDEX[f"{side}_eye"]] = 1
    # No expression moves an eyeball, but each build has its own size of it.
    builds = old.offsets[:, num_expressions:].transpose(1, 0, 2)
    offsets = np.zeros((len(polar), old.offsets.shape[1], 3))
    for index, offset in enumerate(builds, start=num_expressions):
        new_centre, new_radius = _sphere(old.positions + offset)
        grown = (new_radius / radius - 1) * bulge[:, None] * directions
        offsets[:, index] = new_centre - centre + grown
    carried[:, 3 + NUM_JOINTS :] = offsets.reshape(len(polar), -1)
    degrees = np.degrees(polar)
    ends = (PUPIL_END_DEG, IRIS_END_DEG, IRIS_RIM_END_DEG)
    names = ("pupil", "iris", "iris_rim", "eye_white")
    regions = np.array([REGION_INDEX[name] for name in names])[np.searchsorted(ends, degrees)]
    grid = np.arange(len(polar)).reshape(len(EYE_RINGS_DEG), EYE_SECTORS)
    a, b = grid[:-1], grid[1:]
    quads = np.stack([a, b, np.roll(b, -1, 1), np.roll(a, -1, 1)], axis=-1).reshape(-1, 4)
    triangles = Mesh(quads, carried, regions).triangles()
    # The poles are rings of equal points: their faces without area go.
    a, b, c = (triangles.positions[triangles.faces[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return triangles.faces_only(area > 1e-12)


def _sphere(points: Points) -> tuple[Float[np.ndarray, " 3"], float]:
    """Centre and radius of the sphere that fits the back of an eye."""
    back = points[points[:, 2] < np.percentile(points[:, 2], 75)]
    system = np.c_[2 * back, np.ones(len(back))]
    solution = np.linalg.lstsq(system, (back**2).sum(1), rcond=None)[0]
    centre = solution[:3]
    return centre, float(np.sqrt(solution[3] + centre @ centre))
