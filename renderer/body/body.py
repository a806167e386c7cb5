"""Body model: a mesh that is posed by a motion.

``load_body()`` loads the open body of this project, ``load_body(path)`` a licensed SMPL-X file or a
character; all are posed by the same code. Vertices come as a stream of chunks, so memory does not
grow with the length of the motion.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float32, Float64, Integer
from scipy.spatial.transform import Rotation

from conventions.joints import JOINT_INDEX, NUM_JOINTS
from conventions.views import BODY_LOOKS
from renderer.body import skinning
from renderer.body.body_file import OPEN_BODY_PATH, BodyArrays, BodyError, read_body_npz
from renderer.body.character import SUFFIXES, read_character
from renderer.body.look import CLAY, vertex_colors

NUM_EXPRESSIONS = 100
MAX_DISTANCE_M = 100.0
MAX_BETA = 10.0
JAW_OPEN_RAD = 0.4
"""Rotation of the jaw (rad) that opens a mouth as ARKit's jawOpen does at 1."""
CHUNK_FRAMES = 16
"""Frames skinned at once: enough for matrix products, few enough for the cache."""


@dataclass(frozen=True)
class BodyMotion:
    """Motion in the form that a body needs: T frames at 30 fps, as float32.

    The caller has checked that the arrays match and are finite.

    Raises:
        BodyError: if the body is more than 100 m away, or its shape is not human.
    """

    poses: np.ndarray
    """Local axis-angle (T, 165) of the 55 SMPL-X joints, radians, flat-hand mean."""
    trans: np.ndarray
    """Translation (T, 3), added to the rest position of the pelvis, metres."""
    expressions: np.ndarray
    """Expression coefficients (T, 100)."""
    expression_basis: str
    """Basis of the expression coefficients: ``flame100`` or ``arkit52``."""
    betas: np.ndarray
    """Body shape (B,), B at most 300."""

    def __post_init__(self) -> None:
        for field in ("poses", "trans", "expressions", "betas"):
            object.__setattr__(self, field, np.asarray(getattr(self, field), np.float32))
        distance = float(np.abs(self.trans).max(initial=0.0))
        if distance > MAX_DISTANCE_M:
            raise BodyError(
                f"'trans' moves the body {distance:.0f} m from the origin; at most "
                f"{MAX_DISTANCE_M:.0f} m can be shown. Check that 'trans' is in metres."
            )
        if np.abs(self.betas).max(initial=0.0) > MAX_BETA:
            raise BodyError(
                f"The largest absolute value of 'betas' is {np.abs(self.betas).max():.0f}; at "
                f"most {MAX_BETA:.0f} is possible for a human body."
            )

    @property
    def num_frames(self) -> int:
        return len(self.poses)

    @staticmethod
    def zero_pose(num_frames: int = 1, expression_basis: str = "arkit52") -> BodyMotion:
        """Return a motion that stays in the zero pose at the origin."""
        return BodyMotion(
            poses=np.zeros((num_frames, 3 * NUM_JOINTS), np.float32),
            trans=np.zeros((num_frames, 3), np.float32),
            expressions=np.zeros((num_frames, NUM_EXPRESSIONS), np.float32),
            expression_basis=expression_basis,
            betas=np.zeros(300, np.float32),
        )


