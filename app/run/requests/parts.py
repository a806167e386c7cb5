"""Parts that several requests share. tyro makes flags of their fields, forms and files are read
into them by pydantic (`app.run.requests.convert`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from tyro.conf import Positional, Suppress, arg

from app.config import BUNDLED_WEIGHTS, default_body
from app.errors import RunError
from app.flags import (
    File,
    Minutes,
    Names,
    Switch,
    Text,
    choice_type,
    negative_flag,
    parse_count,
    parse_names,
    subset_type,
    text_type,
)
from app.run.display import Display, check_display
from conventions.names import POST_FILTERS, PostFilter
from conventions.views import CLOSE_UPS, FRAMINGS, LOOKS, VIEWS, CloseUp, Framing, View
from model.formats.read import Assumptions, read_told
from model.storage.npz import MotionError
from renderer.figures.style import FORMS

WordSource = Literal["recognise", "none"]
WORD_SOURCES: tuple[WordSource, ...] = get_args(WordSource)
MIN_SIZE_PX, MAX_SIZE_PX = 256, 1080
"""Smallest and largest width and height of a picture (pixels)."""
DEFAULT_TRACKED_POINT = "right_middle"
"""Fingertip that metrics follow by default."""
NUM_WORST_SECONDS = 6
"""Number of worst seconds that a timeline marks."""
MAX_SAMPLES = 8
MAX_CLIPS = 10
"""Most clips of one run on the page."""
MAX_STEPS = 1000
MAX_GUIDANCE = 10
MAX_COMPARED = 6
"""Most motions in one comparison video or figure."""
FIGURE_PANELS = {"a": "coordinates", "b": "snapshots", "c": "path in space", "d": "tremble"}
MAX_SNAPSHOTS = 7

SYSTEM_OPTIONS: Mapping[str, str] = {
    "steps": "steps",
    "sampler": "sampler",
    "guidance": "strength of the speech",
}
"""Fields of `SamplingOptions` that each system takes as far as it supports them, with titles."""
Steps = int | Mapping[str, int] | None
"""Sampling steps of all systems or by system; None uses each system's default."""


def steps_for(steps: Steps, system: str) -> int | None:
    """Return the requested steps of one system, or None for its default."""
    return steps.get(system) if isinstance(steps, Mapping) else steps


def parse_steps(value: str) -> int | dict[str, int] | None:
    """Parse ``20`` or ``globaldiff/full=20,globaldiff/local=5``; an empty text is None.

    Raises:
        RunError: if it is neither.
    """
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
            f"Steps are a number, or numbers by system such as globaldiff/full=20; got {value!r}."
        ) from None


def check_size(size_px: int) -> None:
    """Raise `RunError` for a width or height that pictures cannot have."""
    if not MIN_SIZE_PX <= size_px <= MAX_SIZE_PX or size_px % 2:
        raise RunError(
            f"{size_px} pixels; pictures have {MIN_SIZE_PX} to {MAX_SIZE_PX} on each side, an even "
            "number."
        )


def parse_size(value: str) -> int:
    """Parse the width or height of a picture. Raises `RunError` if pictures cannot have it."""
    if not value.strip().isdecimal():
        raise RunError(f"{value!r} is no number of pixels")
    check_size(int(value))
    return int(value)


def parse_channel(value: str) -> int:
    """Parse ``left``, ``right`` or a number from 1 to the channel's index from 0. Raises `RunError`
    for anything else."""
    sides = {"left": 0, "right": 1}
    if value in sides:
        return sides[value]
    if not value.isdecimal() or not 1 <= int(value) <= 64:
        raise RunError(f"{value!r} is no channel; say left, right, or a number from 1")
    return int(value) - 1


def parse_frames(value: str) -> tuple[int, ...]:
    """Parse ``0,40,80`` to sorted frames. Raises `RunError` for no frames, and for too many."""
    names = parse_names(value)
    if not all(name.isdecimal() for name in names) or not 1 <= len(names) <= MAX_SNAPSHOTS:
        raise RunError(f"{value!r} is not 1 to {MAX_SNAPSHOTS} frames, such as 0,40,80")
    return tuple(sorted({int(name) for name in names}))


