"""The studio a body is shown in: lights, background, floor and the body itself."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Float32, Int

from renderer.body.look import CLAY
from renderer.body.normals import VertexNormals
from renderer.scene.ground import HALF_SIZE_M, ShadowGround
from renderer.scene.stage import Stage

ROUGHNESS = 0.7
"""Of skin and cloth alike: how far a highlight spreads."""


@dataclass(frozen=True)
class Light:
    """A distant light. ``towards`` points from the body to the light; colour is linear."""

    towards: tuple[float, float, float]
    color: tuple[float, float, float]
    intensity: float


@dataclass(frozen=True)
class Studio:
    """The light: three lamps, their ambient part, and the colour behind everything."""

    key: Light = Light((2.6, 2.0, 1.7), (1.0, 0.95, 0.88), 3.7)
    fill: Light = Light((-3.0, 0.3, 2.2), (0.74, 0.86, 1.0), 0.6)
    rim: Light = Light((-1.6, 1.4, -2.8), (1.0, 0.98, 1.0), 3.2)
    ambient: float = 0.17
    background: tuple[float, float, float] = (0.894, 0.902, 0.918)
    shadow_from: tuple[float, float, float] = (0.42, 1.0, 0.22)
    """Where the ground shadow's light stands: steeper than the key, so that it stays short."""


@dataclass(frozen=True)
class PosedFrame:
    """All that changes from one picture to the next, computed without OpenGL."""

    vertices: Float[np.ndarray, "V 3"]
    normals: Float[np.ndarray, "V 3"]
    ground: np.ndarray
    """(R, R, 3) uint8: the floor with this frame's shadow."""
    colors: Float[np.ndarray, "V 3"] | None = None
    """Linear RGB of this frame alone; None is what the subject has."""

    def part(self, vertices: Int[np.ndarray, " N"]) -> "PosedFrame":
        """Some of the vertices, lit as among all."""
        colors = None if self.colors is None else self.colors[vertices]
        return PosedFrame(self.vertices[vertices], self.normals[vertices], self.ground, colors)


@dataclass(frozen=True)
class Subject:
    """What stays as it is from one picture to the next."""

    faces: Int[np.ndarray, "F 3"]
    colors: Float[np.ndarray, "V 3"] | None
    """Linear RGB, 0 to 1; None is clay."""
    ground_corners: Float[np.ndarray, "4 3"]
    """As ``ShadowGround.corners``."""
    studio: Studio = field(default_factory=Studio)
    is_transparent: bool = False
    """The body alone, with how much of each pixel it covers as a fourth channel."""

    def colors_of(self, num_vertices: int) -> Float32[np.ndarray, "V 3"]:
        """The colours, or as many of clay."""
        if self.colors is None:
            return np.tile(np.array(CLAY, np.float32), (num_vertices, 1))
        return self.colors


class FramePreparer:
    """Turns vertices into ``PosedFrame``. Holds no OpenGL state: any thread may run it."""

    def __init__(
        self,
        faces: Int[np.ndarray, "F 3"],
        num_vertices: int,
        stage: Stage,
        studio: Studio,
    ) -> None:
        self.normals = VertexNormals(faces, num_vertices)
        self.ground = ShadowGround(
            centre_xz=stage.centre_xz,
            floor_m=stage.floor_m,
            light_from=studio.shadow_from,
            background=studio.background,
            half_size_m=HALF_SIZE_M + stage.extent_m / 2.0,
        )

    def __call__(
        self,
        vertices: Float[np.ndarray, "V 3"],
        colors: Float[np.ndarray, "V 3"] | None = None,
    ) -> PosedFrame:
        return PosedFrame(vertices, self.normals(vertices), self.ground.texture(vertices), colors)
