"""What Figure 6 shows, checked once, so that drawing it needs no further question; what trembles.

A path of 30 cm hides a tremble of 2 mm; on a scale of its own one sees which motion has more.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.signal import butter, sosfiltfilt

from conventions.names import PostFilter
from renderer.figures.figure6.snapshots import JointMarks
from renderer.figures.files import FigureError
from renderer.figures.style import MAX_SYSTEMS, SeriesStyle, styles_of

CUT_OFF_HZ = 5.0
ORDER = 4
MIN_FRAMES = 32
"""About a second; fewer frames cannot tell 5 Hz from what lies below it."""


def has_tremble(num_frames: int, fps: float) -> bool:
    """Whether so short or slow a track can show any."""
    return num_frames >= MIN_FRAMES and fps > 2.0 * CUT_OFF_HZ


def off_the_slow_path(positions: Float[np.ndarray, "T 3"], fps: float) -> Float[np.ndarray, "T 3"]:
    """Positions less those below 5 Hz (Butterworth of order 4, forwards and backwards), in
    millimetres for metres."""
    low = butter(ORDER, CUT_OFF_HZ, fs=fps, output="sos")
    exact = np.asarray(positions, np.float64)
    return 1000.0 * (exact - sosfiltfilt(low, exact, axis=0))


WINDOW_FRAMES = 300
SNAPSHOT_EVERY = 50
MAX_SNAPSHOTS = 7
COORDINATES = ("x", "y", "z")
MIN_SPAN_M = 0.02
"""A point that stands still is drawn on an axis of two centimetres."""
ONE_SEED_CAVEAT = "One clip and one noise seed: an example, not a comparison of the systems."

_FILTER_SENTENCES: dict[PostFilter, str] = {
    "none": "Raw motion, no filter.",
    "savgol": "Filtered motion (Savitzky-Golay, 7 frames, order 2, on every curve alike).",
}


@dataclass(frozen=True)
class Figure6:
    """Contents of one Figure 6, as :func:`check_figure6` returns them."""

    trajectories: dict[str, np.ndarray]
    """Name to positions (T, 3) in metres inside the window; the reference comes first."""
    snapshots: dict[str, np.ndarray]
    """Name to pictures (N, H, W, 3) uint8, in the order of the trajectories; may be empty."""
    snapshot_frames: tuple[int, ...]
    fps: float
    start_frame: int
    reference: str | None
    point: str
    tip_source: str
    post_filter: PostFilter
    clip: str
    caveat: str
    is_cut: bool
    """Whether a motion had more frames inside the window than the shortest one."""
    tremble: dict[str, np.ndarray]
    """Name to millimetres (T, 3) off its slow path; empty where the window is too short."""
    marks: JointMarks | None = None
    """Values at the joints of the snapshots."""

    @property
    def num_frames(self) -> int:
        return len(next(iter(self.trajectories.values())))

    @property
    def styles(self) -> dict[str, SeriesStyle]:
        return styles_of(self.trajectories, self.reference)

    @property
    def snapshot_marks(self) -> tuple[int, ...]:
        """Frames of the snapshots inside the window, counted from its start."""
        if not self.snapshots:
            return ()
        inside = (frame - self.start_frame for frame in self.snapshot_frames)
        return tuple(frame for frame in inside if 0 <= frame < self.num_frames)

    @property
    def marker_frames(self) -> tuple[int, ...]:
        """Frames of the curves' markers: those of the snapshots, or six where there are none."""
        if self.snapshot_marks:
            return self.snapshot_marks
        evenly = np.linspace(0, self.num_frames, 6, endpoint=False)
        return tuple(sorted({int(frame) for frame in evenly}))

    @property
    def caption(self) -> str:
        last_frame = self.start_frame + self.num_frames - 1
        clip = f" of {self.clip}" if self.clip else ""
        sentences = [
            f"{self.point}, frames {self.start_frame} to {last_frame}{clip}"
            f" at {self.fps:g} frames per second; metres, y up, one scale for x, y and z."
        ]
        if self.is_cut:
            sentences.append("The motions differ in length and are cut to the shortest.")
        if self.snapshot_marks:
            sentences.append("Grey lines and markers: the frames of the snapshots.")
        if self.marks is not None:
            sentences.append(self.marks.caption)
        if self.tremble:
            sentences.append("Tremble: x, y and z less what lies below 5 Hz; one scale.")
        if self.tip_source:
            sentences.append(f"Tip source: {self.tip_source}.")
        sentences.append(_FILTER_SENTENCES[self.post_filter])
        return " ".join([*sentences, self.caveat]).strip()


