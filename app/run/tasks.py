"""What a worker does: what each task is asked for, what comes of it, and by which
function. A task is known by its name, so that a process that only asks for it imports nothing."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, Literal

from tyro.conf import arg

from app.errors import RunError
from app.flags import File, a_count, written
from app.run.ask import MAX_STEPS, Ask, CloseUps, Ear, Height
from app.run.display import Seen
from conventions.names import file_stem
from conventions.views import Framing
from model.storage.cards import two_speakers
from model.systems.registry import list_systems
from renderer.figures.style import MAX_SYSTEMS


@dataclass(frozen=True)
class Task:
    """A function of a module, which is imported where it is called."""

    module: str
    name: str

    @property
    def __name__(self) -> str:
        return self.name

    def __call__(self, request: Any, ear: Ear) -> Any:
        return getattr(import_module(self.module), self.name)(request, ear)


DRAW_FIGURE = Task("app.run.run_writer", "draw_figure")
DRAW_BEHIND = Task("app.run.videos.videos", "draw_behind")
DRAW_SEEN = Task("app.run.videos.seen_video", "draw_seen")
MAKE_TAKE = Task("app.run.takes.take", "make_take")
MEASURE_HEARING = Task("app.run.experiments", "measure_hearing")
MEASURE_SETS = Task("app.run.many.motions", "measure_sets")
MEASURE_STEPS = Task("app.run.experiments", "measure_step_curve")
RUN = Task("app.run.pipeline", "do")
RENDER = Task("app.run.videos.export", "render_motion")
SHOW_MECHANISM = Task("app.run.experiments", "show_mechanism")
WRITE_PLAN = Task("app.run.videos.export", "write_plan")


@dataclass(frozen=True, kw_only=True)
class SeenAsk(Ask):
    """A video of a stage, whose bodies move by the motions, in their order."""

    seen: Seen


@dataclass(frozen=True)
class SeenVideo:
    """What came of it."""

    path: Path
    num_frames: int
    notes: tuple[str, ...] = ()
    """What the person should know of it."""


Background = Literal["studio", "transparent"]
MAX_STILLS = 64
MARKERS_ENDING = ".markers.csv"
"""Of the table beside a BVH file."""
SHEET_POSES = 8
"""Poses on a sheet where nothing else is asked for."""
ENDINGS = (".mp4", ".png", ".glb", ".bvh", ".blender.npz", ".obj", ".ply")


@dataclass(frozen=True, kw_only=True)
class RenderAsk(Ask):
    """What is to be drawn of one motion file, the only one of its motions; ``out`` is a file whose
    ending says what is made: .mp4, .png, .glb, .bvh, .blender.npz, .obj, .ply."""

    out: Path
    """File whose ending says what is made: .mp4, .png, .glb, .bvh, .blender.npz, .obj, .ply."""
    speech: File = None
    """Sound of the video."""
    close_ups: CloseUps = ()
    """Face or hands beside the body, in the videos and pictures of the first view, whose files are
    called as --out; the others' have the view in their name."""
    framing: Framing = "whole"
    """The whole body, or from the knees up and larger."""
    size: Height = 720
    """Width and height of the body's picture."""
    plan: File = None
    """Whose events .glb, .bvh (in a .markers.csv beside it) and .blender.npz carry as markers; by
    default the .plan.json that a run has left beside the motion, if there is one."""
    num_stills: Annotated[int | None, written(int, "N", "none"), arg(name="stills")] = None
    """So many single pictures as .png, evenly spread over the motion."""
    sheet_every: Annotated[int | None, written(int, "N", "none"), arg(name="sheet")] = None
    """One picture with every so-many-th frame above its time, as .png."""
    frame: int = 0
    """Which a .obj or .ply holds, counted from 0."""
    background: Background = "studio"
    """transparent: the body alone, in a .png."""

    @property
    def ending(self) -> str:
        """Raises `RunError` if it is not one of `ENDINGS`."""
        name = self.out.name.lower()
        for ending in ENDINGS:
            if name.endswith(ending) and name != ending:
                return ending
        raise RunError(f"{self.out.name} must end in one of {', '.join(ENDINGS)}.")

    @property
    def is_picture(self) -> bool:
        return self.ending in (".mp4", ".png")

    def check(self) -> None:
        """
        Raises:
            RunError: for what cannot be drawn.
        """
        super().check()
        if len(self.motions) != 1:
            raise RunError(f"One motion is drawn; got {len(self.motions)}.")
        is_lone = self.background == "transparent"
        if not self.is_picture and not self.display.is_plain:
            raise RunError(
                f"A {self.ending} file holds the motion as it is; trails, colours and exaggeration "
                "are for a .png or .mp4."
            )
        if not self.out.parent.is_dir():
            raise RunError(f"The folder {self.out.parent} does not exist; create it first.")
        if self.num_stills is not None and not 1 <= self.num_stills <= MAX_STILLS:
            raise RunError(f"Stills must be 1 to {MAX_STILLS}; got {self.num_stills}.")
        if self.sheet_every is not None and self.sheet_every < 1:
            raise RunError(f"A sheet shows every frame or fewer; got one in {self.sheet_every}.")
        if not self.is_picture and (self.num_stills or self.sheet_every):
            raise RunError(
                f"A {self.ending} file holds no pictures; write stills to a .png or .mp4."
            )
        if is_lone and self.ending != ".png":
            raise RunError(
                f"A {self.ending} file cannot have a transparent background; write a .png."
            )
        if is_lone and not self.display.is_plain:
            raise RunError("Trails, colours and exaggeration are shown in the studio only.")
        if is_lone and self.close_ups:
            raise RunError("Close-ups are shown in the studio only; leave the background out.")
        if self.speech is not None and not self.speech.is_file():
            raise RunError(f"There is no speech file at {self.speech}.")