def parse_overrides(value: str) -> Assumptions:
    """Parse ``up=z,NAME:rate=25``. Raises `RunError` for unknown kinds and values."""
    try:
        return read_told(value)
    except MotionError as error:
        raise RunError(str(error)) from error


def check_choice(value: object, choices: tuple[Any, ...], what: str) -> None:
    """Raise `RunError` that lists the choices if the value is none of them."""
    if value not in choices:
        names = ", ".join(str(name) for name in choices if name)
        raise RunError(f"There is no {what} {value!r}; choose one of {names}.")


def check_steps(steps: Steps) -> None:
    """Raise `RunError` for numbers of steps that no system can take."""
    for system, count in steps.items() if isinstance(steps, Mapping) else [("", steps)]:
        if count is not None and not 1 <= count <= MAX_STEPS:
            which = f"Steps of {system}" if system else "Steps"
            raise RunError(f"{which} must be 1 to {MAX_STEPS}; got {count}.")


ImportOverrides = Annotated[
    Assumptions,
    text_type(parse_overrides, "WHAT=VALUE,...", show=lambda overrides: "nothing"),
    arg(
        name="assume",
        help="How motion files are to be read where they say too little: up=z,units=cm,rate=25,"
        "hands=mean,rotations=6d-columns,facing=x,motion=2,frames=bridge,lag=.4; NAME:up=z for one "
        "of them.",
    ),
]
Channel = Annotated[int | None, text_type(parse_channel, "left|right|N", "all, mixed")]
CloseUps = Annotated[
    tuple[CloseUp, ...],
    subset_type(CLOSE_UPS, "no close-up {name!r}; there are {names}, or off", "V,...|off", "off"),
    arg(name="close-up"),
]
FigureForms = Annotated[
    tuple[str, ...],
    subset_type(FORMS, "no form {name!r}; figures are written as {names}", "png,svg,..."),
    arg(name="figures"),
]
FigureFrames = Annotated[
    tuple[int, ...],
    text_type(parse_frames, "N,...", "every 50 from --start"),
    arg(name="frames"),
]
FigurePanels = Annotated[
    tuple[str, ...],
    subset_type(tuple(FIGURE_PANELS), "no panel {name!r}; Figure 6 has {names}", "a,b,..."),
    arg(name="panels"),
]
FigureWidth = Literal["85mm", "174mm"]
Height = Annotated[int, text_type(parse_size, "PX")]
BodyLook = Annotated[str, choice_type(LOOKS)]
PerSystem = Annotated[Steps, text_type(parse_steps, "N|A=N,...", "as each usually takes")]
Sampler = Annotated[str | None, text_type(str, "NAME", "each its usual one")]
GuidanceScale = Annotated[float | None, text_type(float, "N", "as suits each system")]
Views = Annotated[
    tuple[View, ...], subset_type(VIEWS, "no view {name!r}; views are {names}", "V,...")
]
Window = Annotated[int | None, text_type(parse_count, "N", "every period from 2 to 240 is tried")]


@dataclass(frozen=True, kw_only=True)
class SpeechInput:
    """Speech recording, how it is read, and where its words come from."""

    path: Annotated[File, arg(name="speech")] = None
    """Sound that all motions belong to, for BeatAlign and its chance level; a folder of sound files
    for folders of motions."""
    channel: Channel = None
    """The one channel of several that is used, such as one side of a dialogue."""
    transcript: File = None
    """What is said: a TextGrid, or a plain English text (.txt), which is aligned to the speech; for
    metrics and timeline."""
    words: Annotated[WordSource, Switch("recognise", "none")] = "none"
    """Recognise English words if there is no transcript; takes a fifth of the speech's length on
    one core."""

    def check(self) -> None:
        """Raise `RunError` for options that cannot be."""
        check_choice(self.words, WORD_SOURCES, "way to words")


@dataclass(frozen=True, kw_only=True)
class SpeechToMove(SpeechInput):
    """Speech recording that motion is generated for."""

    path: Annotated[
        Positional[Path],
        arg(
            metavar="SPEECH",
            help="Any sound file; or many: a folder of them, or a .txt with one path a line.",
        ),
    ] = field()
    max_speech_s: Minutes = 600.0
    """Longest speech that is accepted."""


