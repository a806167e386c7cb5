"""Parts that requests share; tyro makes flags of them, pydantic reads forms and files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from tyro.conf import Positional, Suppress, arg

from app.config import BUNDLED_WEIGHTS, body_from_environment
from app.errors import RunError
from app.flags import (
    CheckboxValuePair,
    File,
    FileOrDefault,
    MinutesFlag,
    Names,
    Text,
    choice_type,
    negative_flag,
    parse_count,
    parse_names_or_all,
    parsed_type,
    subset_type,
)
from app.run.display import Display, check_display
from conventions.names import POST_FILTERS, PostFilter
from conventions.views import BODY_LOOKS, CLOSE_UPS, FRAMINGS, VIEWS, CloseUp, Framing, View
from model.formats.reading import ImportOverrides, parse_import_overrides
from model.sampling.samplers import SAMPLER_TITLES
from model.storage.npz import MotionError
from model.systems.registry import families
from renderer.figures.style import FIGURE_FORMATS

WordSource = Literal["recognise", "none"]
WORD_SOURCES: tuple[WordSource, ...] = get_args(WordSource)
MIN_SIZE_PX, MAX_SIZE_PX = 256, 1080
"""Limits of the width and height of a picture (pixels)."""
DEFAULT_TRACKED_POINT = "right_middle"
"""Default tracked point of the metrics, a fingertip."""
NUM_WORST_SECONDS = 6
"""Number of worst seconds marked in a timeline."""
MAX_SAMPLES = 8
MAX_PAGE_CLIPS = 10
"""Maximum number of clips in one run on the page."""
MAX_STEPS = 1000
MAX_GUIDANCE = 10
MAX_COMPARED = 6
"""Maximum number of motions in a comparison video or figure."""
FIGURE_PANELS = {"a": "coordinates", "b": "snapshots", "c": "path in space", "d": "tremor"}
MAX_SNAPSHOTS = 7

SYSTEM_OPTIONS: Mapping[str, str] = {
    "steps": "steps",
    "sampler": "sampler",
    "guidance": "speech guidance scale",
}
"""Titles of the fields of `SamplingOptions` that apply only to the systems that support them."""
_SYSTEMS = tuple(name for family in families() for name in family.systems)
Steps = int | Mapping[str, int] | None
"""Number of sampling steps, for all systems or by system; None is each system's default."""


def steps_for(steps: Steps, system: str) -> int | None:
    """Return the number of sampling steps requested for a system, or None for its default."""
    return steps.get(system) if isinstance(steps, Mapping) else steps


def parse_steps(value: str) -> int | dict[str, int] | None:
    """Parse ``20`` or ``globaldiff/full=20,globaldiff/local=5``, "" as None; raises RunError."""
    parts = [part.strip() for part in value.split(",") if part.strip()]
    if not parts:
        return None
    try:
        if len(parts) == 1 and "=" not in parts[0]:
            return int(parts[0])
        pairs = [part.rsplit("=", 1) for part in parts]
        return {name.strip(): int(count) for name, count in pairs}
    except ValueError:
        raise RunError(
            "The number of steps must be a whole number, or one per system, such as "
            f"globaldiff/full=20,gan/5=10; got {value!r}."
        ) from None


def check_size(size_px: int) -> None:
    """Check the width or height of a picture; raises RunError."""
    if not MIN_SIZE_PX <= size_px <= MAX_SIZE_PX or size_px % 2:
        raise RunError(
            f"The picture size must be an even number of pixels from {MIN_SIZE_PX} to "
            f"{MAX_SIZE_PX}; got {size_px}."
        )


def parse_size(value: str) -> int:
    """Parse and check the width or height of a picture; raises RunError."""
    if not value.strip().isdecimal():
        raise RunError(f"{value!r} is not a number of pixels")
    check_size(int(value))
    return int(value)


def parse_channel(value: str) -> int:
    """Parse ``left``, ``right`` or a number from 1 into a channel index from 0; raises RunError."""
    sides = {"left": 0, "right": 1}
    if value in sides:
        return sides[value]
    if not value.isdecimal() or not 1 <= int(value) <= 64:
        raise RunError(f"{value!r} is not a channel; choose left, right, or a number from 1 to 64")
    return int(value) - 1


