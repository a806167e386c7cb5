"""Display options of the viewer and of videos: trail, jerk as colour, exaggerated jitter.

They are set on the command line or in the viewer. Scales are the same for all videos of a
comparison. User studies use none of them.
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
from conventions.views import BodyBuild, SkinTone
from model.storage.json_validation import InvalidJsonError, parse_json
from renderer.scene.camera import Orbit

Coloring = Literal["natural", "jerk"]
COLORINGS: tuple[Coloring, ...] = get_args(Coloring)
EXAGGERATIONS = (1, 5, 20)
"""Exaggeration factors on the command line; the viewer has a slider."""
FULL_SPEED_M_S = 1.5
"""Speed (m/s) at the end of the trail's colour scale. Recorded speakers' fingertips exceed it in
one frame of fifty."""


def _trail_hint(default: str) -> str:
    """Return what is said in help of ``--trail``, or of ``--no-trail`` where it is the default."""
    return "Shown by default; this flag hides it." if default == "True" else ""


@dataclass(frozen=True)
class Display:
    """Display options of all videos of a comparison."""

    exaggeration: Annotated[float, choice_type(EXAGGERATIONS), arg(name="exaggerate")] = 1.0
    """Amplify motion above 5 Hz by this factor; the picture is labelled accordingly."""
    has_trail: Annotated[bool, arg(name="trail", help_behavior_hint=_trail_hint)] = False
    """Trajectory of the tracked point over the last second in videos, coloured by its speed."""
    coloring: Annotated[Coloring, arg(name="color")] = "natural"
    """Colour of the body: natural, or by the jerk of each body region."""
    cutoff_hz: Suppress[float] = 5.0
    """Frequency (Hz) above which motion counts as jitter."""
    trail_frames: Suppress[int] = 30
    """Length of the trail in frames."""
    max_jerk_m_s3: Suppress[float] = 500.0
    """Jerk (m/s³) at the end of the colour scale; above it, the trail has dots. The jerk of
    recorded speakers' fingertips exceeds the default in one frame of a hundred."""

    @property
    def is_default(self) -> bool:
        return self.exaggeration == 1 and not self.has_trail and self.coloring == "natural"


DISPLAY_LIMITS: Mapping[str, tuple[float, float, str]] = {
    "exaggeration": (1.0, 20.0, "The exaggeration factor must be {}"),
    "cutoff_hz": (3.0, 8.0, "The jitter cutoff frequency must be {} Hz"),
    "trail_frames": (5, 90, "The trail must be {} frames long"),
    "max_jerk_m_s3": (50.0, 2000.0, "The maximum of the jerk colour scale must be {} m/s³"),
}
"""Minimum, maximum and error message of the fields of `Display`; the limits replace its braces. The
viewer has the same limits."""


def check_display(display: Display) -> None:
    """Check display options; raises RunError for values outside of `DISPLAY_LIMITS`."""
    for name, (least, most, refusal) in DISPLAY_LIMITS.items():
        value = getattr(display, name)
        if not least <= value <= most:
            raise RunError(f"{refusal.format(f'from {least:g} to {most:g}')}; got {value:g}.")
    if display.coloring not in COLORINGS:
        raise RunError(
            f"There is no colouring {display.coloring!r}; choose one of {', '.join(COLORINGS)}."
        )


class BrowserMessage(BaseModel):
    """Base of the models that validate JSON from the page's scripts, with names in camel case."""

    model_config = ConfigDict(
        strict=True,
        frozen=True,
        allow_inf_nan=False,
        str_max_length=500,
        alias_generator=to_camel,
        validate_by_name=True,
    )


class ViewerSettings(BrowserMessage):
    """Display options of the viewer (app/page/web/stage/look.js)."""

    exaggeration: float = Field(default=1.0, alias="factor")
    cutoff_hz: float = Field(default=5.0, alias="cutoff")
    has_trail: bool = False
    trail_frames: int = 30
    has_jerk_colors: bool = Field(default=False, alias="hasHeat")
    """True to show jerk as colour."""
    max_jerk_m_s3: float = Field(default=500.0, alias="heatScale")
    tracked_point: str = Field(default="right_middle", alias="point")
    """Tracked point of the trail."""
    is_pair_aligned: bool = Field(default=True, alias="isAligned")
    """True if the second body of a pair is moved onto the first, pelvis on pelvis."""
    shows_whole_body: bool = Field(default=False, alias="isWhole")
    """True to show the whole body, false to show it from the knees up."""
    tone: SkinTone = "light"
    build: BodyBuild = "average"
    """Body shape of the open body; tone and build do not apply to a licensed body."""
    has_bones: bool = False
    has_axes: bool = False
    """True to show joint axes. Videos show neither axes nor skeletons; a note says so."""

    @property
    def display(self) -> Display:
        names = (*DISPLAY_LIMITS, "has_trail")
        coloring: Coloring = "jerk" if self.has_jerk_colors else "natural"
        return Display(coloring=coloring, **{name: getattr(self, name) for name in names})