@dataclass(frozen=True, kw_only=True)
class PlanSource(SpeechInput):
    """Speech recording that a plan is sampled from, or a motion whose plan is detected."""

    path: Annotated[
        Positional[Path],
        arg(metavar="SPEECH", help="Any sound file; or a motion, whose plan is found."),
    ] = field()


@dataclass(frozen=True, kw_only=True)
class SamplingOptions:
    """Which systems generate, and how they sample; all start from the same noise."""

    systems: Names = ()
    """Names of systems."""
    weights: Path = BUNDLED_WEIGHTS
    """Folder of trained systems."""
    speaker: Text = None
    """Speaker whose style the motion has."""
    seed: int = 0
    """Seed of the noise. The same speech file, options and seed give the same motion, whether the
    clip is generated alone or among others."""
    samples: int = 1
    """Motions per system."""
    steps: PerSystem = None
    """Sampling steps, of all systems or by name; of the body where a system generates the face in a
    fraction of them."""
    sampler: Sampler = None
    """Sampler of the systems that have it; the others use their default."""
    guidance: GuidanceScale = None
    """Classifier-free guidance scale, 0 (speech is ignored) to 10; 1 is as trained, and as the
    papers' own code samples. Only for systems that support guidance."""
    post_filter: Annotated[PostFilter, Switch("savgol", "none")] = "none"
    """Smooth every system in the same way; metrics are given with and without it in any case."""

    def check(self) -> None:
        """Raise `RunError` for options that cannot be."""
        check_choice(self.post_filter, POST_FILTERS, "post-filter")
        if not 1 <= self.samples <= MAX_SAMPLES:
            raise RunError(f"Samples must be 1 to {MAX_SAMPLES}; got {self.samples}.")
        check_steps(self.steps)
        if self.guidance is not None and not 0 <= self.guidance <= MAX_GUIDANCE:
            raise RunError(f"Guidance must be 0 to {MAX_GUIDANCE}; got {self.guidance:g}.")
        if self.seed < 0:
            raise RunError(f"The seed must not be negative; got {self.seed}.")


@dataclass(frozen=True, kw_only=True)
class PlanOptions:
    """Gesture plan for the systems that follow one."""

    plan: File = None
    """Gesture plan for the systems that follow one, as a run or `plan` writes it, or annotated in
    Praat or ELAN: .json, .TextGrid, .eaf; for several pieces of speech a folder of them. Without
    one, plans are sampled from the speech."""
    style: File = None
    """How often, how large, how high, how fast (.toml): applied to every plan (docs/plans.md)."""


@dataclass(frozen=True, kw_only=True)
class ImportOptions:
    """Motion files of others: the reference, and how files are read."""

    reference: File = None
    """Recorded motion to compare with."""
    import_overrides: ImportOverrides = field(default_factory=Assumptions)


@dataclass(frozen=True, kw_only=True)
class MotionInput:
    """Imported motions that are measured."""

    motions: Annotated[
        Positional[tuple[Path, ...]],
        arg(
            metavar="MOTION",
            help=".npz (BEAT2, AMASS, SMPL-X parameters), .npy (rotations, TalkSHOW) or .bvh; or "
            "folders or zips of them, paired by name, for numbers over many clips.",
        ),
    ]
    names: Suppress[tuple[str, ...]] = ()
    """Names of the motions; by default the names of their files."""
    window: Window = None
    """Frames of the windows that all motions but the reference were generated in, if known."""
    overlap: int = 0
    """Frames that two such windows share."""
    shown: Annotated[Names, arg(name="show")] = ()
    """Motions that figures and viewer show, by the names of their files, if there are more than
    six; by default the first six. All are measured."""
    max_frames: Suppress[int | None] = None
    """Most frames of all motions together, at 30 frames per second."""
    source_run: Suppress[Path | None] = None
    """Folder of the run that the motions come from, if they are measured again to be shown."""