def parse_snapshot_frames(value: str) -> tuple[int, ...]:
    """Parse ``0,40,80`` into sorted frame indices; raises RunError for none or too many."""
    names = parse_names_or_all(value)
    if not all(name.isdecimal() for name in names) or not 1 <= len(names) <= MAX_SNAPSHOTS:
        raise RunError(f"{value!r} is not a list of 1 to {MAX_SNAPSHOTS} frames, such as 0,40,80")
    return tuple(sorted({int(name) for name in names}))


def parse_overrides(value: str) -> ImportOverrides:
    """Parse ``up=z,NAME:rate=25``; raises RunError for unknown properties and values."""
    try:
        return parse_import_overrides(value)
    except MotionError as error:
        raise RunError(str(error)) from error


def parse_expected(text: str) -> tuple[tuple[str, float], ...]:
    """Parse ``fgd=4.2,beats/emage=.77``; raises RunError for what is none.

    A name is a metric (the part of an id before the slash), an id, or a value such as slide_m.
    """
    from model.metrics.protocols.table import PROTOCOLS

    names = {name for record in PROTOCOLS.values() for name in record.metric_names}
    expected = []
    for part in parse_names_or_all(text):
        name, _, value = (word.strip() for word in part.rpartition("="))
        try:
            expected.append((name, float(value)))
        except ValueError:
            raise RunError(
                f"Expected values must be METRIC=NUMBER, such as fgd=4.2; got {part!r}."
            ) from None
        if name not in names:
            raise RunError(f"There is no metric {name!r}; choose from {', '.join(sorted(names))}.")
    return tuple(expected)


def check_choice(value: object, choices: tuple[Any, ...], noun: str) -> None:
    """Check that a value is one of the choices; the RunError lists them."""
    if value not in choices:
        names = ", ".join(str(name) for name in choices if name)
        raise RunError(f"There is no {noun} {value!r}; choose one of {names}.")


def check_steps(steps: Steps) -> None:
    """Check the numbers of sampling steps; raises RunError."""
    for system, count in steps.items() if isinstance(steps, Mapping) else [("", steps)]:
        if count is not None and not 1 <= count <= MAX_STEPS:
            which = f"steps of {system}" if system else "steps"
            raise RunError(f"The number of {which} must be from 1 to {MAX_STEPS}; got {count}.")


OverridesFlag = Annotated[
    ImportOverrides,
    parsed_type(parse_overrides, "WHAT=VALUE,...", show=lambda overrides: "nothing"),
    arg(
        name="assume",
        help="How to interpret motion files that lack metadata, for example up=z,units=cm,rate=25 "
        "(up axis, units, frame rate). Other keys: hands=mean, rotations=6d-columns, facing=x, "
        "motion=2, frames=bridge, lag=.4 (docs/formats.md). NAME:up=z applies to one file only.",
    ),
]
Channel = Annotated[int | None, parsed_type(parse_channel, "left|right|N", "all, mixed")]
CloseUps = Annotated[
    tuple[CloseUp, ...],
    subset_type(
        CLOSE_UPS, "there is no close-up {name!r}; choose from {names}, or off", "V,...|off", "off"
    ),
    arg(name="close-up"),
]
FigureFormats = Annotated[
    tuple[str, ...],
    subset_type(
        FIGURE_FORMATS, "there is no figure format {name!r}; choose from {names}", "png,svg,..."
    ),
    arg(name="figures"),
]
FigureFrames = Annotated[
    tuple[int, ...],
    parsed_type(parse_snapshot_frames, "N,...", "every 50 from --start"),
    arg(name="frames"),
]
FigurePanels = Annotated[
    tuple[str, ...],
    subset_type(
        tuple(FIGURE_PANELS), "there is no panel {name!r}; Figure 6 has {names}", "a,b,..."
    ),
    arg(name="panels"),
]
FigureWidth = Literal["85mm", "174mm"]
Height = Annotated[int, parsed_type(parse_size, "PX"), arg(name="size")]
BodyLook = Annotated[str, choice_type(BODY_LOOKS)]
PerSystem = Annotated[Steps, parsed_type(parse_steps, "N|A=N,...", "default of each system")]
Sampler = Annotated[str | None, parsed_type(str, "NAME", "default of each system")]
GuidanceScale = Annotated[float | None, parsed_type(float, "N", "default of each system")]
Views = Annotated[
    tuple[View, ...], subset_type(VIEWS, "there is no view {name!r}; choose from {names}", "V,...")
]
Window = Annotated[
    int | None,
    parsed_type(parse_count, "N", "all periods from 2 to 240 frames are tested"),
    arg(name="window"),
]


