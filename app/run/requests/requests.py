"""Requests of all tasks: their inputs and options, checked before any file is opened."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, Suppress, arg

from app.config import BUNDLED_WEIGHTS, body_from_environment
from app.errors import RunError
from app.flags import File, FileOrDefault, Names, Text, parse_count, parsed_type
from app.run.display import Display, ViewerState
from app.run.requests.parts import (
    DEFAULT_TRACKED_POINT,
    MAX_STEPS,
    ExperimentOutput,
    FigureOptions,
    GenerationSpeech,
    GuidanceScale,
    Height,
    ImportOptions,
    LiveRecording,
    MeasurementOutput,
    MetricOptions,
    MotionInput,
    OutputOptions,
    OverridesFlag,
    PlanOptions,
    PlanSource,
    SamplingOptions,
    SpeechInput,
    VideoOptions,
    check_size,
)
from conventions.names import safe_file_stem
from conventions.views import CLOSE_UPS
from model.formats.reading import ImportOverrides
from model.storage.cards import parse_calm_and_lively_speaker
from model.systems.registry import list_systems, representatives
from renderer.figures.style import MAX_SYSTEMS

TrackedPointName = Annotated[
    str,
    arg(
        name="tracked-point", help="Fingertip or joint to track, such as left_index or right_wrist."
    ),
]


@dataclass(frozen=True, kw_only=True)
class RunRequest:
    """Common part of the requests that generate motion and that measure imported motion."""

    speech: SpeechInput
    imports: ImportOptions = field(default_factory=ImportOptions)
    tracked_point: TrackedPointName = DEFAULT_TRACKED_POINT
    figures: FigureOptions = field(default_factory=FigureOptions)
    video: VideoOptions = field(default_factory=VideoOptions)
    output: OutputOptions

    def check(self) -> None:
        """Check everything that needs no open file; raises RunError."""
        self.speech.check()
        self.video.check()
        if self.output.has_video:
            check_size(self.video.picture_height_px)


@dataclass(frozen=True, kw_only=True)
class GenerateRequest(RunRequest):
    """Request to generate motion of several systems for one speech.

    Example:
        >>> request = GenerateRequest(
        ...     speech=GenerationSpeech(path=Path("examples/three_reasons.wav")),
        ...     sampling=SamplingOptions(systems=("globaldiff/local",), seed=3),
        ...     output=OutputOptions(out=Path("runs/three_reasons"), has_video=False),
        ... )
        >>> request.check()  # raises RunError if an option is out of range
    """

    speech: GenerationSpeech
    sampling: SamplingOptions = field(default_factory=SamplingOptions)
    planning: PlanOptions = field(default_factory=PlanOptions)
    live_recording: Suppress[LiveRecording | None] = None
    """Motion of a live session with one system, used instead of generating motion."""

    def check(self) -> None:
        """Check everything that needs no open file; raises RunError."""
        super().check()
        self.sampling.check()


def _measured_video() -> VideoOptions:
    return VideoOptions(picture_height_px=640, display=Display(has_trail=True), close_ups=CLOSE_UPS)


@dataclass(frozen=True, kw_only=True)
class DiagnoseRequest(RunRequest):
    """Request to compute metrics and figures of imported motions, or of sets of clips."""

    speech: SpeechInput = field(default_factory=SpeechInput)
    motions: MotionInput
    metrics: MetricOptions = field(default_factory=MetricOptions)
    video: VideoOptions = field(default_factory=_measured_video)
    output: MeasurementOutput


AnyRun = GenerateRequest | DiagnoseRequest


@dataclass(frozen=True, kw_only=True)
class PlanRequest:
    """Request to sample the gesture plan of a speech, or to detect that of a motion."""

    speech: PlanSource
    out: Path
    """Output file of the plan: .json, .TextGrid or .eaf."""
    weights: Path = BUNDLED_WEIGHTS
    """Folder of trained systems."""
    speaker: Text = None
    """Speaker style of the plan."""
    seed: int = 0
    """Seed of the noise."""
    guidance: GuidanceScale = None
    """Guidance scale of the speech (classifier-free), 0 (speech ignored) to 10; 1 is as trained."""
    style: File = None
    """Style file (.toml): gesture rate, size, height and speed for the plan (docs/plans.md)."""
    import_overrides: OverridesFlag = field(default_factory=ImportOverrides)
    writes_empty_plan: Annotated[bool, arg(name="empty")] = False
    """Write an empty plan with its tiers, to be annotated by hand."""

    @property
    def sampling(self) -> SamplingOptions:
        """Sampling options of the plan."""
        return SamplingOptions(
            weights=self.weights, speaker=self.speaker, seed=self.seed, guidance=self.guidance
        )

    def check(self) -> None:
        """Check everything that needs no open file; raises RunError."""
        self.speech.check()
        self.sampling.check()


Background = Literal["studio", "transparent"]
MAX_STILLS = 64
MARKERS_SUFFIX = ".markers.csv"
"""Suffix of the table of markers written with a BVH file."""
SHEET_POSES = 8
"""Default number of poses on a contact sheet."""
RENDER_SUFFIXES = (".mp4", ".png", ".glb", ".vrma", ".bvh", ".blender.npz", ".obj", ".ply")


@dataclass(frozen=True, kw_only=True)
class StillOptions:
    """Options for stills and meshes of a motion."""

    num_stills: Annotated[int | None, parsed_type(int, "N", "none"), arg(name="stills")] = None
    """Number of stills (.png), evenly spread over the motion."""
    contact_sheet_interval: Annotated[
        int | None, parsed_type(int, "N", "none"), arg(name="contact-sheet-every")
    ] = None
    """Write a contact sheet (.png) with every N-th frame and its time."""
    mesh_frame: Annotated[int, arg(name="frame")] = 0
    """Frame to write to a .obj or .ply file, counted from 0."""
    background: Background = "studio"
    """Background of pictures; transparent shows only the body and needs a .png."""

    def check(self) -> None:
        if self.num_stills is not None and not 1 <= self.num_stills <= MAX_STILLS:
            raise RunError(
                f"The number of stills must be from 1 to {MAX_STILLS}; got {self.num_stills}."
            )
        if self.contact_sheet_interval is not None and self.contact_sheet_interval < 1:
            raise RunError(
                f"--contact-sheet-every must be at least 1; got {self.contact_sheet_interval}."
            )


@dataclass(frozen=True, kw_only=True)
class RenderRequest:
    """Request to render one motion file to a video or stills, or to export it for 3D software."""

    motion: Annotated[
        Positional[Path],
        arg(metavar="MOTION", help="Motion file: BEAT2 npz, or any other supported format."),
    ]
    out: Path
    """Output file with the suffix .mp4, .png, .glb, .vrma, .bvh, .blender.npz, .obj or .ply."""
    speech: File = None
    """Sound of the video."""
    import_overrides: OverridesFlag = field(default_factory=ImportOverrides)
    flame_to_arkit_matrix: Annotated[File, arg(name="flame-to-arkit")] = None
    """BEAT2's mat_final.npy, to convert FLAME face coefficients to ARKit weights, which the open
    body and characters use."""
    tracked_point: TrackedPointName = DEFAULT_TRACKED_POINT
    plan: FileOrDefault = None
    """Gesture plan, to write its events as markers into a .glb, .vrma or .blender.npz file, or next
    to a .bvh as .markers.csv; by default the motion's .plan.json in the same folder, if any."""
    video: VideoOptions = field(
        default_factory=lambda: VideoOptions(close_ups=(), framing="whole", picture_height_px=720)
    )
    stills: StillOptions = field(default_factory=StillOptions)

    @property
    def suffix(self) -> str:
        """Suffix of the output file, one of `RENDER_SUFFIXES`; raises RunError for any other."""
        name = self.out.name.lower()
        for suffix in RENDER_SUFFIXES:
            if name.endswith(suffix) and name != suffix:
                return suffix
        raise RunError(f"{self.out.name} must end in one of {', '.join(RENDER_SUFFIXES)}.")

    @property
    def is_video_or_picture(self) -> bool:
        """True for a video or picture, false for a file for 3D software."""
        return self.suffix in (".mp4", ".png")

    def check(self) -> None:
        """Check everything that needs no open motion file; raises RunError."""
        self.video.check()
        display = self.video.display
        is_transparent = self.stills.background == "transparent"
        if not self.is_video_or_picture and not display.is_default:
            raise RunError(
                f"A {self.suffix} file stores the unchanged motion; for trails, colours and "
                "exaggeration write a .png or .mp4."
            )
        if not self.out.parent.is_dir():
            raise RunError(f"The folder {self.out.parent} does not exist; create it first.")
        self.stills.check()
        if not self.is_video_or_picture and (
            self.stills.num_stills or self.stills.contact_sheet_interval
        ):
            raise RunError(
                f"--stills and --contact-sheet-every cannot be used with a {self.suffix} file; "
                "write a .png or .mp4."
            )
        if is_transparent and self.suffix != ".png":
            raise RunError(
                f"A {self.suffix} file cannot have a transparent background; write a .png."
            )
        if is_transparent and not display.is_default:
            raise RunError(
                "Trails, colours and exaggeration are not possible with a transparent background; "
                "remove these options or --background."
            )
        if is_transparent and self.video.close_ups:
            raise RunError(
                "Close-ups are not possible with a transparent background; remove either "
                "--close-up or --background."
            )
        if self.speech is not None and not self.speech.is_file():
            raise RunError(f"There is no speech file at {self.speech}.")


