"""What a stage shows, as it is asked for when a video of it is to be made."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, get_args

from app.errors import RunError
from app.run.followed_point import TIP
from app.run.requests.display import Display, check_display
from conventions.views import BUILDS, TONES
from renderer.scene.orbit import Orbit

Mode = Literal["grid", "ghost", "wipe", "flicker"]
MODES: tuple[Mode, ...] = get_args(Mode)
MAX_SHOWN = 12
"""Bodies in one video."""
MAX_BODIES = 64
"""On a stage, whether they are shown or not: all of them say where the cameras stand."""
SIDES_PX = (64.0, 8192.0)
"""Of a picture on a screen."""
BODY = "body"


@dataclass(frozen=True)
class SeenPanel:
    """A rectangle of a picture on a screen, in its pixels, and what is seen in it."""

    view: str
    """`BODY`, or a view of a close-up."""
    left: float
    top: float
    width: float
    height: float


@dataclass(frozen=True)
class Seen:
    """Which bodies a stage shows, how, and from where."""

    shown: tuple[int, ...]
    """Numbers of the bodies from 0 on, in their order; the two of a pair."""
    size: tuple[float, float]
    """Width and height of one body's picture; of a pair, of the whole."""
    panels: tuple[tuple[SeenPanel, ...], ...]
    """Of all pictures alike; of a pair those of each. The body's comes first."""
    columns: int = 1
    """Pictures in a row."""
    mode: Mode = "grid"
    """How two lie over each other; ``grid`` is beside."""
    is_aligned: bool = True
    """Whether the second of a pair stands where the first does, pelvis on pelvis."""
    wipe: float = 0.5
    """Share of the body's picture that shows the first."""
    display: Display = field(default_factory=Display)
    point: str = TIP
    """Of the trail."""
    is_smoothed: bool = False
    """Behind the post-filter."""
    is_whole: bool = False
    """All of the body rather than from the knees up."""
    tone: str = "light"
    """One of `TONES`; of the open body alone."""
    build: str = "average"
    """One of `renderer.body.look.BUILDS`; of the open body alone."""
    has_lines: bool = False
    """Whether skeletons or axes lie over the bodies; a video has none, and says so."""
    camera: Orbit = field(default_factory=Orbit)

    def check(self, num_bodies: int) -> None:
        """Refuse what no stage shows.

        Raises:
            RunError: with one sentence.
        """
        if not num_bodies:
            raise RunError("There is no body on the stage yet; wait until one moves.")
        if num_bodies > MAX_BODIES:
            raise RunError(f"A stage has at most {MAX_BODIES} bodies; {num_bodies} were told of.")
        if self.mode not in MODES:
            raise RunError(
                f"There is no way {self.mode!r} to compare; choose one of {', '.join(MODES)}."
            )
        is_pair = self.mode != "grid"
        if is_pair and len(self.shown) != 2:
            raise RunError(f"A {self.mode} shows two bodies; {len(self.shown)} were told of.")
        if not 1 <= len(self.shown) <= MAX_SHOWN:
            raise RunError(
                f"A video shows 1 to {MAX_SHOWN} bodies; the stage shows {len(self.shown)}: "
                "enlarge one, or compare two."
            )
        if not all(0 <= number < num_bodies for number in self.shown):
            raise RunError(f"The stage has bodies 0 to {num_bodies - 1}; got {list(self.shown)}.")
        if not 1 <= self.columns <= MAX_SHOWN:
            raise RunError(f"A row holds 1 to {MAX_SHOWN} bodies; got {self.columns}.")
        if not 0 <= self.wipe <= 1:
            raise RunError(f"A wipe stands at 0 to 1 of the picture; got {self.wipe:g}.")
        for kind, name, known in (("tone", self.tone, TONES), ("build", self.build, BUILDS)):
            if name not in known:
                raise RunError(f"There is no {kind} {name!r}; choose one of {', '.join(known)}.")
        self._check_room(is_pair)
        check_display(self.display)
        try:
            self.camera.check()
        except ValueError as error:
            raise RunError(str(error)) from error

    def _check_room(self, is_pair: bool) -> None:
        from renderer.scene.panels import CLOSE_UP_VIEWS  # only now: it brings scipy

        known = {BODY, *(view for views in CLOSE_UP_VIEWS.values() for view in views)}
        least, most = SIDES_PX
        if not all(least <= side <= most for side in self.size):
            raise RunError(
                f"A picture has {least:g} to {most:g} pixels on each side; the stage has "
                f"{self.size[0]:g} x {self.size[1]:g}: make its window larger."
            )
        if len(self.panels) != (2 if is_pair else 1):
            raise RunError("The stage told of another number of pictures than it shows.")
        for picture in self.panels:
            views = [panel.view for panel in picture]
            if views[:1] != [BODY] or len(set(views)) != len(views) or not set(views) <= known:
                raise RunError(
                    "A picture holds a body, and face and hands at most once each beside it; "
                    f"got {', '.join(views) or 'nothing'}."
                )
            for panel in picture:
                inside = (
                    panel.left >= -1
                    and panel.top >= -1
                    and panel.left + panel.width <= self.size[0] + 1
                    and panel.top + panel.height <= self.size[1] + 1
                    and min(panel.width, panel.height) >= 8
                )
                if not inside:
                    raise RunError(
                        f"The {panel.view.replace('_', ' ')} has no room on the stage; make its "
                        "window larger, or leave out close-ups."
                    )
