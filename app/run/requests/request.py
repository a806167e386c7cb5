"""What a run is asked for and its limits, what it tells while it goes, what it leaves behind."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar, get_args

from app.config import default_body
from app.errors import RunError
from app.flags import OUT_FOLDER, SEED, SPEAKER, WEIGHTS, flag, flags_of, names_of
from app.run.requests.display import Display, check_display
from conventions.names import POST_FILTERS, PostFilter
from conventions.views import CLOSE_UPS, FRAMINGS, LOOKS, VIEWS, CloseUp, Framing, View
from model.formats.reading import Told, read_told
from model.speech.transcript import NOTHING_SAID, Transcript
from model.storage.npz import MotionError

if TYPE_CHECKING:
    from model.diagnostics import Diagnostics

T = TypeVar("T")
WordsAsked = Literal["recognise", "none"]
WORDS_ASKED: tuple[WordsAsked, ...] = get_args(WordsAsked)
SIZES_PX = (256, 1080)
"""Smallest and largest width and height of a picture that a person may ask for."""
MAX_SAMPLES = 8
MAX_STEPS = 1000
MAX_GUIDANCE = 10
MAX_COMPARED = 6
"""More motions than these do not fit into one comparison or figure."""


Stage = Literal["speech", "motion", "numbers", "video", "comparison", "figure"]
STAGES: tuple[Stage, ...] = ("speech", "motion", "numbers", "video", "comparison", "figure")
ArtefactKind = Literal[
    "motion",
    "speech",
    "timeline",
    "plan",
    "video",
    "poster",
    "comparison",
    "figure",
    "diagnostics",
    "provenance",
    "numbers",
]


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


def read_views(written: str) -> tuple[View, ...]:
    """``front,side``; each once. Raises `RunError` if there is none of the name."""
    known: dict[str, View] = {view: view for view in VIEWS}
    return _known(written, known, "no view {name!r}; views are {names}")


def read_close_ups(written: str) -> tuple[CloseUp, ...]:
    """``face,hands`` or ``off``. Raises `RunError` if there is none of the name."""
    known: dict[str, CloseUp] = {close_up: close_up for close_up in CLOSE_UPS}
    asked = () if written == "off" else written
    return _known(asked, known, "no close-up {name!r}; there are {names}, or off") if asked else ()


def _known(written: str, known: Mapping[str, T], refusal: str) -> tuple[T, ...]:
    names = names_of(written)
    for name in names:
        if name not in known:
            raise RunError(refusal.format(name=name, names=", ".join(known)))
    return tuple(known[name] for name in dict.fromkeys(names))


def read_channel(written: str) -> int:
    """``left``, ``right`` or a number from 1, as one from 0. Raises `RunError` for all else."""
    sides = {"left": 0, "right": 1}
    if written in sides:
        return sides[written]
    if not written.isdecimal() or not 1 <= int(written) <= 64:
        raise RunError(f"{written!r} is no channel; say left, right, or a number from 1")
    return int(written) - 1


FIGURE_PANELS = ("a", "b", "c", "d")
MAX_SNAPSHOTS = 7


def read_panels(written: str) -> tuple[str, ...]:
    """``a,b,d``. Raises `RunError` if there is none of the name."""
    known = {panel: panel for panel in FIGURE_PANELS}
    return _known(written, known, "no panel {name!r}; Figure 6 has {names}")


def read_frames(written: str) -> tuple[int, ...]:
    """``0,40,80``. Raises `RunError` for what is no frame, and for too many."""
    names = names_of(written)
    if not all(name.isdecimal() for name in names) or not 1 <= len(names) <= MAX_SNAPSHOTS:
        raise RunError(f"{written!r} is not 1 to {MAX_SNAPSHOTS} frames, such as 0,40,80")
    return tuple(sorted({int(name) for name in names}))


@dataclass(frozen=True)
class FigureAsked:
    """What Figure 6 shows, and how wide it is printed."""

    panels: tuple[str, ...] = field(
        default=FIGURE_PANELS,
        metadata=flag(
            "panels of Figure 6: a coordinates, b snapshots, c path in space, d tremble (default: "
            "all)",
            "a,b,...",
            read_panels,
        ),
    )
    frames: tuple[int, ...] = field(
        default=(),
        metadata=flag(
            "its snapshots (default: every 50 frames from --start)", "N,...", read_frames
        ),
    )
    width: str = field(
        default="174mm",
        metadata=flag("its width in print (default: %(default)s)", choices=("85mm", "174mm")),
    )

    @property
    def width_mm(self) -> float:
        return float(self.width.removesuffix("mm"))


TRANSCRIPT = flag(
    "what is said: a TextGrid, or a plain English text (.txt), which is looked for in the speech",
    "FILE",
    Path,
)
WORDS = flag(
    "recognise English words where there is no transcript; a fifth of the speech's length on one "
    "core (default: %(default)s)",
    choices=WORDS_ASKED,
)
CHANNEL = flag(
    "the one of several channels that is heard, such as a side of a dialogue (default: all, mixed)",
    "left|right|N",
    read_channel,
)
JOINT = flag(
    "fingertip or joint to follow, such as left_index or right_wrist (default: %(default)s)", "NAME"
)
START = flag("first frame of Figure 6 (default: %(default)s)", "FRAME", int, "--start")
STYLE = flag(
    "how often, how large, how high, how fast: done to every plan (docs/plans.md)",
    "FILE.toml",
    Path,
)
REFERENCE = flag("recorded motion to compare with", "MOTION", Path)


def read_assumptions(written: str) -> Told:
    """What the user says of files. Raises `RunError` for what nobody can say."""
    try:
        return read_told(written)
    except MotionError as error:
        raise RunError(str(error)) from error


ASSUME = flag(
    "how files are to be read where they say too little: up=z,units=cm,rate=25,hands=mean,"
    "rotations=6d-columns,facing=x,motion=2,frames=bridge,lag=.4; NAME:up=z for one of them",
    "WHAT=VALUE,...",
    read_assumptions,
    "--assume",
)
BODY = flag(
    "licensed SMPLX_NEUTRAL*.npz (default: $SMPLX_MODEL, else the open body)",
    "FILE",
    Path,
    usual=default_body,
)
LOOK = flag(
    "of the open body: average, slender or broad, in light, medium, dark or clay "
    "(default: %(default)s)",
    "BUILD-TONE",
    choices=LOOKS,
)
FRAMING = flag(
    "the whole body, or from the knees up and larger (default: %(default)s)", choices=FRAMINGS
)


def close_up_flag(usual: str) -> Mapping[str, Any]:
    """Which close-ups videos have beside the body, by default the ``usual`` ones."""
    return flag(
        f"of {', '.join(CLOSE_UPS)}: beside the body in the first view's video (default: {usual})",
        "V,...|off",
        read_close_ups,
        "--close-up",
    )


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


@dataclass(frozen=True)
class GenerateRequest:
    """One run: speech in, motion of several systems out, all with the same noise."""

    speech: Path = field(
        metadata=flag(
            "any sound file; or many: a folder of them, or a .txt with one path a line",
            "SPEECH",
            Path,
            is_positional=True,
        )
    )
    out: Path = field(metadata=OUT_FOLDER)
    weights: Path = field(metadata=WEIGHTS)
    systems: tuple[str, ...] = field(
        default=(), metadata=flag("default: all", "A,B,...|all", names_of)
    )
    """Names of the systems; empty means all there are."""
    speaker: str | None = field(default=None, metadata=SPEAKER)
    """None is the first speaker that the systems know."""
    seed: int = field(default=0, metadata=SEED)
    samples: int = field(
        default=1, metadata=flag("motions per system (default: %(default)s)", "N", int)
    )
    steps: Steps = field(
        default=None,
        metadata=flag(
            "sampler steps, of all systems or by name (default: what each usually takes)",
            "N|A=N,...",
            parse_steps,
        ),
    )
    """Sampler steps; the body's, where a system draws the face by steps of its own."""
    face_steps: Steps = field(
        default=None,
        metadata=flag(
            "of systems that draw the face by steps of its own (default: the usual share)",
            "N|A=N,...",
            parse_steps,
        ),
    )
    """Of the systems that draw the face by steps of its own; the others have none."""
    sampler: str | None = field(
        default=None, metadata=flag("of systems that have it (default: each its usual one)", "NAME")
    )
    """Of the systems that have it; the others, and all for None, take their usual one."""
    guidance: float | None = field(
        default=None,
        metadata=flag(
            "strength of the speech, 0 to 10; 1 is as trained, and as the papers' own code draws "
            "(default: as suits each system)",
            "N",
            float,
        ),
    )
    """Strength of the speech, 0 (deaf) to 10 (classifier-free guidance), of the systems whose it
    can be chosen; 1 is as trained, None as suits each."""
    post_filter: PostFilter = field(
        default="none",
        metadata=flag(
            "smooth every system alike; the numbers give both in any case (default: %(default)s)",
            choices=POST_FILTERS,
        ),
    )
    channel: int | None = field(default=None, metadata=CHANNEL)
    """Of the speech, from 0; None mixes all."""
    transcript: Path | None = field(default=None, metadata=TRANSCRIPT)
    """A TextGrid of the speech, or a plain text (.txt) of it, whose words are looked for in it; the
    words go to the numbers."""
    words: WordsAsked = field(default="none", metadata=WORDS)
    """Whether words are recognised where there is no transcript: ``recognise`` or ``none``."""
    plan: Path | None = field(
        default=None,
        metadata=flag(
            "what systems that plan are to perform, as a run or `plan` leaves it, or as annotated "
            "in Praat or ELAN: .json, .TextGrid, .eaf; of many pieces a folder of them (default: "
            "drawn from the speech)",
            "FILE",
            Path,
        ),
    )
    """What the systems that perform plans are to perform (`model.plan.files`); None lets
    them draw plans from the speech. Of many pieces of speech, a folder with a plan for each."""
    style: Path | None = field(default=None, metadata=STYLE)
    """A style file (`model.plan.style`), done to every plan that is performed."""
    joint: str = field(default="right_middle", metadata=JOINT)
    """The fingertip or joint that figure and tip measures follow; see
    `app.run.followed_point`."""
    start_frame: int = field(default=0, metadata=START)
    """First of the 300 frames of Figure 6."""
    figure: FigureAsked = field(default_factory=FigureAsked, metadata=flags_of(FigureAsked))
    reference: Path | None = field(default=None, metadata=REFERENCE)
    """A motion file of the same speech, shown and measured beside the systems."""
    told: Told = field(default=Told(), metadata=ASSUME)
    """How that file is to be read."""
    body: Path | None = field(default=None, metadata=BODY)
    """A licensed SMPL-X npz; None is the open body."""
    look: str = field(default=LOOKS[0], metadata=LOOK)
    """One of `LOOKS`; a body of one's own has the first only."""
    views: tuple[View, ...] = field(
        default=("front",),
        metadata=flag(
            f"of {', '.join(VIEWS)}; the first is compared (default: front)", "V,...", read_views
        ),
    )
    close_ups: tuple[CloseUp, ...] = field(default=("hands",), metadata=close_up_flag("hands"))
    """What stands in the videos of the first view, and so in the comparison, beside the body."""
    framing: Framing = field(default="knees", metadata=FRAMING)
    """How much of the body videos show."""
    size: int = field(
        default=512, metadata=flag("height of a body (default: %(default)s)", "PX", read_size)
    )
    """Height of the body in one video in pixels; it is as wide where all of it is shown, and three
    quarters as wide from the knees up. A close-up adds half the width."""
    display: Display = field(default_factory=Display, metadata=flags_of(Display))
    """What the videos show beyond the body as it moves."""
    has_video: bool = field(default=True, metadata=flag("no videos", name="--no-video"))
    has_poses: bool = True
    """Whether Figure 6 shows poses where no videos are drawn, too."""
    has_figures: bool = field(
        default=True, metadata=flag("neither Figure 6 nor jitter", name="--no-figures")
    )
    max_speech_s: float = field(
        default=600.0,
        metadata=flag(
            "longest speech accepted (default: 10)",
            "N",
            lambda minutes: 60 * float(minutes),
            "--max-minutes",
        ),
    )
    take: Take | None = None
    """Motion of the one system that is named, instead of generating it."""
    is_kept: bool = False
    """Whether each file is there as soon as it is whole, and stays where the run fails; by default
    all are there in the end, or none."""