@dataclass(frozen=True, kw_only=True)
class Figure6Request:
    """Request to draw Figure 6 of a finished run again, with other panels, frames or width."""

    run: Annotated[Positional[Path], arg(metavar="RUN", help="Folder of a run.")]
    out: Path
    """Output files without their suffix, such as paper/figure6."""
    figures: FigureOptions = field(default_factory=FigureOptions)
    body: FileOrDefault = field(default_factory=body_from_environment)
    """A character (.vrm, .glb) or licensed SMPLX_NEUTRAL*.npz; by default $SMPLX_MODEL, else the
    bundled body."""


MAX_SPEECHES, MAX_SEEDS = 8, 8
TwoSpeakers = Annotated[
    tuple[str, str] | None,
    parsed_type(parse_calm_and_lively_speaker, "CALM,LIVELY", "none", ",".join),
]


@dataclass(frozen=True, kw_only=True)
class SpeechEffectRequest:
    """Request to generate several speeches with several noise seeds and compare the motions."""

    inputs: Annotated[
        Positional[tuple[Path, ...]], arg(metavar="SPEECH", help_behavior_hint="(required)")
    ]
    """Two or more audio files; or one folder of motions from any source, with file names of the
    form ``[SYSTEM__]SPEECH__SEED.npz``."""
    output: ExperimentOutput
    weights: Path = BUNDLED_WEIGHTS
    """Folder of trained systems."""
    systems: Names = field(default_factory=lambda: representatives("speech_effect"))
    """Names of systems."""
    speaker: Text = None
    """Speaker style of the motion."""
    guidance: GuidanceScale = None
    """Guidance scale of the speech (classifier-free), 0 (speech ignored) to 10; 1 is as trained."""
    num_seeds: Annotated[int, arg(name="seeds")] = 2
    """Number of noise seeds, starting from 0."""
    speakers: TwoSpeakers = None
    """Two speakers to compare on the first speech, such as hana,june."""
    max_speech_s: Suppress[float] = 600.0
    """Maximum length of a speech (s)."""

    @property
    def sampling(self) -> SamplingOptions:
        """Sampling options without the seed."""
        return SamplingOptions(
            systems=self.systems, weights=self.weights, speaker=self.speaker, guidance=self.guidance
        )

    @property
    def compares_existing_motions(self) -> bool:
        """True if a folder of motions is compared and nothing is generated."""
        return len(self.inputs) == 1 and self.inputs[0].is_dir()

    def check(self) -> None:
        """Check everything that needs no open file; raises RunError."""
        self.sampling.check()
        if self.compares_existing_motions:
            if self.speakers:
                raise RunError(
                    "--speakers needs generated motion and cannot be used with a folder of "
                    "motions; remove it."
                )
            return
        if not 2 <= len(self.inputs) <= MAX_SPEECHES:
            raise RunError(
                f"From 2 to {MAX_SPEECHES} speech recordings can be compared; got "
                f"{len(self.inputs)}."
            )
        if len({safe_file_stem(path.stem) for path in self.inputs}) < len(self.inputs):
            raise RunError("Two of the recordings have the same name; rename one of the files.")
        if not 2 <= self.num_seeds <= MAX_SEEDS:
            raise RunError(
                f"The number of noise seeds must be from 2 to {MAX_SEEDS}; got {self.num_seeds}."
            )
        _check_count(self)