def choose_snapshot_frames(
    num_frames: int,
    start_frame: int = 0,
    window_frames: int = WINDOW_FRAMES,
    every: int = SNAPSHOT_EVERY,
) -> tuple[int, ...]:
    """Frames to take snapshots at: from the start of the window, every 50 frames, at most 7."""
    end = min(num_frames, start_frame + window_frames)
    return tuple(range(start_frame, end, every))[:MAX_SNAPSHOTS]


def check_figure6(
    trajectories: Mapping[str, np.ndarray],
    snapshots: Mapping[str, np.ndarray],
    snapshot_frames: Sequence[int],
    fps: float,
    *,
    reference: str | None = None,
    start_frame: int = 0,
    window_frames: int = WINDOW_FRAMES,
    point: str = "Right middle fingertip",
    tip_source: str = "",
    post_filter: PostFilter = "none",
    clip: str = "",
    caveat: str = ONE_SEED_CAVEAT,
    marks: JointMarks | None = None,
) -> Figure6:
    """Cut the trajectories to the window, put the reference first, refuse what cannot be drawn.

    Args:
        trajectories: name to positions (T, 3) of the point in metres, y up, from the clip's first
            frame. One to six systems, and the reference. Motions of different length are cut to
            the shortest, and the caption says so.
        snapshots: name to pictures (N, H, W, 3) uint8 of one camera, for the same names; empty
            for a figure without pictures. Margins that are empty in all of them are cut off.
        snapshot_frames: the N frames of the clip at which the snapshots were taken, at most 7;
            see :func:`choose_snapshot_frames`.
        fps: frames per second of the trajectories.
        reference: which of the names is recorded motion; drawn first and in black.
        start_frame: first frame of the window.
        window_frames: longest window; a shorter clip gives a shorter one.
        point: what the trajectories are of, for the title.
        tip_source: where the point sits on the body, such as ``rigid`` or ``vertex 7794``.
        post_filter: the filter that all trajectories have been through; only named here.
        clip: name of the clip, for the caption.
        caveat: last sentence of the caption.
        marks: values at the joints of the snapshots, of the same names; see
            :func:`renderer.video.render.projected_joints` for where the joints are.

    Raises:
        FigureError: with one sentence that names the limit and what was found.
    """
    if reference is not None and reference not in trajectories:
        raise FigureError(
            f"The reference {reference!r} has no trajectory; there are {_listed(trajectories)}."
        )
    names = sorted(trajectories, key=lambda name: name != reference)  # stable: reference first
    num_systems = len(names) - (reference is not None)
    if not 1 <= num_systems <= MAX_SYSTEMS:
        raise FigureError(
            f"Figure 6 holds 1 to {MAX_SYSTEMS} systems beside the reference; got {num_systems}."
        )
    if not fps > 0 or not np.isfinite(fps):
        raise FigureError(f"The frame rate must be positive; got {fps}.")
    if start_frame < 0 or window_frames < 1:
        raise FigureError(
            f"The window starts at frame 0 or later and has at least 1 frame; got start frame"
            f" {start_frame} and {window_frames} frames."
        )

    windows, whole = {}, {}
    for name in names:
        positions = np.asarray(trajectories[name])
        if positions.ndim != 2 or positions.shape[1] != 3:
            raise FigureError(
                f"The trajectory of {name!r} must have shape (frames, 3); got {positions.shape}."
            )
        if len(positions) <= start_frame:
            raise FigureError(
                f"The window starts at frame {start_frame}, but {name!r} has only"
                f" {len(positions)} frames; choose an earlier start."
            )
        windows[name] = positions[start_frame : start_frame + window_frames]
        whole[name] = positions
        if not np.isfinite(windows[name]).all():
            bad = int(np.flatnonzero(~np.isfinite(windows[name]).all(axis=1))[0])
            raise FigureError(
                f"The trajectory of {name!r} is not a number at frame {start_frame + bad}."
            )
    num_frames = min(len(window) for window in windows.values())
    inside = slice(start_frame, start_frame + num_frames)
    tremble = (
        {name: off_the_slow_path(whole[name], fps)[inside] for name in names}
        if has_tremble(num_frames, fps)
        else {}
    )
    pictures = _check_snapshots(snapshots, snapshot_frames, names)

    return Figure6(
        trajectories={name: window[:num_frames] for name, window in windows.items()},
        snapshots=pictures,
        snapshot_frames=tuple(int(frame) for frame in snapshot_frames),
        fps=float(fps),
        start_frame=start_frame,
        reference=reference,
        point=point,
        tip_source=tip_source,
        post_filter=post_filter,
        clip=clip,
        caveat=caveat,
        tremble=tremble,
        is_cut=any(len(window) > num_frames for window in windows.values()),
        marks=None if marks is None else _check_marks(marks, pictures),
    )