Mode = Literal["grid", "ghost", "wipe", "flicker"]
MAX_VIDEO_BODIES = 12
"""Maximum number of bodies in one video."""
MAX_BODIES = 64
"""Maximum number of bodies in the viewer, hidden ones included, as cameras frame all of them."""
MAX_LABEL = 60


Four = tuple[float, float, float, float]
Side = Annotated[float, Field(ge=64, le=8192)]
"""Width or height of a picture on the screen (pixels)."""
Color = Annotated[str, Field(pattern="^#[0-9a-fA-F]{6}$")]
Label = Annotated[str, AfterValidator(lambda label: printable(label)[:MAX_LABEL] or "motion")]


class ViewerPanel(BrowserMessage):
    """Rectangle of a picture on the screen (pixels) and its view."""

    rect: Four
    """Left, top, width and height."""
    view: Literal["face", "left_hand", "right_hand"] | None = None
    """View of a close-up; None for the body's panel."""


class ViewerBody(BrowserMessage):
    """One body of the viewer."""

    label: Label
    motion_url: str
    color: Color
    """Colour that identifies the motion on the page."""


class ViewerState(BrowserMessage):
    """State of the viewer: bodies, camera and display options."""

    bodies: Annotated[tuple[ViewerBody, ...], Field(max_length=MAX_BODIES)]
    """All bodies of the viewer, visible or hidden."""
    visible: Annotated[
        tuple[Annotated[int, Field(ge=0)], ...], Field(max_length=MAX_BODIES, alias="shown")
    ]
    """Zero-based indices of the visible bodies, in display order; for a pair, both bodies."""
    picture_size: tuple[Side, Side]
    """Width and height of one body's picture, or of the whole picture of a pair."""
    panels: Annotated[
        tuple[Annotated[tuple[ViewerPanel, ...], Field(max_length=4)], ...], Field(max_length=2)
    ]
    """Panels that all pictures share, or those of each body of a pair; the first shows the body."""
    columns: Annotated[int, Field(ge=1, le=MAX_VIDEO_BODIES)] = 1
    """Number of pictures per row."""
    mode: Mode = "grid"
    """Comparison mode of a pair; ``grid`` shows bodies side by side."""
    wipe: Annotated[float, Field(ge=0, le=1)] = 0.5
    """Fraction of the picture that shows the first body."""
    settings: ViewerSettings = ViewerSettings()
    is_smoothed: bool = False
    """True if the post-filter is applied."""
    camera: tuple[float, float, float, float, float] = (0.0, 0.0, 1.0, 0.0, 0.0)
    """Camera position, with the fields of `Orbit`."""
    sound_url: str | None = None
    has_character: bool = False
    """True if the bodies are drawn as the user's own character."""

    @classmethod
    def parse(cls, message: object) -> ViewerState:
        """Parse and check the state as app/page/web/player/player.js writes it; raises RunError."""
        try:
            state = parse_json(message if isinstance(message, str) else "", cls)
        except InvalidJsonError as error:
            raise RunError(text.VIEWER_VIDEO_DAMAGED.format(why=f"{error}.")) from None
        state.check()
        return state

    def check(self) -> None:
        """Check that the viewer can have this state; raises RunError."""
        if not self.bodies:
            raise RunError("There is no body in the viewer yet. Wait until one is shown.")
        if not 1 <= len(self.visible) <= MAX_VIDEO_BODIES:
            raise RunError(
                f"A video can show 1 to {MAX_VIDEO_BODIES} bodies; the viewer shows "
                f"{len(self.visible)}. Enlarge one body, or compare two."
            )
        is_pair = self.mode != "grid"
        fits = len(self.panels) == 1 + is_pair and not (is_pair and len(self.visible) != 2)
        for picture in self.panels:
            views = [panel.view for panel in picture]
            fits = fits and views[:1] == [None] and len(set(views)) == len(views)
        if not fits or max(self.visible) >= len(self.bodies):
            raise RunError(
                text.VIEWER_VIDEO_DAMAGED.format(why="the displayed views do not match the bodies.")
            )
        for panel in chain(*self.panels):
            left, top, width, height = panel.rect
            inside = (
                min(left, top) >= -1
                and left + width <= self.picture_size[0] + 1
                and top + height <= self.picture_size[1] + 1
                and min(width, height) >= 8
            )
            if not inside:
                raise RunError(
                    f"The {(panel.view or 'body').replace('_', ' ')} does not fit in the picture; "
                    "enlarge the viewer, or hide close-ups."
                )
        check_display(self.settings.display)
        try:
            Orbit(*self.camera).check()
        except ValueError as error:
            raise RunError(str(error)) from error