@dataclass(frozen=True, kw_only=True)
class MetricOptions:
    """Files of others' evaluation code."""

    mean_speeds: File = None
    """EMAGE's mean_vel_smplxflame_30.npy (BEAT2's folder weights): BeatAlign with its published
    speeds of the joints, to be compared with papers."""
    emage_weights: File = None
    """Of folders beside --reference: EMAGE's AESKConv_240_100.bin, for FGD as papers on BEAT2
    report it (docs/many-clips.md)."""
    weights: Suppress[Path] = BUNDLED_WEIGHTS
    """Folder of the accent network, which marks prominent words in the timeline."""


@dataclass(frozen=True, kw_only=True)
class FigureOptions:
    """What Figure 6 shows, and the file formats of figures."""

    start_frame: Annotated[int, arg(name="start")] = 0
    """First of the 300 frames of Figure 6."""
    figure_panels: FigurePanels = tuple(FIGURE_PANELS)
    """Panels of Figure 6: a coordinates, b snapshots, c path in space, d tremble."""
    figure_frames: FigureFrames = ()
    """Frames of its snapshots."""
    figure_width: Annotated[FigureWidth, arg(name="width")] = "174mm"
    """Width of Figure 6 in print."""
    figure_forms: FigureForms = FORMS
    """File formats of all figures."""


@dataclass(frozen=True, kw_only=True)
class VideoOptions:
    """The body, and how videos show it."""

    body: File = field(default_factory=default_body)
    """Licensed SMPLX_NEUTRAL*.npz; by default $SMPLX_MODEL, else the open body."""
    look: BodyLook = LOOKS[0]
    """Build and tone of the open body; a licensed body has only the first."""
    views: Views = ("front",)
    """Views of videos; the first is used for the comparison."""
    close_ups: CloseUps = ("hands",)
    """Close-ups of face or hands beside the body in the first view's videos, and so in the
    comparison."""
    framing: Framing = "knees"
    """Visible part of the body: the whole, or from the knees up and larger."""
    size: Height = 512
    """Height of a body in one video (pixels); it is as wide where all of it is shown, and three
    quarters as wide from the knees up. A close-up adds half the width."""
    display: Display = field(default_factory=Display)
    """What videos show in addition to the body."""

    def check(self) -> None:
        """Raise `RunError` for videos that cannot be rendered."""
        for view in self.views:
            check_choice(view, VIEWS, "view")
        check_choice(self.framing, FRAMINGS, "framing")
        for close_up in self.close_ups:
            check_choice(close_up, CLOSE_UPS, "close-up")
        if not self.views:
            raise RunError(f"No view is named; choose some of {', '.join(VIEWS)}.")
        check_display(self.display)


@dataclass(frozen=True, kw_only=True)
class OutputOptions:
    """Where results go, and which kinds of files are written."""

    out: Path
    """Folder of results."""
    has_video: Annotated[bool, negative_flag("video", "No videos.")] = True
    """Whether a video of each motion is rendered."""
    has_poses: Annotated[bool, negative_flag("pictures", "No poses in Figure 6.")] = True
    """Whether Figure 6 shows poses if no videos are rendered."""
    has_figures: Annotated[bool, negative_flag("figures", "Neither Figure 6 nor jitter.")] = True
    """Whether Figure 6 and the jitter sheet are drawn."""
    title: Suppress[str] = ""
    """Title of the run; by default made of its inputs."""
    is_kept: Suppress[bool] = False
    """Whether each file appears as soon as it is whole, and stays if the run fails; by default all
    appear at the end, or none."""


@dataclass(frozen=True, kw_only=True)
class MeasurementOutput(OutputOptions):
    """Where measurements go, and which kinds of files are written."""

    has_video: Annotated[
        bool,
        arg(
            name="videos",
            help="A video of each motion that figures show, with close-ups and trail, in register.",
        ),
    ] = False


@dataclass(frozen=True)
class LiveRecording:
    """Motion that a live session has generated for the speech, kept as it was seen."""

    motion: Path
    """Motion file, as long as the speech."""
    metadata: Mapping[str, Any]
    """Facts about the session, for the provenance record."""
    truncation_note: str = ""
    """Note for the user if the recording is shorter than the session; otherwise empty."""
    plan: Path | None = None
    """Gesture plan that the motion follows, as long as it, if the system follows plans."""