MAX_SPEECHES, MAX_SEEDS = 8, 8


TwoSpeakers = Annotated[
    tuple[str, str] | None, written(two_speakers, "CALM,LIVELY", "none", ",".join)
]


@dataclass(frozen=True, kw_only=True)
class HearingAsk(Ask):
    """A run of which speech and noise vary."""

    speeches: tuple[Path, ...]
    """Two sound files or more; or one folder of anyone's motions, whose files are called
    ``[SYSTEM__]SPEECH__SEED.npz``."""
    seeds: int = 2
    """Of the noise, from 0 on."""
    speakers: TwoSpeakers = None
    """Two whose manner is compared on the first speech, too, such as hana,june."""

    @property
    def is_of_motions(self) -> bool:
        return len(self.speeches) == 1 and self.speeches[0].is_dir()

    def check(self) -> None:
        """
        Raises:
            RunError: for what cannot be compared.
        """
        super().check()
        if self.is_of_motions:
            if self.speakers:
                raise RunError("A folder of motions tells no speakers.")
            return
        if not 2 <= len(self.speeches) <= MAX_SPEECHES:
            raise RunError(
                f"Two to {MAX_SPEECHES} speeches are compared; got {len(self.speeches)}."
            )
        if len({file_stem(path.stem) for path in self.speeches}) < len(self.speeches):
            raise RunError("Two of the speeches have one name; rename one of the files.")
        if not 2 <= self.seeds <= MAX_SEEDS:
            raise RunError(f"Noise seeds must be 2 to {MAX_SEEDS}; got {self.seeds}.")
        _check_count(self)


NOISE_RAD = (0.005, 0.1)
"""Least and most noise that may be asked for."""
VIDEO = "mechanism.mp4"


@dataclass(frozen=True, kw_only=True)
class MechanismAsk(Ask):
    """Equal noise on one motion."""

    noise_rad: Annotated[float, arg(name="noise", metavar="RAD")] = 0.02
    """Deviation of the random turns about each axis, .005 to .1."""

    def check(self) -> None:
        """
        Raises:
            RunError: for what cannot be shown.
        """
        super().check()
        least, most = NOISE_RAD
        if not least <= self.noise_rad <= most:
            raise RunError(f"Noise must be {least:g} to {most:g} rad; got {self.noise_rad:g}.")
        if len(self.motions) != 1:
            raise RunError(f"One motion is shown; got {len(self.motions)}.")
        if self.out.suffix.lower() == ".mp4":
            raise RunError(f"--out is a folder, in which the video is called {VIDEO}.")


COUNTS = (1, 2, 4, 8, 25)
"""Steps that are tried; motion with the most of them is what the others are held against."""


def _counts(told: str) -> tuple[int, ...]:
    return tuple(map(a_count, told.split(",")))


@dataclass(frozen=True, kw_only=True)
class StepsAsk(Ask):
    """A run of which the steps vary."""

    counts: Annotated[
        tuple[int, ...],
        written(_counts, "N,N,...", show=lambda counts: ",".join(map(str, counts))),
        arg(name="steps"),
    ] = COUNTS
    """Numbers of steps."""

    def check(self) -> None:
        """
        Raises:
            RunError: for what cannot be measured.
        """
        super().check()
        if not self.counts or not all(1 <= count <= MAX_STEPS for count in self.counts):
            raise RunError(
                f"Steps must be whole numbers from 1 to {MAX_STEPS}; got "
                f"{', '.join(map(str, self.counts)) or 'none'}."
            )
        _check_count(self)


def systems_of(ask: Ask) -> tuple[str, ...]:
    """Return the systems by name: those that are asked for, or all."""
    return tuple(dict.fromkeys(ask.systems)) or list_systems(ask.weights)


def _check_count(ask: Ask) -> None:
    systems = systems_of(ask)
    if not 1 <= len(systems) <= MAX_SYSTEMS:
        raise RunError(
            f"One to {MAX_SYSTEMS} systems are compared at once; got {len(systems)}"
            f"{': ' if systems else ''}{', '.join(systems)}."
        )


@dataclass(frozen=True)
class Sets:
    """What was written, found, and must be said."""

    ask: Ask
    files: tuple[Path, ...]
    notes: tuple[str, ...]
    told: dict[str, Any]
    """What `app.run.many.table.write_tables` leaves in ``many.json``."""
    clips: dict[str, dict[str, Path]]
    """By system, and the reference, the motion file of each clip that is in the tables."""
    sounds: dict[str, Path]
    """Of those clips that have one."""
