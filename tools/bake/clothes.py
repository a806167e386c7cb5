"""Shirt, trousers and shoes, made from MakeHuman's close-fitting garment helper mesh.

The helper covers the body from neck to wrists and toes. It is smoothed, so that it reads as cloth,
subdivided, cut into garments that overlap, and moved outward by the thickness of each.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from conventions.joints import JOINT_INDEX
from renderer.body.look import REGION_INDEX
from tools.bake import geometry
from tools.bake.geometry import Mesh

Points = Float[np.ndarray, "N 3"]
Heights = Float[np.ndarray, " N"]

SMOOTHING_ROUNDS = 2
SEAT_SMOOTHING_ROUNDS = 5
SEAT_HALF_HEIGHT_M = 0.085
WAIST_BELOW_PELVIS_M = 0.065
WAIST_OVERLAP_M = 0.03
TROUSER_END_ABOVE_ANKLE_M = 0.032
SHOE_TOP_ABOVE_ANKLE_M = 0.07
SOLE_HEIGHT_M = 0.020
SLEEVE_BEFORE_WRIST_M = 0.010
SHIRT_END_TAPER_M = 0.06
"""Length (m) over which the shirt narrows to the skin, at wrists and neck."""
HEM_DEPTH_M = 0.005
CUFF_DEPTH_M = 0.014
"""Depth (m) of a turned-in cuff, which meets the skin so that no gap opens when the wrist bends."""
WEIGHT_SMOOTHING_ROUNDS = 14


class GarmentCuts:
    """Ends of garments on a body, from its rest joints (metres, zero pose)."""

    def __init__(self, joints: Float[np.ndarray, "J 3"]) -> None:
        self.joints = joints
        self.neck = joints[JOINT_INDEX["neck"]] + [0.0, 0.012, 0.0]
        self.neck_axis = np.array([0.0, 1.0, 0.45]) / np.hypot(1.0, 0.45)
        self.waist_m = joints[JOINT_INDEX["pelvis"], 1] - WAIST_BELOW_PELVIS_M
        self.ankle_m = joints[JOINT_INDEX["left_ankle"], 1]
        self.wrist_m = joints[JOINT_INDEX["left_wrist"], 0]
        self.sleeve_end_m = self.wrist_m - SLEEVE_BEFORE_WRIST_M

    def above_neckline(self, points: Points) -> Heights:
        """Return the height above a crew neckline around the root of the neck (m)."""
        from_neck = points - self.neck
        height = from_neck @ self.neck_axis
        radius = np.linalg.norm(from_neck - height[:, None] * self.neck_axis, axis=1)
        above = height - 0.5 * np.maximum(radius - 0.06, 0) - 0.012
        return np.where(np.abs(points[:, 0]) > 0.2, -1.0, above)


def make_garments(helper: Mesh, wearer: GarmentCuts) -> Mesh:
    """Make the three garments from the helper mesh, as one triangle mesh painted by garment."""
    loose = helper.positions[:, 1] > wearer.ankle_m + 0.02
    smoothed = geometry.smooth(helper, SMOOTHING_ROUNDS, loose)
    seat = np.abs(smoothed.positions[:, 1] - wearer.waist_m) < SEAT_HALF_HEIGHT_M
    cloth = geometry.subdivide_catmull_clark(geometry.smooth(smoothed, SEAT_SMOOTHING_ROUNDS, seat))
    cloth = geometry.smooth_weights(cloth, WEIGHT_SMOOTHING_ROUNDS)
    return geometry.merge_meshes(
        [_shirt(cloth, wearer), _trousers(cloth, wearer), _shoes(cloth, wearer)]
    )


def _shirt(cloth: Mesh, wearer: GarmentCuts) -> Mesh:
    drop = np.clip((wearer.waist_m + 0.25 - cloth.positions[:, 1]) / 0.25, 0, 1)
    to_sleeve_end = wearer.sleeve_end_m - np.abs(cloth.positions[:, 0])
    to_end = np.minimum(to_sleeve_end, -wearer.above_neckline(cloth.positions))
    shirt = _thicken(cloth, (0.005 + 0.007 * drop) * np.clip(to_end / SHIRT_END_TAPER_M, 0, 1))
    end = wearer.waist_m - WAIST_OVERLAP_M
    shirt = _keep(shirt, lambda points: points[:, 1] - end)
    shirt = _keep(shirt, lambda points: -wearer.above_neckline(points))
    shirt = _keep(shirt, lambda points: wearer.sleeve_end_m - np.abs(points[:, 0]))
    return _hemmed(shirt, CUFF_DEPTH_M).painted(REGION_INDEX["shirt"])


def _trousers(cloth: Mesh, wearer: GarmentCuts) -> Mesh:
    end = wearer.ankle_m + TROUSER_END_ABOVE_ANKLE_M
    drop = np.clip((wearer.waist_m - cloth.positions[:, 1]) / (wearer.waist_m - end), 0, 1)
    # Straight legs: more room where the calf narrows towards the ankle.
    thickness = 0.004 + 0.007 * np.sqrt(drop) + 0.007 * np.clip(4 * drop - 3, 0, 1)
    trousers = _thicken(cloth, thickness)
    trousers = _keep(trousers, lambda points: wearer.waist_m - points[:, 1])
    trousers = _keep(trousers, lambda points: points[:, 1] - end)
    return _hemmed(trousers, HEM_DEPTH_M).painted(REGION_INDEX["trousers"])


def _shoes(cloth: Mesh, wearer: GarmentCuts) -> Mesh:
    top = wearer.ankle_m + SHOE_TOP_ABOVE_ANKLE_M
    shoes = _thicken(cloth, np.full(cloth.num_vertices, 0.004))
    shoes = _keep(shoes, lambda points: top - points[:, 1])
    ground = shoes.positions[:, 1].min()

    def above_sole(points: Points) -> Heights:
        return points[:, 1] - (ground + SOLE_HEIGHT_M)

    shoes = geometry.cut_along_field(_hemmed(shoes, HEM_DEPTH_M), above_sole)
    # The sole is flat below and stands a little wider than the upper.
    share = np.clip((shoes.positions[:, 1] - ground) / SOLE_HEIGHT_M, 0, 1)
    outward = geometry.normals(shoes) * [1, 0, 1]
    positions = shoes.positions + 0.003 * (share < 1)[:, None] * outward
    positions[:, 1] += SOLE_HEIGHT_M * (share**2 * (3 - 2 * share) - share)
    upper = above_sole(geometry.centres(shoes)) > 0
    regions = np.where(upper, REGION_INDEX["shoes"], REGION_INDEX["soles"])
    return geometry.paint(shoes.with_positions(positions), regions)


def _thicken(cloth: Mesh, thickness: Float[np.ndarray, " V"]) -> Mesh:
    return cloth.with_positions(cloth.positions + thickness[:, None] * geometry.normals(cloth))


def _keep(mesh: Mesh, field: geometry.Field) -> Mesh:
    mesh = geometry.cut_along_field(mesh, field)
    return mesh.faces_only(field(geometry.centres(mesh)) > 0)


def _hemmed(garment: Mesh, depth_m: float) -> Mesh:
    """Return the garment with its open ends turned in."""
    hem = np.zeros(garment.num_vertices, bool)
    hem[geometry.border_edges(garment.faces)] = True
    inward = 0.3 * geometry.towards_neighbours(garment) - depth_m * geometry.normals(garment)
    return geometry.fold_border(garment, hem, inward)
