"""Contents of Figure 6 for any motions: fingertip path, snapshots and tremor."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.signal import butter, sosfiltfilt

from conventions.names import PostFilter
from renderer.figures.errors import FigureError
from renderer.figures.style import MAX_SYSTEMS, PAGE_MM, SeriesStyle, series_styles

CUT_OFF_HZ, ORDER = 5.0, 4
MIN_TREMOR_FRAMES = 32
"""Shortest window (frames) for tremor: about a second, so that the 5 Hz filter can separate it."""
WINDOW_FRAMES = 300
SNAPSHOT_EVERY = 50
PANELS = ("a", "b", "c", "d")
"""Panels: coordinates (a), snapshots (b), path in space (c), tremor (d)."""
MAX_SYSTEMS_IN_ONE_PLOT = 2
"""Largest number of systems in one plot, as in the paper; with more, each has its own row."""
ONE_SEED_CAVEAT = (
    "The figure shows one clip and one noise seed: it is an example, not a comparison of the "
    "systems."
)
MIN_MARK_STRENGTH = 0.12
"""Share of the full scale below which no mark is drawn, as every joint of a moving body has some.
"""
TREMOR_PERCENTILE = 99.0
"""Percentile of the tremor of all motions at which the scale of panel d ends, so that one spike
does not flatten the rest."""
MIN_TREMOR_MM = 0.1
_FILTERED: dict[PostFilter, str] = {
    "none": "The motion is unfiltered.",
    "savgol": "All curves show filtered motion (Savitzky-Golay, 7 frames, order 2).",
}
_TIP_SOURCES = {
    "rigid": "The fingertip is rigidly attached to the last finger joint of the bundled open "
    "body's skeleton.",
    "joint": "The tracked joint is taken from the bundled open body's skeleton.",
    "joint of the body": "The tracked joint is taken from the licensed SMPL-X body.",
}


def high_pass_mm(positions: Float[np.ndarray, "T 3"], fps: float) -> Float[np.ndarray, "T 3"]:
    """Return positions (m) high-passed at 5 Hz in millimetres (zero-phase Butterworth, order 4)."""
    low = butter(ORDER, CUT_OFF_HZ, fs=fps, output="sos")
    exact = np.asarray(positions, np.float64)
    return 1000.0 * (exact - sosfiltfilt(low, exact, axis=0))


@dataclass(frozen=True)
class JointMarks:
    """Pixel positions and values of the joints in each snapshot."""

    pixels: Mapping[str, np.ndarray]
    """Pixels (N, J, 2) from the upper left corner, by motion; NaN draws nothing."""
    joint_jerk: Mapping[str, np.ndarray]
    """Jerk (N, J) in m/s³, by motion; NaN draws nothing."""
    full_scale: float
    """Value of the strongest mark (m/s³); larger values look the same."""
    crop_joints: Sequence[int] | None = None
    """Joints that the cropped snapshots hold, such as those of the upper body; None for all."""

    @property
    def caption(self) -> str:
        return (
            "Marks on the snapshots show each joint's jerk at about that time. They are largest and"
            f" darkest at {self.full_scale:g} m/s³ and above; joints below"
            f" {MIN_MARK_STRENGTH * self.full_scale:g} m/s³ have no mark."
        )


def choose_snapshot_frames(num_frames: int, start_frame: int = 0) -> tuple[int, ...]:
    """Return the snapshot frames: every 50 frames from the start of the window."""
    end = min(num_frames, start_frame + WINDOW_FRAMES)
    return tuple(range(start_frame, end, SNAPSHOT_EVERY))


@dataclass(frozen=True)
class Figure6:
    """Contents of one Figure 6, computed by others; raises FigureError beyond a limit."""

    trajectories: Mapping[str, np.ndarray]
    """Positions (T, 3) of the tracked point in metres, y up, from the clip's first frame, by
    motion: one to six systems and the reference. Longer ones are cut to the shortest."""
    snapshots: Mapping[str, np.ndarray]
    """Pictures (N, H, W, 3) uint8 of one camera, for at least the same names; may be empty."""
    snapshot_frames: Sequence[int]
    """Frames at which the snapshots were taken, see :func:`choose_snapshot_frames`."""
    fps: float = 30.0
    marks: JointMarks | None = None
    """Joints by which snapshots are cropped and marked; required with snapshots."""
    reference: str | None = None
    """Name of the recorded motion, drawn first and in black; None without one."""
    start_frame: int = 0
    tracked_point: str = "Right middle fingertip"
    tracked_point_source: str = ""
    """Location of the point on the body, such as ``rigid`` or ``vertex 7794``, for the caption."""
    post_filter: PostFilter = "none"
    """Filter that was applied to all trajectories, for the caption; not applied here."""
    clip: str = ""
    caveat: str = ONE_SEED_CAVEAT
    requested_panels: Sequence[str] = PANELS
    """Requested panels; those without data are left out."""
    width_mm: float = PAGE_MM

    def __post_init__(self) -> None:
        if self.reference is not None and self.reference not in self.trajectories:
            raise FigureError(
                f"The reference {self.reference!r} is not among the trajectories:"
                f" {', '.join(map(repr, self.trajectories))}."
            )
        count = len(self.trajectories) - (self.reference is not None)
        if not 1 <= count <= MAX_SYSTEMS:
            raise FigureError(
                f"Figure 6 can show 1 to {MAX_SYSTEMS} systems besides the reference; got {count}."
            )
        for name, positions in self.trajectories.items():
            if len(positions) <= self.start_frame:
                raise FigureError(
                    f"Figure 6 starts at frame {self.start_frame}, but {name!r} has only"
                    f" {len(positions)} frames; choose an earlier start."
                )
            if not np.isfinite(self.window_trajectories[name]).all():
                bad = int(
                    np.flatnonzero(~np.isfinite(self.window_trajectories[name]).all(axis=1))[0]
                )
                raise FigureError(
                    f"The position of {name!r} at frame {self.start_frame + bad} is not a finite"
                    " number."
                )
        if self.snapshots and (self.marks is None or set(self.motion_names) - set(self.snapshots)):
            raise FigureError(
                "With snapshots, every motion needs a trajectory, snapshots and joint marks; got"
                f" trajectories of {', '.join(map(repr, self.motion_names))}, snapshots of"
                f" {', '.join(map(repr, self.snapshots))}, and"
                f" {'no joint marks' if self.marks is None else 'joint marks'}."
            )
        if not self.panels:
            raise FigureError(
                f"None of the requested panels ({', '.join(self.requested_panels)}) can be drawn:"
                f" panel b needs snapshots, and panel d (tremor) needs at least {MIN_TREMOR_FRAMES}"
                f" frames; the motion has {self.window_num_frames}."
            )

    @cached_property
    def motion_names(self) -> tuple[str, ...]:
        """Names of the motions, the reference first."""
        return tuple(sorted(self.trajectories, key=lambda name: name != self.reference))

    @cached_property
    def window_num_frames(self) -> int:
        """Number of frames inside the window of the shortest motion."""
        return min(self._lengths)

    @cached_property
    def _lengths(self) -> list[int]:
        """Frames inside the window."""
        lengths = (len(each) - self.start_frame for each in self.trajectories.values())
        return [min(length, WINDOW_FRAMES) for length in lengths]

    @cached_property
    def _window(self) -> slice:
        return slice(self.start_frame, self.start_frame + self.window_num_frames)

    @cached_property
    def window_trajectories(self) -> dict[str, np.ndarray]:
        """Positions (T, 3) in metres inside the window, by motion."""
        return {key: np.asarray(self.trajectories[key])[self._window] for key in self.motion_names}

    @cached_property
    def tremor_mm(self) -> dict[str, np.ndarray]:
        """Positions (T, 3) above 5 Hz inside the window, by motion."""
        filtered = {
            name: high_pass_mm(self.trajectories[name], self.fps) for name in self.motion_names
        }
        return {name: positions[self._window] for name, positions in filtered.items()}

    @cached_property
    def tremor_scale_mm(self) -> float:
        """End of the scale of tremor (mm); values beyond it are cut."""
        sizes = np.abs(np.concatenate(list(self.tremor_mm.values())))
        return max(float(np.percentile(sizes, TREMOR_PERCENTILE)), MIN_TREMOR_MM)

    @cached_property
    def panels(self) -> tuple[str, ...]:
        """Requested panels that have data, in the order of `PANELS`."""
        has = {"b": bool(self.snapshots), "d": self.window_num_frames >= MIN_TREMOR_FRAMES}
        return tuple(
            letter for letter in PANELS if letter in self.requested_panels and has.get(letter, True)
        )

    @property
    def times(self) -> np.ndarray:
        """Times of the window's frames (s)."""
        return (self.start_frame + np.arange(self.window_num_frames)) / self.fps

    @cached_property
    def styles(self) -> dict[str, SeriesStyle]:
        return series_styles(self.motion_names, self.reference)

    @property
    def is_in_one_plot(self) -> bool:
        """True if all curves share plots; otherwise each motion has small plots."""
        return len(self.motion_names) - (self.reference is not None) <= MAX_SYSTEMS_IN_ONE_PLOT

    @property
    def window_snapshot_frames(self) -> tuple[int, ...]:
        """Frames of the snapshots inside the window, counted from its start."""
        if "b" not in self.panels:
            return ()
        inside = (frame - self.start_frame for frame in self.snapshot_frames)
        return tuple(frame for frame in inside if 0 <= frame < self.window_num_frames)

    @property
    def marker_frames(self) -> list[int]:
        """Frames of the curves' markers: those of the snapshots, or else six evenly spaced."""
        evenly = np.linspace(0, self.window_num_frames, 6, endpoint=False).astype(int)
        return list(self.window_snapshot_frames) or sorted({int(frame) for frame in evenly})

    @property
    def caption(self) -> str:
        clip = f" of {self.clip}" if self.clip else ""
        details = {
            f"{self.tracked_point}, frames {self.start_frame} to {self._window.stop - 1}{clip}"
            f" at {self.fps:g} fps. Positions are in metres, with y up; x, y and z have the same"
            " scale.": True,
            f"Each motion has its own row; {self.motion_names[0]} is drawn faintly in all rows.":
                not self.is_in_one_plot,
            "All motions are cut to the length of the shortest one.":
                max(self._lengths) > min(self._lengths),
            "Grey lines and markers show the frames of the snapshots.": self.window_snapshot_frames,
            self.marks.caption if self.marks else "": "b" in self.panels,
            self._tremor_caption if "d" in self.panels else "": True,
            _TIP_SOURCES.get(
                self.tracked_point_source,
                f"The fingertip is {self.tracked_point_source} of the licensed SMPL-X body.",
            ): self.tracked_point_source,
            _FILTERED[self.post_filter]: True,
            self.caveat: self.caveat,
        }  # fmt: skip
        return " ".join(sentence for sentence, is_true in details.items() if sentence and is_true)

    @property
    def _tremor_caption(self) -> str:
        peaks = {name: np.abs(values).max() for name, values in self.tremor_mm.items()}
        highest = max(peaks, key=lambda name: peaks[name])
        cut = (
            f" The scale ends at the {TREMOR_PERCENTILE:g}th percentile; triangles mark peaks above"
            f" it, which are cut off, and the highest is {peaks[highest]:.1f} mm ({highest})."
        )
        is_cut = peaks[highest] > self.tremor_scale_mm
        return (
            f"Tremor is the component of the position above {CUT_OFF_HZ:g} Hz (high-pass filter);"
            " x is darkest and z lightest, and all motions have the same scale."
            f"{cut if is_cut else ''}"
        )
