"""A motion for the SMPL-X add-on of Blender: an npz for its "Add Animation" (Load animation).

What the add-on reads (``SMPLXAddAnimation`` of its ``__init__.py``, version 2022-06-23 and later):
``trans``, ``gender``, ``mocap_frame_rate``, ``betas`` and ``poses``, all of them needed, without
pickled objects. The other keys are those of AMASS for SMPL-X, for tools that want the pose in
parts. Choose in Blender: Format "SMPL-X" (y up; "AMASS" would lay the body down), hand pose
reference "Flat". The add-on leaves the face expression alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from conventions.rates import FPS
from renderer.body.body import BodyMotion
from renderer.files.written import written_whole

_FEWEST_BETAS = 10
"""Shape keys of the smallest model of the add-on, which complains about every further beta."""


def write_blender(motion: BodyMotion, out: Path, markers: Sequence[tuple[float, str]] = ()) -> None:
    """Write ``motion`` to ``out``; radians, metres, y up.

    Args:
        markers: moments in seconds with names: the arrays ``marker_frames``, counted from 0, and
            ``marker_names``, which the add-on leaves alone.

    Raises:
        OSError: if ``out`` cannot be written; nothing half-written stays behind.
    """
    num_betas = max(_FEWEST_BETAS, int(np.flatnonzero(motion.betas).max(initial=-1)) + 1)
    betas = np.zeros(num_betas, np.float32)
    betas[: len(motion.betas)] = motion.betas[:num_betas]
    told = {}
    if markers:
        frames = [round(seconds * FPS) for seconds, _ in markers]
        told["marker_frames"] = np.array(frames, np.int32)
        told["marker_names"] = np.array([name for _, name in markers])
    with written_whole(out) as file:
        np.savez(
            file,
            gender="neutral",
            surface_model_type="smplx",
            mocap_frame_rate=np.int32(FPS),
            mocap_time_length=np.float32(motion.num_frames / FPS),
            trans=motion.trans,
            poses=motion.poses,
            betas=betas,
            num_betas=np.int32(num_betas),
            root_orient=motion.poses[:, :3],
            pose_body=motion.poses[:, 3:66],
            pose_jaw=motion.poses[:, 66:69],
            pose_eye=motion.poses[:, 69:75],
            pose_hand=motion.poses[:, 75:],
            **told,
        )