def _check_snapshots(
    snapshots: Mapping[str, np.ndarray], snapshot_frames: Sequence[int], names: list[str]
) -> dict[str, np.ndarray]:
    if not snapshots:
        return {}
    if set(snapshots) != set(names):
        raise FigureError(
            f"Snapshots and trajectories must be of the same systems; got snapshots of"
            f" {_listed(snapshots)} and trajectories of {_listed(names)}."
        )
    if not 1 <= len(snapshot_frames) <= MAX_SNAPSHOTS:
        raise FigureError(
            f"A row holds 1 to {MAX_SNAPSHOTS} snapshots; got {len(snapshot_frames)}."
        )
    ordered = {name: np.asarray(snapshots[name]) for name in names}
    frame_shape = ordered[names[0]].shape[1:]
    for name, pictures in ordered.items():
        if pictures.dtype != np.uint8 or pictures.ndim != 4 or pictures.shape[3] != 3:
            raise FigureError(
                f"Snapshots of {name!r} must be uint8 of shape (N, height, width, 3); got"
                f" {pictures.dtype} of shape {pictures.shape}."
            )
        if len(pictures) != len(snapshot_frames):
            raise FigureError(
                f"{name!r} has {len(pictures)} snapshots for {len(snapshot_frames)} frames."
            )
        if pictures.shape[1:] != frame_shape or not pictures.size:
            raise FigureError(
                f"Snapshots must all have one size; {name!r} has {pictures.shape[1:3]},"
                f" {names[0]!r} has {frame_shape[:2]}."
            )
    return ordered


def _check_marks(marks: JointMarks, pictures: Mapping[str, np.ndarray]) -> JointMarks:
    if set(marks.pixels) != set(pictures) or set(marks.values) != set(pictures):
        raise FigureError(
            f"Marks and snapshots must be of the same systems; got marks of"
            f" {_listed(marks.pixels)} and snapshots of {_listed(pictures)}."
        )
    if not marks.full_scale > 0 or not np.isfinite(marks.full_scale):
        raise FigureError(f"The full scale of marks must be positive; got {marks.full_scale}.")
    for name, stack in pictures.items():
        pixels, values = np.shape(marks.pixels[name]), np.shape(marks.values[name])
        if len(values) != 2 or values[0] != len(stack) or pixels != (*values, 2):
            raise FigureError(
                f"Marks of {name!r} must have pixels (N, J, 2) and values (N, J) for its"
                f" {len(stack)} snapshots; got {pixels} and {values}."
            )
    return marks


def _listed(names: Iterable[str]) -> str:
    return ", ".join(repr(name) for name in names) or "none"
