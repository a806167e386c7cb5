"""How pictures are made: size, view, close-ups, smoothness, what draws."""

from dataclasses import dataclass, field

from conventions.views import VIEWS, Framing
from renderer.draw.offscreen import Backend
from renderer.scene.panels import Panel, lay_out
from renderer.scene.studio import Studio
from renderer.video.encoder import DEFAULT_CRF, check_size

MIN_SIZE_PX = 64
MAX_SIZE_PX = 2160


@dataclass(frozen=True)
class RenderSettings:
    """How pictures are made. Equal settings and an equal ``Stage`` give comparable pictures."""

    width: int = 512
    height: int = 512
    view: str = "front"
    """One of ``camera.VIEWS``."""
    framing: Framing = "whole"
    """How much of the body a view shows that is no close-up."""
    close_ups: tuple[str, ...] = ()
    """Of `CLOSE_UPS`, beside the picture, in the same video."""
    antialias: bool = True
    """Four samples a pixel; off is for drafts."""
    crf: int = DEFAULT_CRF
    """x264's constant quality, 0 to 51; lower is better and larger."""
    backend: Backend | None = None
    """What draws; None takes the first that works here."""
    studio: Studio = field(default_factory=Studio)
    layout: tuple[Panel, ...] | None = None
    """Where the body, which comes first and is as large as ``width`` and ``height`` say, and the
    close-ups stand; None as ``close_ups`` are laid out."""
    is_transparent: bool = False
    """Pictures of the body alone, with a fourth channel for what it covers; no videos and no
    close-ups."""

    def __post_init__(self) -> None:
        check_size(self.width, self.height)
        if min(self.width, self.height) < MIN_SIZE_PX or max(self.width, self.height) > MAX_SIZE_PX:
            raise ValueError(
                f"A picture of {self.width} x {self.height} pixels is outside the limits; "
                f"each side may have {MIN_SIZE_PX} to {MAX_SIZE_PX}."
            )
        if self.view not in VIEWS:
            raise ValueError(f"View {self.view!r} is unknown; choose one of {', '.join(VIEWS)}.")
        if not 0 <= self.crf <= 51:
            raise ValueError(f"`crf` is {self.crf}; it must lie between 0 and 51.")
        if self.close_ups and self.is_transparent:
            raise ValueError("A picture without a background has no close-ups beside it.")
        if self.layout is not None:
            body = self.layout[0]
            if self.close_ups or (body.width, body.height) != (self.width, self.height):
                raise ValueError("A layout begins with the body's panel and holds all close-ups.")
            check_size(*self.picture_size)
        lay_out(self.view, self.width, self.height, self.close_ups)

    @property
    def aspect(self) -> float:
        """Of the body's own panel."""
        return self.width / self.height

    @property
    def panels(self) -> tuple[Panel, ...]:
        """The body's, and after it those of the close-ups."""
        if self.layout is not None:
            return self.layout
        return lay_out(self.view, self.width, self.height, self.close_ups)

    @property
    def picture_size(self) -> tuple[int, int]:
        """Width and height of all panels together."""
        panels = self.panels
        width = max(panel.left + panel.width for panel in panels)
        return width, max(panel.top + panel.height for panel in panels)

    @property
    def num_channels(self) -> int:
        return 4 if self.is_transparent else 3
