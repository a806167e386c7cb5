"""What Figure 6 shows, checked once, so that drawing it needs no further question; what trembles.

A path of 30 cm hides a tremble of 2 mm; on a scale of its own one sees which motion has more.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.signal import butter, sosfiltfilt

from conventions.names import PostFilter
from renderer.figures.files import FigureError
from renderer.figures.style import MAX_SYSTEMS, PAGE_MM, SeriesStyle, styles_of

CUT_OFF_HZ = 5.0
ORDER = 4
MIN_FRAMES = 32
"""About a second; fewer frames cannot tell 5 Hz from what lies below it."""
WINDOW_FRAMES = 300
SNAPSHOT_EVERY = 50
MAX_SNAPSHOTS = 7
COORDINATES = ("x", "y", "z")
PANELS = ("a", "b", "c", "d")
"""Coordinates, snapshots, path in space, tremble."""
MOST_IN_ONE_PLOT = 2
"""Systems whose curves share a plot, as in the paper; each of more has a row of its own."""
ONE_SEED_CAVEAT = "One clip and one noise seed: an example, not a comparison of the systems."
FAINTEST = 0.12
"""Share of the full scale below which no mark is drawn: every joint of a moving body has some."""

_FILTER_SENTENCES: dict[PostFilter, str] = {
    "none": "Raw motion, no filter.",
    "savgol": "Filtered motion (Savitzky-Golay, 7 frames, order 2, on every curve alike).",
}


def off_the_slow_path(positions: Float[np.ndarray, "T 3"], fps: float) -> Float[np.ndarray, "T 3"]:
    """Positions less those below 5 Hz (Butterworth of order 4, forwards and backwards), in
    millimetres for metres."""
    low = butter(ORDER, CUT_OFF_HZ, fs=fps, output="sos")
    exact = np.asarray(positions, np.float64)
    return 1000.0 * (exact - sosfiltfilt(low, exact, axis=0))


@dataclass(frozen=True)
class JointMarks:
    """Where each joint is in each snapshot, and a value for it."""

    pixels: Mapping[str, np.ndarray]
    """By name, (N, J, 2) from the upper left corner; NaN draws nothing."""
    values: Mapping[str, np.ndarray]
    """By name, (N, J) in ``unit``; NaN draws nothing."""
    full_scale: float
    """Value of the strongest mark; larger ones look the same."""
    quantity: str = "jerk"
    unit: str = "m/s³"

    def of(self, names: Iterable[str]) -> "JointMarks":
        """The marks of some of the names."""
        names = list(names)
        return replace(
            self,
            pixels={name: self.pixels[name] for name in names},
            values={name: self.values[name] for name in names},
        )

    @property
    def caption(self) -> str:
        return (
            f"Marks: {self.quantity} of each joint around the frame, largest and darkest at"
            f" {self.full_scale:g} {self.unit} and above, none below"
            f" {FAINTEST * self.full_scale:g} {self.unit}."
        )


@dataclass(frozen=True)
class Figure6:
    """Contents of one Figure 6, as :func:`check_figure6` returns them."""

    trajectories: dict[str, np.ndarray]
    """Name to positions (T, 3) in metres inside the window; the reference comes first."""
    tremble: dict[str, np.ndarray]
    """Name to millimetres (T, 3) off its slow path; empty where the window is too short."""
    snapshots: dict[str, np.ndarray]
    """Name to pictures (N, H, W, 3) uint8, in the order of the trajectories; may be empty."""
    snapshot_frames: tuple[int, ...]
    marks: JointMarks | None
    """Of the snapshots; None without."""
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
    panels: tuple[str, ...]
    """Of `PANELS`, those asked for of which there is something to show."""
    width_mm: float

    @property
    def num_frames(self) -> int:
        return len(next(iter(self.trajectories.values())))

    @property
    def times(self) -> np.ndarray:
        """Seconds of the window's frames."""
        return (self.start_frame + np.arange(self.num_frames)) / self.fps

    @property
    def styles(self) -> dict[str, SeriesStyle]:
        return styles_of(self.trajectories, self.reference)

    @property
    def is_in_one_plot(self) -> bool:
        """Whether curves share plots; otherwise each motion has small ones of its own."""
        return len(self.trajectories) - (self.reference is not None) <= MOST_IN_ONE_PLOT

    @property
    def shown_frames(self) -> tuple[int, ...]:
        """Frames of the snapshots inside the window, counted from its start."""
        if "b" not in self.panels:
            return ()
        inside = (frame - self.start_frame for frame in self.snapshot_frames)
        return tuple(frame for frame in inside if 0 <= frame < self.num_frames)

    @property
    def marker_frames(self) -> list[int]:
        """Frames of the curves' markers: those of the snapshots, or six where there are none."""
        evenly = np.linspace(0, self.num_frames, 6, endpoint=False).astype(int)
        return list(self.shown_frames) or sorted({int(frame) for frame in evenly})

    @property
    def caption(self) -> str:
        last_frame = self.start_frame + self.num_frames - 1
        clip = f" of {self.clip}" if self.clip else ""
        sentences = [
            f"{self.point}, frames {self.start_frame} to {last_frame}{clip}"
            f" at {self.fps:g} frames per second; metres, y up, one scale for x, y and z."
        ]
        if not self.is_in_one_plot:
            behind = next(iter(self.trajectories))
            sentences.append(f"A row for each motion; faint behind it: {behind}.")
        if self.is_cut:
            sentences.append("The motions differ in length and are cut to the shortest.")
        if self.shown_frames:
            sentences.append("Grey lines and markers: the frames of the snapshots.")
        if self.marks is not None:
            sentences.append(self.marks.caption)
        if "d" in self.panels:
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
    marks: JointMarks | None = None,
    reference: str | None = None,
    start_frame: int = 0,
    window_frames: int = WINDOW_FRAMES,
    point: str = "Right middle fingertip",
    tip_source: str = "",
    post_filter: PostFilter = "none",
    clip: str = "",
    caveat: str = ONE_SEED_CAVEAT,
    panels: Sequence[str] = PANELS,
    width_mm: float = PAGE_MM,
) -> Figure6:
    """Cut the trajectories to the window, put the reference first, refuse what cannot be drawn.

    Args:
        trajectories: name to positions (T, 3) of the point in metres, y up, from the clip's first
            frame. One to six systems, and the reference. Motions of different length are cut to
            the shortest, and the caption says so.
        snapshots: name to pictures (N, H, W, 3) uint8 of one camera, for the same names; empty
            for a figure without pictures.
        snapshot_frames: the N frames of the clip at which the snapshots were taken, at most 7;
            see :func:`choose_snapshot_frames`.
        marks: where the joints are in the snapshots (:func:`renderer.video.render.projected_joints`
            ), around which they are cut, and the values there.
        reference: which of the names is recorded motion; drawn first and in black.
        tip_source: where the point sits on the body, such as ``rigid`` or ``vertex 7794``.
        post_filter: the filter that all trajectories have been through; only named here.
        panels: of `PANELS`; those of which there is nothing to show are left out.

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
    whole = {name: np.asarray(trajectories[name]) for name in names}
    for name, positions in whole.items():
        if positions.ndim != 2 or positions.shape[1] != 3:
            raise FigureError(
                f"The trajectory of {name!r} must have shape (frames, 3); got {positions.shape}."
            )
        if len(positions) <= start_frame:
            raise FigureError(
                f"The window starts at frame {start_frame}, but {name!r} has only"
                f" {len(positions)} frames; choose an earlier start."
            )
        window = positions[start_frame : start_frame + window_frames]
        if not np.isfinite(window).all():
            bad = int(np.flatnonzero(~np.isfinite(window).all(axis=1))[0])
            raise FigureError(
                f"The trajectory of {name!r} is not a number at frame {start_frame + bad}."
            )
    lengths = [min(len(each) - start_frame, window_frames) for each in whole.values()]
    inside = slice(start_frame, start_frame + min(lengths))
    can_tremble = min(lengths) >= MIN_FRAMES and fps > 2.0 * CUT_OFF_HZ
    if snapshots:
        _check_snapshots(snapshots, snapshot_frames, names, marks)
    empty = {letter for letter, has in (("b", snapshots), ("d", can_tremble)) if not has}
    shown = tuple(letter for letter in PANELS if letter in panels and letter not in empty)
    if not shown:
        raise FigureError(
            f"Of the panels {', '.join(panels)} none has anything to show: snapshots (b) need"
            f" pictures, and tremble (d) needs {MIN_FRAMES} frames."
        )
    return Figure6(
        trajectories={name: positions[inside] for name, positions in whole.items()},
        tremble={name: off_the_slow_path(whole[name], fps)[inside] for name in names}
        if can_tremble
        else {},
        snapshots={name: np.asarray(snapshots[name]) for name in names} if snapshots else {},
        snapshot_frames=tuple(int(frame) for frame in snapshot_frames),
        marks=marks if "b" in shown else None,
        fps=float(fps),
        start_frame=start_frame,
        reference=reference,
        point=point,
        tip_source=tip_source,
        post_filter=post_filter,
        clip=clip,
        caveat=caveat,
        is_cut=max(lengths) > min(lengths),
        panels=shown,
        width_mm=width_mm,
    )


def _check_snapshots(
    snapshots: Mapping[str, np.ndarray],
    snapshot_frames: Sequence[int],
    names: list[str],
    marks: JointMarks | None,
) -> None:
    if marks is None or not (
        set(snapshots) == set(names) == set(marks.pixels) == set(marks.values)
    ):
        raise FigureError(
            f"Snapshots, their marks and trajectories must be of the same systems; got snapshots"
            f" of {_listed(snapshots)}, marks of {_listed(marks.values if marks else ())} and"
            f" trajectories of {_listed(names)}."
        )
    if not marks.full_scale > 0 or not np.isfinite(marks.full_scale):
        raise FigureError(f"The full scale of marks must be positive; got {marks.full_scale}.")
    if not 1 <= len(snapshot_frames) <= MAX_SNAPSHOTS:
        raise FigureError(
            f"A row holds 1 to {MAX_SNAPSHOTS} snapshots; got {len(snapshot_frames)}."
        )
    size = np.shape(snapshots[names[0]])[1:]
    for name in names:
        pictures = np.asarray(snapshots[name])
        if pictures.dtype != np.uint8 or pictures.ndim != 4 or pictures.shape[3] != 3:
            raise FigureError(
                f"Snapshots of {name!r} must be uint8 of shape (N, height, width, 3); got"
                f" {pictures.dtype} of shape {pictures.shape}."
            )
        if len(pictures) != len(snapshot_frames):
            raise FigureError(
                f"{name!r} has {len(pictures)} snapshots for {len(snapshot_frames)} frames."
            )
        if pictures.shape[1:] != size or not pictures.size:
            raise FigureError(
                f"Snapshots must all have one size; {name!r} has {pictures.shape[1:3]},"
                f" {names[0]!r} has {size[:2]}."
            )
        pixels, values = np.shape(marks.pixels[name]), np.shape(marks.values[name])
        if len(values) != 2 or values[0] != len(pictures) or pixels != (*values, 2):
            raise FigureError(
                f"Marks of {name!r} must have pixels (N, J, 2) and values (N, J) for its"
                f" {len(pictures)} snapshots; got {pixels} and {values}."
            )


def _listed(names: Iterable[str]) -> str:
    return ", ".join(repr(name) for name in names) or "none"
