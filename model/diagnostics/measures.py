"""Measures one motion: every number of `model.measures.results.Measures`."""

from typing import Any

import numpy as np
from jaxtyping import Float

from model.measures.diversity import diversity
from model.measures.joint_range import range_measures
from model.measures.joints import fingertip_measures, position_measures, rotation_measures
from model.measures.point import point_measures
from model.measures.posture import posture_measures
from model.measures.results import Measures
from model.measures.seams.periods import Period, find_period
from model.measures.seams.seams import Windows, seam_measures
from model.motion.motion import Motion
from model.motion.skeleton import RestSkeleton
from model.motion.tracks import Tracks, moving_chain, track_points

OWN_WINDOWS = Windows(advance=52, overlap=8)
"""Of GlobalDiff's systems: 60 frames, of which two windows share 8."""
TIP = "right_middle"
"""The fingertip of the paper's Figure 6."""


def measure_motion(
    motion: Motion,
    skeleton: RestSkeleton,
    tip: str = TIP,
    windows: Windows | None = OWN_WINDOWS,
) -> Measures:
    """The numbers of one motion as it is.

    Args:
        tip: the fingertip or joint that the ``tip_`` measures follow.
        windows: how it was cut, if that is known.
    """
    tracks = track_points(motion, skeleton)
    period = find_period(tracks)
    return measure_tracks(tracks, tracks.point(tip), tip, skeleton, windows, period)


def measures(motion: Motion, skeleton: RestSkeleton, tip: str = TIP) -> dict[str, Any]:
    """What `measure_motion` finds, by the keys of ``diagnostics.json``."""
    return measure_motion(motion, skeleton, tip).as_json()


def measure_tracks(
    tracks: Tracks,
    point: Float[np.ndarray, "T 3"],
    name: str,
    skeleton: RestSkeleton,
    windows: Windows | None,
    period: Period | None,
) -> Measures:
    """What `measure_motion` returns, where forward kinematics has been done.

    Args:
        point: positions of the followed point in metres, which is called ``name``.
        period: what `find_period` finds in the motion as it is, before any filter.
    """
    return Measures(
        point_measures(point, tracks, moving_chain(name)),
        fingertip_measures(tracks),
        position_measures(tracks),
        rotation_measures(tracks),
        seam_measures(tracks, windows, period),
        posture_measures(tracks),
        range_measures(tracks, skeleton),
        diversity(tracks.joints),
    )