MIN_NOISE_RAD, MAX_NOISE_RAD = 0.005, 0.1
ROTATION_NOISE_VIDEO = "rotation_noise.mp4"
WITHOUT_NOISE = "without noise"
"""Name of the unchanged motion in a run of the noise experiment."""


@dataclass(frozen=True, kw_only=True)
class RotationNoiseRequest:
    """Request to apply equal noise to the local and to the global rotations of a motion."""

    motion: Annotated[Positional[Path], arg(metavar="MOTION", help="One motion file.")]
    output: ExperimentOutput
    speech: File = None
    """Sound of the video."""
    seed: int = 0
    """Seed of the noise."""
    import_overrides: OverridesFlag = field(default_factory=ImportOverrides)
    tracked_point: TrackedPointName = DEFAULT_TRACKED_POINT
    body: FileOrDefault = field(default_factory=body_from_environment)
    """A character (.vrm, .glb) or licensed SMPLX_NEUTRAL*.npz; by default $SMPLX_MODEL, else the
    bundled body."""
    picture_height_px: Height = 512
    """Height of one body's picture (pixels)."""
    noise_rad: Annotated[float, arg(name="noise", metavar="RAD")] = 0.02
    """Standard deviation of the random rotation about each axis (rad), .005 to .1."""
    has_video: Suppress[bool] = True
    """True to render a video of the bodies."""

    @property
    def video(self) -> VideoOptions:
        display = Display(has_trail=True)
        return VideoOptions(
            body=self.body, picture_height_px=self.picture_height_px, display=display
        )

    def check(self) -> None:
        """Check everything that needs no open file; raises RunError."""
        if self.seed < 0:
            raise RunError(f"The seed must not be negative; got {self.seed}.")
        if not MIN_NOISE_RAD <= self.noise_rad <= MAX_NOISE_RAD:
            raise RunError(
                f"The noise must be from {MIN_NOISE_RAD:g} to {MAX_NOISE_RAD:g} rad; got "
                f"{self.noise_rad:g}."
            )
        if self.has_video:
            check_size(self.picture_height_px)
        if self.output.out.suffix.lower() == ".mp4":
            raise RunError(
                f"--out must be a folder; the video in it is called {ROTATION_NOISE_VIDEO}."
            )


