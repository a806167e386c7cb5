"""What is shown beyond the body as it moves: a trail, jerk as colour, tremble made large.

A person asks for it, on the command line or by what a stage shows, and videos have it. Scales are
the same for all videos of a comparison. None of it is in a user study.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import chain
from typing import Annotated, Literal, get_args

from pydantic import AfterValidator, BaseModel, ConfigDict, Field
from pydantic.alias_generators import to_camel
from tyro.conf import Suppress, arg

from app import text
from app.errors import RunError
from app.flags import choice_type
from conventions.names import printable
from conventions.views import Build, Tone
from model.storage.checked import FieldError, checked
from renderer.scene.camera import Orbit

Coloring = Literal["natural", "jerk"]
COLORINGS: tuple[Coloring, ...] = get_args(Coloring)
EXAGGERATIONS = (1, 5, 20)
"""What can be asked for on a command line; a stage has a slider."""
FULL_SPEED_M_S = 1.5
"""Recorded speakers' fingertips are faster in one frame of fifty."""


@dataclass(frozen=True)
class Display:
    """How motion is shown, for all videos of a comparison alike."""

    exaggeration: Annotated[float, choice_type(EXAGGERATIONS), arg(name="exaggerate")] = 1.0
    """Draw tremble, all above 5 Hz, so many times as large, and say so in the picture."""
    has_trail: Annotated[bool, arg(name="trail")] = False
    """The way of the followed point through the last second, coloured by its speed."""
    coloring: Annotated[Coloring, arg(name="color")] = "natural"
    """jerk: each region of the body by how much it jerks."""
    cutoff_hz: Suppress[float] = 5.0
    """What is faster is tremble."""
    trail_frames: Suppress[int] = 30
    """How long a trail is."""
    jerk_m_s3: Suppress[float] = 500.0
    """Where the scale of the colours ends, and a trail has a dot. Recorded speakers' fingertips
    jerk more than the usual one in one frame of a hundred."""

    @property
    def is_plain(self) -> bool:
        return self.exaggeration == 1 and not self.has_trail and self.coloring == "natural"


LIMITS: Mapping[str, tuple[float, float, str]] = {
    "exaggeration": (1.0, 20.0, "Tremble can be shown {} times as large"),
    "cutoff_hz": (3.0, 8.0, "Tremble can be what is faster than {} Hz"),
    "trail_frames": (5, 90, "A trail can be {} frames long"),
    "jerk_m_s3": (50.0, 2000.0, "The scale of jerk can end at {} m/s³"),
}
"""By the field of `Display` the least, the most, and what is said of a value beyond them, which go
between its braces; the stage has the same."""


def check_display(display: Display) -> None:
    """Refuse what cannot be shown.

    Raises:
        RunError: with one sentence.
    """
    for name, (least, most, refusal) in LIMITS.items():
        value = getattr(display, name)
        if not least <= value <= most:
            raise RunError(f"{refusal.format(f'{least:g} to {most:g}')}; got {value:g}.")
    if display.coloring not in COLORINGS:
        raise RunError(
            f"There is no colouring {display.coloring!r}; choose one of {', '.join(COLORINGS)}."
        )


class FromBrowser(BaseModel):
    """What a browser tells, by the names that its scripts have."""

    model_config = ConfigDict(
        strict=True,
        frozen=True,
        allow_inf_nan=False,
        str_max_length=500,
        alias_generator=to_camel,
        validate_by_name=True,
    )


class Look(FromBrowser):
    """How a stage shows bodies (app/page/web/stage/look.js)."""

    exaggeration: float = Field(default=1.0, alias="factor")
    cutoff_hz: float = Field(default=5.0, alias="cutoff")
    has_trail: bool = False
    trail_frames: int = 30
    has_heat: bool = False
    jerk_m_s3: float = Field(default=500.0, alias="heatScale")
    point: str = "right_middle"
    """Of the trail."""
    is_aligned: bool = True
    """Whether the second of a pair stands where the first does, pelvis on pelvis."""
    is_whole: bool = False
    """All of the body rather than from the knees up."""
    tone: Tone = "light"
    build: Build = "average"
    """Of the open body alone, as the tone."""
    has_bones: bool = False
    has_axes: bool = False
    """Skeletons and axes lie over the bodies; a video has none, and says so."""

    @property
    def display(self) -> Display:
        names = (*LIMITS, "has_trail")
        coloring: Coloring = "jerk" if self.has_heat else "natural"
        return Display(coloring=coloring, **{name: getattr(self, name) for name in names})