@dataclass(frozen=True, kw_only=True)
class SpeechInput:
    """Speech recording with options for reading it and the source of its words."""

    path: Annotated[File, arg(name="speech")] = None
    """Audio file that all motions belong to, for BeatAlign and its chance level; for folders of
    motions, a folder of audio files."""
    channel: Channel = None
    """Audio channel to use, such as one side of a dialogue."""
    transcript: File = None
    """Transcript: a TextGrid or subtitles with times, or plain English text (.txt), which is then
    aligned with the speech automatically. Its words are shown in the timeline, and
    `workbench/planned` chooses and times gestures by them; no metric uses them."""
    word_source: Annotated[
        WordSource, CheckboxValuePair("recognise", "none"), arg(name="words")
    ] = "none"
    """Recognise English words if there is no transcript. This takes about a fifth of the speech's
    duration on one core."""

    def check(self) -> None:
        check_choice(self.word_source, WORD_SOURCES, "word source")


@dataclass(frozen=True, kw_only=True)
class GenerationSpeech(SpeechInput):
    """Speech recording for which motion is generated."""

    path: Annotated[
        Positional[Path],
        arg(
            metavar="SPEECH",
            help="Audio file, a folder of audio files, or a .txt with one path per line.",
        ),
    ] = field()
    max_speech_s: MinutesFlag = 600.0
    """Maximum length of the speech."""


@dataclass(frozen=True, kw_only=True)
class PlanSource(SpeechInput):
    """Speech recording to sample a plan from, or a motion file to detect the plan of."""

    path: Annotated[
        Positional[Path],
        arg(metavar="SPEECH", help="Audio file, or a motion file to detect a plan from."),
    ] = field()


@dataclass(frozen=True, kw_only=True)
class SamplingOptions:
    """Systems to run and their sampling options; all systems have the same noise seed."""

    systems: Annotated[Names, arg(help=f"Systems to run, out of {', '.join(_SYSTEMS)}.")] = ()
    weights: Path = BUNDLED_WEIGHTS
    """Folder of trained systems."""
    speaker: Text = None
    """Speaker style of the motion, such as anna. An unknown name gives a list of all speakers."""
    seed: int = 0
    """Seed of the noise. The same speech file, options and seed give the same motion, whether the
    clip is generated alone or in a batch."""
    samples: int = 1
    """Number of samples per system."""
    steps: PerSystem = None
    """Number of sampling steps, for all systems or by system name. If a system samples the face
    with fewer steps, this is the number for the body."""
    sampler: Annotated[
        Sampler,
        arg(
            help="Sampler for the systems that have it; the others use their default. Names: "
            f"{', '.join(SAMPLER_TITLES)}."
        ),
    ] = None
    guidance: GuidanceScale = None
    """Guidance scale of the speech (classifier-free guidance), 0 (speech ignored) to 10; 1 (as
    trained) is the value in the papers' code. It applies to systems that support guidance; for
    `workbench/planned` it is the planner's scale, and that of the motion generator is fixed."""
    post_filter: Annotated[PostFilter, CheckboxValuePair("savgol", "none")] = "none"
    """Smooth the motion of every system. Metrics are computed for both raw and smoothed motion."""

    def check(self) -> None:
        check_choice(self.post_filter, POST_FILTERS, "post-filter")
        if not 1 <= self.samples <= MAX_SAMPLES:
            raise RunError(
                f"The number of samples must be from 1 to {MAX_SAMPLES}; got {self.samples}."
            )
        check_steps(self.steps)
        if self.guidance is not None and not 0 <= self.guidance <= MAX_GUIDANCE:
            raise RunError(f"Guidance must be from 0 to {MAX_GUIDANCE}; got {self.guidance:g}.")
        if self.seed < 0:
            raise RunError(f"The seed must not be negative; got {self.seed}.")


