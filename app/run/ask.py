"""What a run is asked for and its limits, what it tells while it goes, what it leaves behind."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

from tyro.conf import arg

from app.config import BUNDLED_WEIGHTS
from app.errors import Cancelled, RunError
from app.flags import (
    File,
    Minutes,
    Names,
    Text,
    a_count,
    names_of,
    no,
    one_of,
    some_of,
    written,
)
from app.run.display import Display, check_display
from conventions.names import POST_FILTERS, PostFilter
from conventions.views import CLOSE_UPS, FRAMINGS, LOOKS, VIEWS, CloseUp, Framing, View
from model.formats.read import Assumptions, read_told
from model.speech.transcript import NOTHING_SAID, Transcript
from model.storage.npz import MotionError
from renderer.figures.style import FORMS

if TYPE_CHECKING:
    from model.diagnostics import Diagnostics

WordsAsked = Literal["recognise", "none"]
WORDS_ASKED: tuple[WordsAsked, ...] = get_args(WordsAsked)
SIZES_PX = (256, 1080)
"""Smallest and largest width and height of a picture that a person may ask for."""
TIP = "right_middle"
"""Fingertip that is followed where nobody asks for another point."""
NUM_SECONDS = 6
"""Worst ones that a time line names."""
MAX_SAMPLES = 8
MAX_CLIPS = 10
"""Of a run on the page."""
MAX_STEPS = 1000
MAX_GUIDANCE = 10
MAX_COMPARED = 6
"""More motions than these do not fit into one comparison or figure."""


Stage = Literal["speech", "motion", "numbers", "video", "comparison", "figure"]
STAGES: tuple[Stage, ...] = ("speech", "motion", "numbers", "video", "comparison", "figure")
OF_SYSTEMS: Mapping[str, str] = {
    "steps": "steps",
    "sampler": "sampler",
    "guidance": "strength of the speech",
}
SAMPLING = ("speaker", "seed", "samples", *OF_SYSTEMS)
"""Fields of an ask that say how systems draw; the last, here with their titles, each takes as it
can."""
Steps = int | Mapping[str, int] | None
"""Of all systems or by name; a system that is not named has its usual ones."""


def steps_of(asked: Steps, system: str) -> int | None:
    """Steps that are asked of one system; None is its usual number."""
    return asked.get(system) if isinstance(asked, Mapping) else asked


def parse_steps(written: str) -> int | dict[str, int] | None:
    """Steps as a person writes them: ``20``, or ``globaldiff/full=20,globaldiff/local=5``; None of
    nothing.

    Raises:
        RunError: with one sentence.
    """
    parts = [part.strip() for part in written.split(",") if part.strip()]
    if not parts:
        return None
    try:
        if len(parts) == 1 and "=" not in parts[0]:
            return int(parts[0])
        pairs = [part.rsplit("=", 1) for part in parts]
        return {name.strip(): int(count) for name, count in pairs}
    except ValueError:
        raise RunError(
            f"Steps are a number, or numbers by system such as globaldiff/full=20; got {written!r}."
        ) from None


def check_size(size_px: int) -> None:
    """Refuse a width and height that pictures cannot have.

    Raises:
        RunError: with one sentence.
    """
    smallest, largest = SIZES_PX
    if not smallest <= size_px <= largest or size_px % 2:
        raise RunError(
            f"{size_px} pixels; pictures have {smallest} to {largest} on each side, an even number."
        )


def read_size(written: str) -> int:
    """Raises `RunError` if it is none that pictures can have."""
    if not written.strip().isdecimal():
        raise RunError(f"{written!r} is no number of pixels")
    check_size(int(written))
    return int(written)


def read_channel(written: str) -> int:
    """``left``, ``right`` or a number from 1, as one from 0. Raises `RunError` for all else."""
    sides = {"left": 0, "right": 1}
    if written in sides:
        return sides[written]
    if not written.isdecimal() or not 1 <= int(written) <= 64:
        raise RunError(f"{written!r} is no channel; say left, right, or a number from 1")
    return int(written) - 1


FIGURE_PANELS = {"a": "coordinates", "b": "snapshots", "c": "path in space", "d": "tremble"}
MAX_SNAPSHOTS = 7


def read_frames(written: str) -> tuple[int, ...]:
    """``0,40,80``. Raises `RunError` for what is no frame, and for too many."""
    names = names_of(written)
    if not all(name.isdecimal() for name in names) or not 1 <= len(names) <= MAX_SNAPSHOTS:
        raise RunError(f"{written!r} is not 1 to {MAX_SNAPSHOTS} frames, such as 0,40,80")
    return tuple(sorted({int(name) for name in names}))


def read_assumptions(told: str) -> Assumptions:
    """What the user says of files. Raises `RunError` for what nobody can say."""
    try:
        return read_told(told)
    except MotionError as error:
        raise RunError(str(error)) from error


Assumed = Annotated[
    Assumptions,
    written(read_assumptions, "WHAT=VALUE,...", show=lambda told: "nothing"),
    arg(
        name="assume",
        help="How motion files are to be read where they say too little: up=z,units=cm,rate=25,"
        "hands=mean,rotations=6d-columns,facing=x,motion=2,frames=bridge,lag=.4; NAME:up=z for one "
        "of them.",
    ),
]
Channel = Annotated[int | None, written(read_channel, "left|right|N", "all, mixed")]
CloseUps = Annotated[
    tuple[CloseUp, ...],
    some_of(CLOSE_UPS, "no close-up {name!r}; there are {names}, or off", "V,...|off", "off"),
    arg(name="close-up"),
]
FigureForms = Annotated[
    tuple[str, ...],
    some_of(FORMS, "no form {name!r}; figures are written as {names}", "png,svg,..."),
    arg(name="figures"),
]
FigureFrames = Annotated[
    tuple[int, ...], written(read_frames, "N,...", "every 50 from --start"), arg(name="frames")
]
FigurePanels = Annotated[
    tuple[str, ...],
    some_of(tuple(FIGURE_PANELS), "no panel {name!r}; Figure 6 has {names}", "a,b,..."),
    arg(name="panels"),
]
FigureWidth = Literal["85mm", "174mm"]
Height = Annotated[int, written(read_size, "PX")]
Look = Annotated[str, one_of(LOOKS)]
PerSystem = Annotated[Steps, written(parse_steps, "N|A=N,...", "as each usually takes")]
Views = Annotated[tuple[View, ...], some_of(VIEWS, "no view {name!r}; views are {names}", "V,...")]
Strength = Annotated[float | None, written(float, "N", "as suits each system")]


@dataclass(frozen=True)
class Take:
    """Motion that a live session has made of the speech, to be kept as it was seen."""

    motion: Path
    """As long as the speech."""
    facts: Mapping[str, Any]
    """Of the session, for the record."""
    why_less: str = ""
    """Than was spoken, for who asked for it."""
    plan: Path | None = None
    """That the motion performs, as long as it, of a system that performs plans."""


@dataclass(frozen=True, kw_only=True)
class Ask:
    """What one run is asked for: motion of several systems for some speech, all with the same
    noise, or anyone's motions; either is measured, shown and drawn."""

    out: Path
    """Folder of results."""
    speech: File = None
    """Sound that all motions belong to, for BeatAlign and its chance level; a folder of it for
    folders."""
    motions: tuple[Path, ...] = ()
    """Given; with any, none is generated: .npz (BEAT2, AMASS, SMPL-X parameters), .npy (rotations,
    TalkSHOW) or .bvh; or folders or zips of them, paired by name, for numbers over many clips."""
    names: tuple[str, ...] = ()
    """What to call them; by default as their files."""
    weights: Path = BUNDLED_WEIGHTS
    """Folder of trained systems."""
    systems: Names = ()
    """By name."""
    speaker: Text = None
    """In whose manner."""
    seed: int = 0
    """Seed of the noise. The same speech file, options and seed give the same motion, whether the
    clip is generated alone or among others."""
    samples: int = 1
    """Motions per system."""
    steps: PerSystem = None
    """Sampler steps, of all systems or by name; the body's, where a system draws the face in a
    share of them."""
    sampler: Annotated[str | None, written(str, "NAME", "each its usual one")] = None
    """Of systems that have it; the others take their usual one."""
    guidance: Strength = None
    """Strength of the speech, 0 (deaf) to 10; 1 is as trained, and as the papers' own code draws.
    Of the systems whose it can be chosen (classifier-free guidance)."""
    post_filter: PostFilter = "none"
    """Smooth every system alike; the numbers give both in any case."""
    plan: File = None
    """What systems that plan are to perform, as a run or `plan` leaves it, or as annotated in Praat
    or ELAN: .json, .TextGrid, .eaf; of many pieces of speech a folder of them. Without one, plans
    are drawn from the speech."""
    style: File = None
    """How often, how large, how high, how fast (.toml): done to every plan (docs/plans.md)."""
    take: Take | None = None
    """Motion of the one system that is named, instead of generating it."""
    reference: File = None
    """Recorded motion to compare with."""
    told: Assumed = field(default_factory=Assumptions)
    channel: Channel = None
    """Of the speech the one of several that is heard, such as a side of a dialogue."""
    max_speech_s: Minutes = 600.0
    """Longest speech accepted to move to."""
    max_frames: int | None = None
    """Of all given motions together, at 30 a second."""
    transcript: File = None
    """Words of the speech, for the time line and plans: a TextGrid, words with times (.tsv, .ctm,
    .lab, .json of Whisper or WhisperX), subtitles (.srt, .vtt), or a plain English text (.txt),
    which is looked for in the speech."""
    words: WordsAsked = "none"
    """Recognise English words where there is no transcript; a fifth of the speech's length on one
    core."""
    mean_speeds: File = None
    """EMAGE's mean_vel_smplxflame_30.npy (BEAT2's folder weights): BeatAlign with its published
    speeds of the joints, to be held against papers."""
    emage_weights: File = None
    """Of folders beside --reference: EMAGE's AESKConv_240_100.bin, for FGD as papers on BEAT2 tell
    it (docs/many-clips.md)."""
    window: Annotated[int | None, written(a_count, "N", "every period from 2 to 240 is tried")] = (
        None
    )
    """Frames of the windows that all given motions but the reference were made of, if that is
    known."""
    overlap: int = 0
    """Frames that two such windows share."""
    joint: str = TIP
    """Fingertip or joint to follow, such as left_index or right_wrist."""
    shown: Annotated[Names, arg(name="show")] = ()
    """Which given motions figures and stage show, by the names of their files, where there are more
    than six; by default the first six. All are measured."""
    start_frame: Annotated[int, arg(name="start")] = 0
    """First of the 300 frames of Figure 6."""
    figure_forms: FigureForms = FORMS
    """File formats of all figures."""
    figure_panels: FigurePanels = tuple(FIGURE_PANELS)
    """Of Figure 6: a coordinates, b snapshots, c path in space, d tremble."""
    figure_frames: FigureFrames = ()
    """Of its snapshots."""
    figure_width: Annotated[FigureWidth, arg(name="width")] = "174mm"
    """Of Figure 6 in print."""
    body: File = None
    """Licensed SMPLX_NEUTRAL*.npz; by default $SMPLX_MODEL, else the open body."""
    look: Look = LOOKS[0]
    """Build and tone of the open body; a body of one's own has the first only."""
    views: Views = ("front",)
    """Of videos; the first is compared."""
    close_ups: CloseUps = ("hands",)
    """Face or hands beside the body in the first view's videos, and so in the comparison."""
    framing: Framing = "knees"
    """How much of the body videos show: the whole, or from the knees up and larger."""
    size: Height = 512
    """Height of a body in one video; it is as wide where all of it is shown, and three quarters as
    wide from the knees up. A close-up adds half the width."""
    display: Display = field(default_factory=Display)
    """What the videos show beyond the body as it moves."""
    has_video: Annotated[bool, arg(name="video")] = False
    """A video of each motion."""
    has_poses: Annotated[bool, no("pictures", "No poses in Figure 6.")] = True
    """Poses in Figure 6, where no videos are drawn, too."""
    has_figures: Annotated[bool, no("figures", "Neither Figure 6 nor jitter.")] = True
    """Figure 6 and jitter."""
    title: str = ""
    """What the run is called; by default after what it is made of."""
    is_kept: bool = False
    """Whether each file is there as soon as it is whole, and stays where the run fails; by default
    all are there in the end, or none."""
    opened: Path | None = None
    """Folder of the run that given motions are from, where they are measured anew to be shown."""

    def check(self) -> None:
        """Refuse what needs no file to be seen as wrong.

        Raises:
            RunError: with one sentence.
        """
        for value, allowed, what in (
            (self.post_filter, POST_FILTERS, "post-filter"),
            (self.words, WORDS_ASKED, "way to words"),
            *((view, VIEWS, "view") for view in self.views),
            (self.framing, FRAMINGS, "framing"),
            *((close_up, CLOSE_UPS, "close-up") for close_up in self.close_ups),
        ):
            if value not in allowed:
                names = ", ".join(str(name) for name in allowed if name)
                raise RunError(f"There is no {what} {value!r}; choose one of {names}.")
        if not self.views:
            raise RunError(f"No view is named; choose some of {', '.join(VIEWS)}.")
        if not 1 <= self.samples <= MAX_SAMPLES:
            raise RunError(f"Samples must be 1 to {MAX_SAMPLES}; got {self.samples}.")
        _check_steps(self.steps)
        if self.guidance is not None and not 0 <= self.guidance <= MAX_GUIDANCE:
            raise RunError(f"Guidance must be 0 to {MAX_GUIDANCE}; got {self.guidance:g}.")
        if self.seed < 0:
            raise RunError(f"The seed must not be negative; got {self.seed}.")
        check_display(self.display)
        if self.has_video:
            check_size(self.size)