Mode = Literal["grid", "ghost", "wipe", "flicker"]
MAX_SHOWN = 12
"""Bodies in one video."""
MAX_BODIES = 64
"""On a stage, whether they are shown or not: all of them say where the cameras stand."""
MAX_LABEL = 60


Four = tuple[float, float, float, float]
Side = Annotated[float, Field(ge=64, le=8192)]
"""Of a picture on a screen, in its pixels."""
Color = Annotated[str, Field(pattern="^#[0-9a-fA-F]{6}$")]
Label = Annotated[str, AfterValidator(lambda label: printable(label)[:MAX_LABEL] or "motion")]


class SeenPanel(FromBrowser):
    """A rectangle of a picture on a screen, in its pixels, and what is seen in it."""

    rect: Four
    """Left, top, width, height."""
    view: Literal["face", "left_hand", "right_hand"] | None = None
    """Of a close-up; None is the body."""


class SeenBody(FromBrowser):
    """One of a stage's bodies."""

    label: Label
    motion: str
    """Its address."""
    color: Color
    """Of its row."""


class Seen(FromBrowser):
    """Which bodies a stage shows, how, and from where."""

    bodies: Annotated[tuple[SeenBody, ...], Field(max_length=MAX_BODIES)]
    """All that are on it."""
    shown: Annotated[tuple[Annotated[int, Field(ge=0)], ...], Field(max_length=MAX_BODIES)]
    """Numbers of the bodies from 0 on, in their order; the two of a pair."""
    size: tuple[Side, Side]
    """Width and height of one body's picture; of a pair, of the whole."""
    panels: Annotated[
        tuple[Annotated[tuple[SeenPanel, ...], Field(max_length=4)], ...], Field(max_length=2)
    ]
    """Of all pictures alike; of a pair those of each. The body's comes first."""
    columns: Annotated[int, Field(ge=1, le=MAX_SHOWN)] = 1
    """Pictures in a row."""
    mode: Mode = "grid"
    """How two lie over each other; ``grid`` is beside."""
    wipe: Annotated[float, Field(ge=0, le=1)] = 0.5
    """Share of the body's picture that shows the first."""
    look: Look = Look()
    is_smoothed: bool = False
    """Behind the post-filter."""
    camera: tuple[float, float, float, float, float] = (0.0, 0.0, 1.0, 0.0, 0.0)
    """As `Orbit` has it."""
    sound: str | None = None
    """Its address."""

    @classmethod
    def read(cls, told: object) -> Seen:
        """
        Args:
            told: JSON, as app/page/web/player/player.js writes it.

        Raises:
            RunError: if it is anything else, or what no stage shows.
        """
        try:
            seen = checked(told if isinstance(told, str) else "", cls)
        except FieldError as error:
            raise RunError(text.SEEN_DAMAGED.format(why=f"{error}.")) from None
        seen.check()
        return seen

    def check(self) -> None:
        """Refuse what no stage shows.

        Raises:
            RunError: with one sentence.
        """
        if not self.bodies:
            raise RunError("There is no body on the stage yet; wait until one moves.")
        if not 1 <= len(self.shown) <= MAX_SHOWN:
            raise RunError(
                f"A video shows 1 to {MAX_SHOWN} bodies; the stage shows {len(self.shown)}: "
                "enlarge one, or compare two."
            )
        is_pair = self.mode != "grid"
        fits = len(self.panels) == 1 + is_pair and not (is_pair and len(self.shown) != 2)
        for picture in self.panels:
            views = [panel.view for panel in picture]
            fits = fits and views[:1] == [None] and len(set(views)) == len(views)
        if not fits or max(self.shown) >= len(self.bodies):
            raise RunError(text.SEEN_DAMAGED.format(why="its pictures are not of its bodies."))
        for panel in chain(*self.panels):
            left, top, width, height = panel.rect
            inside = (
                min(left, top) >= -1
                and left + width <= self.size[0] + 1
                and top + height <= self.size[1] + 1
                and min(width, height) >= 8
            )
            if not inside:
                raise RunError(
                    f"The {(panel.view or 'body').replace('_', ' ')} has no room on the stage; "
                    "make its window larger, or leave out close-ups."
                )
        check_display(self.look.display)
        try:
            Orbit(*self.camera).check()
        except ValueError as error:
            raise RunError(str(error)) from error