@dataclass(frozen=True, kw_only=True)
class PlanOptions:
    """Gesture plan and style for the systems that use plans."""

    plan: FileOrDefault = None
    """Gesture plan for the systems that use plans, as written by a run or by `plan`, or annotated
    in Praat or ELAN (.json, .TextGrid, .eaf). For several speech files, a folder of plans. By
    default, plans are sampled from the speech."""
    style: File = None
    """Style file (.toml): gesture rate, size, height and speed for every plan (docs/plans.md)."""


@dataclass(frozen=True, kw_only=True)
class ImportOptions:
    """Reference motion and overrides for reading motion files."""

    reference: File = None
    """Recorded motion to compare with."""
    import_overrides: OverridesFlag = field(default_factory=ImportOverrides)


@dataclass(frozen=True, kw_only=True)
class MotionInput:
    """Imported motions to measure."""

    motions: Annotated[
        Positional[tuple[Path, ...]],
        arg(
            metavar="MOTION",
            help_behavior_hint="(required)",
            help=".npz (BEAT2, AMASS, SMPL-X parameters), .npy (rotations, TalkSHOW) or .bvh; or "
            "folders or zips of them, paired by name, for metrics over many clips.",
        ),
    ]
    names: Suppress[tuple[str, ...]] = ()
    """Names of the motions; by default their file names."""
    generation_window_frames: Window = None
    """Window length (frames) with which all motions but the reference were generated, if known."""
    window_overlap_frames: Annotated[int, arg(name="overlap")] = 0
    """Overlap of these windows in frames."""
    visible: Annotated[Names, arg(name="show", help_behavior_hint="")] = ()
    """Motions to show in figures and viewer, by file name, if there are more than six; by default
    the first six. Metrics are computed for all."""
    max_total_frames: Suppress[int | None] = None
    """Maximum number of frames of all motions together, at 30 frames per second."""
    source_run: Suppress[Path | None] = None
    """Folder of the run that the motions come from, if a run is opened and measured again."""


@dataclass(frozen=True, kw_only=True)
class MetricOptions:
    """Files of other projects' evaluation code, for metrics that are comparable with papers."""

    mean_speeds: File = None
    """EMAGE's mean_vel_smplxflame_30.npy (BEAT2's "weights" folder): compute BeatAlign with its
    published joint speeds, for comparison with papers."""
    emage_weights: File = None
    """EMAGE's AESKConv_240_100.bin, for FGD as papers on BEAT2 report it. Only for folders of
    motions with --reference (docs/many-clips.md)."""
    genea_weights: Annotated[
        tuple[Path, ...],
        parsed_type(
            lambda text: tuple(map(Path, parse_names_or_all(text))),
            "FILE,...",
            "none",
            lambda paths: ",".join(map(str, paths)),
        ),
    ] = ()
    """GENEA's model_checkpoint_30, _60 and _90.bin, one or several, for FGD as its evaluations
    report it. Only for folders of motions with --reference."""
    semantics: File = None
    """BEAT's labels of semantic relevance, for SRGR: one file of BEAT's "sem" folder; for folders
    of motions, that folder."""
    expected: Annotated[
        tuple[tuple[str, float], ...],
        parsed_type(parse_expected, "NAME=N,...", "none"),
        arg(name="expect"),
    ] = ()
    """Values that a paper reports, such as fgd=4.2,beats/emage=.77. A table compares them
    with the values of these motions under each protocol. Only for folders of motions
    (docs/evaluation.md)."""
    weights: Suppress[Path] = BUNDLED_WEIGHTS
    """Folder of the accent network, which marks prominent words in the timeline."""