@dataclass(frozen=True, eq=False)
class Body(BodyArrays):
    """Body model: mesh, joints, skinning and blendshapes. Read-only and stateless."""

    body_look: str = BODY_LOOKS[0]
    """Look of `BODY_LOOKS`: its build is in the arrays already, its tone sets the colours."""

    @property
    def body_look_if_painted(self) -> str | None:
        """Name of the look among `BODY_LOOKS`, or None if the body file has no painted regions."""
        return None if self.regions is None else self.body_look

    @property
    def num_vertices(self) -> int:
        return len(self.template)

    @property
    def height_m(self) -> float:
        """Height in the zero pose (m)."""
        return float(np.ptp(self.template[:, 1]))

    @cached_property
    def vertex_colors(self) -> Float32[np.ndarray, "V 3"]:
        """Linear RGB in 0 to 1: of painted regions, or factors of the texture; else clay."""
        if self.texture is not None:
            return self.texture.colors
        if self.regions is None:
            return np.tile(np.array(CLAY, np.float32), (self.num_vertices, 1))
        return vertex_colors(self.body_look, self.regions)

    def submesh(
        self, vertices: Integer[np.ndarray, " N"], faces: Integer[np.ndarray, "F 3"]
    ) -> Body:
        """Return a body of some vertices, with ``faces`` among them, that moves as the whole.

        Its joints are those of the whole body.
        """
        place = np.full(self.num_vertices, -1, np.int32)
        place[vertices] = np.arange(len(vertices), dtype=np.int32)
        moved, corrected = (place[each] for each in (self.expression_vertices, self.pose_vertices))
        rows = (3 * np.flatnonzero(corrected >= 0)[:, None] + np.arange(3)).ravel()
        return replace(
            self,
            template=self.template[vertices],
            faces=faces.astype(np.int32),
            weights=self.weights[vertices],
            shape_dirs=self.shape_dirs[vertices],
            expression_vertices=moved[moved >= 0],
            expression_dirs=self.expression_dirs[:, moved >= 0],
            pose_vertices=corrected[corrected >= 0],
            pose_dirs=self.pose_dirs[rows],
            regions=None if self.regions is None else self.regions[vertices],
            texture=self.texture and self.texture.for_vertices(vertices),
        )

    def unsupported_notes(self, motion: BodyMotion) -> tuple[str, ...]:
        """Return one sentence for each part of ``motion`` that this body does not show."""
        notes, num_betas = [], self.shape_dirs.shape[2]
        if motion.expression_basis != self.expression_basis and motion.expressions.any():
            notes.append(
                f"Facial expressions are left out: the motion has {motion.expression_basis} "
                f"coefficients, and the body ({self.name}) needs {self.expression_basis}; the jaw "
                "and eyes still move."
            )
        if motion.betas[num_betas:].any():
            notes.append(
                f"The body ({self.name}) has {num_betas} betas; the motion's further betas are "
                "left out."
                if num_betas
                else f"The motion's betas are left out: the body ({self.name}) has only one shape."
            )
        return tuple(notes)

    def posed_vertices(
        self, motion: BodyMotion, chunk_frames: int = CHUNK_FRAMES
    ) -> Iterator[Float32[np.ndarray, "T V 3"]]:
        """Yield posed vertices in metres, ``chunk_frames`` frames at a time, then the rest."""
        shaped = self.shaped_vertices_and_joints(motion)
        for start in range(0, motion.num_frames, chunk_frames):
            frames = slice(start, min(start + chunk_frames, motion.num_frames))
            yield self._pose(motion, frames, *shaped)

    def joint_positions(self, motion: BodyMotion) -> Float32[np.ndarray, "T J 3"]:
        """Return the position of each joint, metres."""
        _, positions = self.global_transforms_without_trans(motion)
        return (positions + motion.trans[:, None]).astype(np.float32)

    def global_transforms_without_trans(
        self, motion: BodyMotion
    ) -> tuple[Float64[np.ndarray, "T J 3 3"], Float64[np.ndarray, "T J 3"]]:
        """Return global rotations and positions of the joints, without the motion's translation."""
        _, shaped_joints = self.shaped_vertices_and_joints(motion)
        R_parent_joint, joints = self._joints(motion, slice(0, motion.num_frames), shaped_joints)
        return skinning.global_transforms(R_parent_joint, joints)

    def shaped_vertices_and_joints(
        self, motion: BodyMotion
    ) -> tuple[Float32[np.ndarray, "V 3"], Float64[np.ndarray, "J 3"]]:
        """Return vertices and joints of the zero pose with the betas of ``motion``, metres."""
        count = min(self.shape_dirs.shape[2], len(motion.betas))
        betas = motion.betas[:count]
        vertices = self.template + self.shape_dirs[:, :, :count] @ betas
        joints = self.rest_joints + self.shape_joint_dirs[:, :, :count] @ betas
        return vertices, joints.astype(np.float64)

    def expression_weights(self, motion: BodyMotion, frames: slice) -> Float32[np.ndarray, "T E"]:
        """Return component weights in some frames: 0 in another basis, but for `jaw_component`."""
        num_components = len(self.expression_dirs)
        weights = np.zeros((frames.stop - frames.start, num_components), np.float32)
        if motion.expression_basis == self.expression_basis:
            weights[:] = motion.expressions[frames, :num_components]
        if self.jaw_component is not None:
            opened = motion.poses[frames, 3 * JOINT_INDEX["jaw"]] / JAW_OPEN_RAD
            weights[:, self.jaw_component] += np.clip(opened, 0, 1)
        return weights

    def _joints(
        self, motion: BodyMotion, frames: slice, shaped_joints: Float64[np.ndarray, "J 3"]
    ) -> tuple[Float64[np.ndarray, "T J 3 3"], Float64[np.ndarray, "T J 3"]]:
        """Return local rotations, and rest joints with the expression of each frame."""
        turns = motion.poses[frames].astype(np.float64).reshape(-1, 3)
        R_parent_joint = Rotation.from_rotvec(turns).as_matrix().reshape(-1, NUM_JOINTS, 3, 3)
        expressions = self.expression_weights(motion, frames)
        shift = np.tensordot(expressions, self.expression_joint_dirs, 1)
        return R_parent_joint, shaped_joints + shift

    def _pose(
        self,
        motion: BodyMotion,
        frames: slice,
        shaped_vertices: Float32[np.ndarray, "V 3"],
        shaped_joints: Float64[np.ndarray, "J 3"],
    ) -> Float32[np.ndarray, "T V 3"]:
        R_parent_joint, joints = self._joints(motion, frames, shaped_joints)
        rest_vertices = np.repeat(shaped_vertices[None], len(R_parent_joint), axis=0)
        expressions = self.expression_weights(motion, frames)
        if expressions.any():
            rest_vertices[:, self.expression_vertices] += np.tensordot(
                expressions, self.expression_dirs, 1
            )
        skinning.add_pose_correctives(
            rest_vertices, self.pose_vertices, self.pose_dirs, R_parent_joint
        )
        R_world_joint, positions = skinning.global_transforms(R_parent_joint, joints)
        translations = positions - (R_world_joint @ joints[..., None])[..., 0]
        translations += motion.trans[frames, None]
        return skinning.skin(rest_vertices, self.weights, R_world_joint, translations)


def load_body(path: Path | None = None, look: str = BODY_LOOKS[0]) -> Body:
    """Load the open body in one of `BODY_LOOKS`, or the file at ``path``.

    The file is an SMPL-X body (``.npz``) or a character (``.vrm``, ``.glb``). Raises BodyError with
    one sentence if the file is not a body that can be posed, or the look is unknown or not
    available for the file.
    """
    if look not in BODY_LOOKS:
        raise BodyError(f"Unknown look '{look}'; choose one of {', '.join(BODY_LOOKS)}.")
    if path is None:
        arrays = read_body_npz(OPEN_BODY_PATH, look.partition("-")[0])
        return Body(**vars(arrays), body_look=look)
    if look != BODY_LOOKS[0]:
        raise BodyError(
            f"The look '{look}' is for the bundled open body, and {Path(path).name} has only one "
            "look; leave out either the look or the body file."
        )
    if Path(path).suffix.lower() in SUFFIXES:
        return Body(**vars(read_character(Path(path))))
    return Body(**vars(read_body_npz(Path(path))))