def _check_steps(asked: Steps) -> None:
    for system, count in asked.items() if isinstance(asked, Mapping) else [("", asked)]:
        if count is not None and not 1 <= count <= MAX_STEPS:
            whose = f"Steps of {system}" if system else "Steps"
            raise RunError(f"{whose} must be 1 to {MAX_STEPS}; got {count}.")


def absolute(ask: Ask) -> Ask:
    """The same for another process, which may be in another folder."""
    named = {name: path for name, path in vars(ask).items() if isinstance(path, Path)}
    return replace(ask, **{name: path.absolute() for name, path in named.items()})


@dataclass(frozen=True)
class Progress:
    """How far one stage is."""

    stage: Stage
    fraction: float
    """0 to 1 of this stage."""
    detail: str = ""
    """What is being worked on, such as a system's name."""
    clip: str = ""
    """Of several, with its number."""


@dataclass(frozen=True)
class Grown:
    """A run's folder holds more than before: its `run.json` says what."""

    folder: Path


Event = Progress | Grown


class Ear:
    """Of whoever asked for a run."""

    def __init__(
        self,
        hear: Callable[[Event], None] = lambda event: None,
        should_cancel: Callable[[], bool] = lambda: False,
    ) -> None:
        """
        Args:
            hear: told of progress, and when the folder holds more.
            should_cancel: asked many times a second.
        """
        self.hear = hear
        self.should_cancel = should_cancel

    def progress(self, stage: Stage, fraction: float, detail: str = "") -> None:
        self.hear(Progress(stage, fraction, detail))

    def share(
        self, stage: Stage, part: float = 1.0, before: float = 0.0
    ) -> Callable[[float], None]:
        """What takes the share done of a part of a stage: it tells of it, or ends the work by
        `Cancelled`."""

        def on_share(share: float) -> None:
            self.stop_if_asked()
            self.progress(stage, before + part * share)

        return on_share

    def stop_if_asked(self) -> None:
        """Between steps that cannot be interrupted themselves.

        Raises:
            Cancelled: if the person asked to stop.
        """
        if self.should_cancel():
            raise Cancelled


DEAF = Ear()


@dataclass(frozen=True)
class Done:
    """What a run left in its folder."""

    out: Path
    diagnostics: Diagnostics
    notes: tuple[str, ...] = ()
    """Sentences the person should read, such as what was done to the speech."""
    said: Transcript = NOTHING_SAID
    """What was said in the speech, where that was given or found."""