@dataclass(frozen=True, kw_only=True)
class FigureOptions:
    """Content of Figure 6 (fingertip path and poses, as in the paper); formats of all figures."""

    start_frame: Annotated[int, arg(name="start")] = 0
    """Frame at which Figure 6 starts; it shows up to 300 frames (10 s)."""
    figure_panels: FigurePanels = tuple(FIGURE_PANELS)
    """Panels of Figure 6: coordinates (a), snapshots (b), path in space (c), tremor (d)."""
    figure_frames: FigureFrames = ()
    """Frames of the snapshots in Figure 6."""
    figure_width: Annotated[FigureWidth, arg(name="width")] = "174mm"
    """Width of Figure 6 in print."""
    figure_formats: FigureFormats = FIGURE_FORMATS
    """File formats of all figures."""


@dataclass(frozen=True, kw_only=True)
class VideoOptions:
    """Body, and appearance of videos."""

    body: FileOrDefault = field(default_factory=body_from_environment)
    """A character (.vrm, .glb) or licensed SMPLX_NEUTRAL*.npz; by default $SMPLX_MODEL, else the
    bundled body."""
    look: BodyLook = BODY_LOOKS[0]
    """Body shape and skin tone of the open body; licensed bodies and characters
    have one look only."""
    views: Views = ("front",)
    """Camera views of videos; the first is used for the comparison."""
    close_ups: CloseUps = ("hands",)
    """Close-ups of the face above or hands below the body, in the first view and the comparison."""
    framing: Framing = "knees"
    """Visible part of the body: the whole body, or enlarged from the knees up."""
    picture_height_px: Height = 512
    """Height of one body's picture (pixels). The width is the same for the whole body, and three
    quarters of the height from the knees up. Each close-up adds half the width to the height."""
    display: Display = field(default_factory=Display)
    """Display options: trail, colour and exaggeration."""

    def check(self) -> None:
        for view in self.views:
            check_choice(view, VIEWS, "view")
        check_choice(self.framing, FRAMINGS, "framing")
        for close_up in self.close_ups:
            check_choice(close_up, CLOSE_UPS, "close-up")
        if not self.views:
            raise RunError(f"No view was chosen; choose from {', '.join(VIEWS)}.")
        check_display(self.display)


@dataclass(frozen=True, kw_only=True)
class OutputOptions:
    """Folder and kinds of the results."""

    out: Path
    """Folder of results."""
    has_video: Annotated[bool, negative_flag("video", "Render no videos.")] = True
    """True to render a video of each motion."""
    has_figure_poses: Annotated[bool, negative_flag("poses", "Draw Figure 6 without poses.")] = True
    """True to show poses in Figure 6 even if no videos are rendered."""
    has_figures: Annotated[bool, negative_flag("figures", "Draw no figures.")] = True
    """True to draw Figure 6 and the figure on the sources of jitter."""
    title: Suppress[str] = ""
    """Title of the run; by default composed from its inputs."""
    is_incremental: Suppress[bool] = False
    """Make each file available as soon as it is complete and keep it if the run fails. By default,
    all files appear at the end, or none."""


@dataclass(frozen=True, kw_only=True)
class MeasurementOutput(OutputOptions):
    """Folder and kinds of the results of measuring imported motions."""

    has_video: Annotated[
        bool,
        arg(
            name="videos",
            help="Render a video, with close-ups and a trail, of each motion that the figures "
            "show; all motions start at the origin.",
        ),
    ] = False


@dataclass(frozen=True, kw_only=True)
class ExperimentOutput:
    """Folder and figure of an experiment."""

    out: Path
    """Folder of results."""
    figure_formats: FigureFormats = FIGURE_FORMATS
    """File formats of the figure."""
    is_incremental: Suppress[bool] = False
    """True to make each file available as soon as it is complete and keep it if the task fails."""


@dataclass(frozen=True)
class LiveRecording:
    """Motion recorded in a live session."""

    motion: Path
    """Motion file of the same length as the speech."""
    metadata: Mapping[str, Any]
    """Metadata of the session for the provenance record."""
    truncation_note: str = ""
    """Note for the user if the recording is shorter than the session; otherwise empty."""
    plan: Path | None = None
    """Gesture plan of the motion, of the same length, if the system uses plans."""