def check_request(request: GenerateRequest) -> None:
    """Refuse what needs no file to be seen as wrong.

    Raises:
        RunError: with one sentence.
    """
    for value, allowed, what in (
        (request.post_filter, POST_FILTERS, "post-filter"),
        (request.words, WORDS_ASKED, "way to words"),
        *((view, VIEWS, "view") for view in request.views),
        (request.framing, FRAMINGS, "framing"),
        *((close_up, CLOSE_UPS, "close-up") for close_up in request.close_ups),
    ):
        if value not in allowed:
            names = ", ".join(str(name) for name in allowed if name)
            raise RunError(f"There is no {what} {value!r}; choose one of {names}.")
    if not request.views:
        raise RunError(f"No view is named; choose some of {', '.join(VIEWS)}.")
    if not 1 <= request.samples <= MAX_SAMPLES:
        raise RunError(f"Samples must be 1 to {MAX_SAMPLES}; got {request.samples}.")
    _check_steps("Steps", request.steps)
    _check_steps("Face steps", request.face_steps)
    if request.guidance is not None and not 0 <= request.guidance <= MAX_GUIDANCE:
        raise RunError(f"Guidance must be 0 to {MAX_GUIDANCE}; got {request.guidance:g}.")
    if request.seed < 0:
        raise RunError(f"The seed must not be negative; got {request.seed}.")
    check_display(request.display)
    if request.has_video:
        check_size(request.size)