STEP_COUNTS = (1, 2, 4, 8, 25)
"""Default numbers of sampling steps; the others are compared with the motion of the largest."""


def _parse_counts(value: str) -> tuple[int, ...]:
    return tuple(map(parse_count, value.split(",")))


@dataclass(frozen=True, kw_only=True)
class StepSweepRequest:
    """Request to generate the same motion with different numbers of sampling steps."""

    speech: Annotated[
        Positional[Path], arg(metavar="SPEECH", help="Audio file; its first ten seconds are used.")
    ]
    output: ExperimentOutput
    weights: Path = BUNDLED_WEIGHTS
    """Folder of trained systems."""
    systems: Annotated[Names, arg(help="Names of systems, at most six.")] = ()
    speaker: Text = None
    """Speaker style of the motion."""
    seed: int = 0
    """Seed of the noise."""
    step_counts: Annotated[
        tuple[int, ...],
        parsed_type(_parse_counts, "N,N,...", show=lambda counts: ",".join(map(str, counts))),
        arg(name="steps"),
    ] = STEP_COUNTS
    """Numbers of sampling steps."""
    max_speech_s: Suppress[float] = 600.0
    """Maximum length of the speech (s)."""

    @property
    def sampling(self) -> SamplingOptions:
        """Sampling options without the number of steps."""
        return SamplingOptions(
            systems=self.systems, weights=self.weights, speaker=self.speaker, seed=self.seed
        )

    def check(self) -> None:
        """Check everything that needs no open file; raises RunError."""
        self.sampling.check()
        if not self.step_counts or not all(1 <= count <= MAX_STEPS for count in self.step_counts):
            raise RunError(
                f"Steps must be whole numbers from 1 to {MAX_STEPS}; got "
                f"{', '.join(map(str, self.step_counts)) or 'none'}."
            )
        _check_count(self)


@dataclass(frozen=True, kw_only=True)
class ViewerVideoRequest:
    """Request to render a video of the page's viewer."""

    viewer: ViewerState
    """State of the viewer: bodies, camera and display options."""
    motions: tuple[Path, ...]
    """Motion file of each body."""
    out: Path
    """Folder of the video."""
    speech: Path | None = None
    """Sound of the video."""
    body: Path | None = None
    """Licensed SMPL-X file; None for the open body."""


@dataclass(frozen=True, kw_only=True)
class RunVideosRequest:
    """Request to render videos of all motions of a finished run."""

    run: Path
    """Folder of the run, to which each video is added as soon as it is complete."""
    out: Path
    """Folder in which the videos are rendered."""
    video: VideoOptions


def requested_systems(
    request: GenerateRequest | SpeechEffectRequest | StepSweepRequest,
) -> tuple[str, ...]:
    """Return the names of the requested systems; without any, all systems."""
    sampling = request.sampling
    return tuple(dict.fromkeys(sampling.systems)) or list_systems(sampling.weights)


def _check_count(request: SpeechEffectRequest | StepSweepRequest) -> None:
    systems = requested_systems(request)
    if not 1 <= len(systems) <= MAX_SYSTEMS:
        raise RunError(
            f"One to {MAX_SYSTEMS} systems can be compared at once; got {len(systems)}"
            f"{': ' if systems else ''}{', '.join(systems)}."
        )