def _check_steps(what: str, asked: Steps) -> None:
    for system, count in asked.items() if isinstance(asked, Mapping) else [("", asked)]:
        if count is not None and not 1 <= count <= MAX_STEPS:
            whose = f"{what} of {system}" if system else what
            raise RunError(f"{whose} must be 1 to {MAX_STEPS}; got {count}.")


@dataclass(frozen=True)
class Progress:
    """How far one stage is."""

    stage: Stage
    fraction: float
    """0 to 1 of this stage."""
    detail: str = ""
    """What is being worked on, such as a system's name."""


@dataclass(frozen=True)
class Artefact:
    """A file that is whole and may be looked at."""

    kind: ArtefactKind
    name: str
    """The system and sample it belongs to, or the file's own name."""
    path: Path
    """Where it lies now; ``path.name`` is its final name."""


@dataclass(frozen=True)
class Grown:
    """A run's folder holds more than before: its `run.json` says what."""

    folder: Path


Event = Progress | Artefact | Grown
OnEvent = Callable[[Event], None]
ShouldCancel = Callable[[], bool]


@dataclass(frozen=True)
class GenerateResult:
    """What a run left in its folder."""

    out: Path
    files: tuple[Path, ...]
    """Every file written, in the order in which it was made."""
    names: tuple[str, ...]
    """Rows of the comparison: systems with their samples, the reference last."""
    num_frames: int
    diagnostics: Diagnostics
    notes: tuple[str, ...] = field(default=())
    """Sentences the person should read, such as what was done to the speech."""
    said: Transcript = NOTHING_SAID
    """What was said in the speech, where that was given or found."""
