"""Studio around a body: lights, background, and the fading floor with its shadow."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Float32, Int, UInt8
from scipy import ndimage

from renderer.body.skinning import VertexNormals
from renderer.body.texture import Texture
from renderer.scene.camera_setup import CameraSetup

RESOLUTION = 160
"""Texels along each side of the floor; the shadow is soft, so few are enough."""
HALF_SIZE_M = 2.0
CONTACT_HEIGHT_M = 0.10
"""Height (m) above the floor below which a vertex also casts a contact shadow."""
SHADOW_STRENGTH, BLURS, MAX_SHADOW = (0.30, 0.45), (2.6, 1.5), 0.62
"""Share of light lost to the body and to contact, blur of both (texels), and largest total share.
"""
POOL_BRIGHTNESS, LIGHTEST = 22.0, 252.0
"""Grey levels by which the centre of the floor is lighter than the background, and their limit."""
POOL_POWER, FADE = 1.2, 2.5
"""Falloff of the light on the floor, and of the shadows."""


ROUGHNESS = 0.7
"""Roughness of skin and cloth: the width of highlights."""


@dataclass(frozen=True)
class Light:
    """Distant light. The direction points from the body to the light; colour is linear."""

    direction_to_light: tuple[float, float, float]
    color: tuple[float, float, float]
    intensity: float


@dataclass(frozen=True)
class Studio:
    """Lighting: three lights, ambient light, and the background colour."""

    key: Light = Light((2.6, 2.0, 1.7), (1.0, 0.95, 0.88), 3.7)
    fill: Light = Light((-3.0, 0.3, 2.2), (0.74, 0.86, 1.0), 0.6)
    rim: Light = Light((-1.6, 1.4, -2.8), (1.0, 0.98, 1.0), 3.2)
    ambient: float = 0.17
    background: tuple[float, float, float] = (0.894, 0.902, 0.918)
    shadow_from: tuple[float, float, float] = (0.42, 1.0, 0.22)
    """Direction to the ground shadow's light: steeper than the key, so that the shadow stays short.
    """


STUDIO = Studio()


class ShadowGround:
    """Texture of a square floor: a pool of light, darkened by blurred points as shadow."""

    def __init__(self, stage: CameraSetup) -> None:
        self.centre_xz, self.floor_m = stage.centre_xz, stage.floor_m
        self.half_size_m = HALF_SIZE_M + stage.horizontal_span_m / 2.0
        self.texel_m = 2.0 * self.half_size_m / RESOLUTION
        x, y, z = STUDIO.shadow_from
        self._slope = (x / y, z / y)
        axis = (np.arange(RESOLUTION) + 0.5) / RESOLUTION * 2.0 - 1.0
        radius = np.hypot(axis[:, None], axis[None, :])
        pool = np.clip(1.0 - radius, 0.0, 1.0) ** POOL_POWER
        backdrop = np.asarray(STUDIO.background, np.float32) * 255.0
        glow = np.minimum(backdrop + POOL_BRIGHTNESS, LIGHTEST)
        self._lit = (backdrop + pool[..., None] * (glow - backdrop)).astype(np.float32)
        self._fade = np.clip((1.0 - radius) * FADE, 0.0, 1.0).astype(np.float32)

    def shadow(self, points: Float[np.ndarray, "N 3"]) -> Float32[np.ndarray, "R R"]:
        """Compute the share of light lost per texel, 0 to 1; rows run along z, columns along x."""
        x, y, z = np.ascontiguousarray(points.T, np.float32)  # one axis, one row
        height = np.maximum(y - self.floor_m, 0.0)
        left, upper = (centre - self.half_size_m for centre in self.centre_xz)
        column = ((x - left - self._slope[0] * height) / self.texel_m).astype(np.int32)
        row = ((z - upper - self._slope[1] * height) / self.texel_m).astype(np.int32)
        inside = (column >= 0) & (column < RESOLUTION) & (row >= 0) & (row < RESOLUTION)
        texel = row * RESOLUTION + column
        touching = texel[inside & (height < CONTACT_HEIGHT_M)]
        texel = texel[inside]
        lost = SHADOW_STRENGTH[0] * _splat(texel, BLURS[0]) + SHADOW_STRENGTH[1] * _splat(
            touching, BLURS[1]
        )
        return np.clip(lost, 0.0, MAX_SHADOW) * self._fade

    def texture(self, shadow: Float32[np.ndarray, "R R"]) -> UInt8[np.ndarray, "R R 3"]:
        """Return display colours of the floor with a shadow."""
        return (self._lit * (1.0 - shadow)[..., None]).astype(np.uint8)

    def corners(self) -> Float32[np.ndarray, "4 3"]:
        """Return the corners at texture coordinates (0,0), (1,0), (1,1), (0,1), metres."""
        return self._corners((0, RESOLUTION), (0, RESOLUTION))

    def shadow_corners(self, shadow: Float32[np.ndarray, "R R"]) -> Float32[np.ndarray, "N 3"]:
        """Return the corners (m) of the floor's rectangle with the shadow; none without shadow."""
        rows, columns = (np.flatnonzero(shadow.any(axis=axis)).tolist() for axis in (1, 0))
        if not rows:
            return np.empty((0, 3), np.float32)
        # One texel more at each side, into which the texture is interpolated.
        return self._corners((columns[0] - 1, columns[-1] + 2), (rows[0] - 1, rows[-1] + 2))

    def _corners(self, columns: Sequence[int], rows: Sequence[int]) -> Float32[np.ndarray, "4 3"]:
        """Return the corners of a rectangle of texels, metres."""
        x, z = (
            centre - self.half_size_m + np.array(texels) * self.texel_m
            for centre, texels in zip(self.centre_xz, (columns, rows), strict=True)
        )
        around = [(x[i], self.floor_m, z[j]) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
        return np.array(around, np.float32)


def _splat(texel: Int[np.ndarray, " N"], blur: float) -> Float32[np.ndarray, "R R"]:
    """Return a map of 1 at texels with a vertex, 0 elsewhere, blurred by ``blur`` texels."""
    covered = np.zeros(RESOLUTION * RESOLUTION, np.float32)
    covered[texel] = 1.0
    return ndimage.gaussian_filter(covered.reshape(RESOLUTION, RESOLUTION), blur, truncate=2.5)


@dataclass(frozen=True)
class PosedFrame:
    """Data that change from one picture to the next, computed without OpenGL."""

    vertices: Float[np.ndarray, "V 3"]
    normals: Float[np.ndarray, "V 3"]
    ground_pixels: UInt8[np.ndarray, "R R 3"]
    """Floor with this frame's shadow (R, R, 3), uint8."""
    shadow_corners: Float32[np.ndarray, "N 3"]
    """Corners (m) of the floor's rectangle with the shadow; none without shadow."""
    colors: Float[np.ndarray, "V 3"] | None = None
    """Linear RGB of this frame; None for the subject's colours."""


@dataclass(frozen=True)
class StaticBody:
    """Data of the drawn body and ground that are the same in all pictures."""

    faces: Int[np.ndarray, "F 3"]
    colors: Float[np.ndarray, "V 3"]
    """Linear RGB, 0 to 1."""
    ground_corners: Float[np.ndarray, "4 3"]
    """Corners from ``ShadowGround.corners``."""
    is_transparent: bool = False
    """True to draw the body alone, with its coverage of each pixel as a fourth channel."""
    texture: Texture | None = None
    """Texture of a character, which its colours are multiplied by."""


class PosedFrameBuilder:
    """Converter of vertices to ``PosedFrame``. Holds no OpenGL state: any thread may run it."""

    def __init__(
        self,
        faces: Int[np.ndarray, "F 3"],
        num_vertices: int,
        stage: CameraSetup,
        texture: Texture | None = None,
    ) -> None:
        self.normals = VertexNormals(faces, num_vertices, texture and texture.welds)
        self.ground = ShadowGround(stage)
        self._faces = faces
        self._large: tuple[Int[np.ndarray, " F"], ...] | None = None
        """Corners of the faces that are larger than a texel, in whose middle the shadow would have
        holes; chosen by the first frame."""

    def __call__(
        self,
        vertices: Float[np.ndarray, "V 3"],
        colors: Float[np.ndarray, "V 3"] | None = None,
        behind: PosedFrame | None = None,
    ) -> PosedFrame:
        """Compute normals, floor and shadow of a frame; ``behind`` has the ground to reuse."""
        if behind is not None:
            normals = self.normals(vertices)
            return replace(behind, vertices=vertices, normals=normals, colors=colors)
        if self._large is None:
            corners = vertices[self._faces]
            edge_m = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
            self._large = tuple(self._faces[edge_m > self.ground.texel_m].T.copy())
        a, b, c = (vertices[corner] for corner in self._large)
        shadow = self.ground.shadow(np.concatenate([vertices, (a + b + c) / 3.0]))
        return PosedFrame(
            vertices=vertices,
            normals=self.normals(vertices),
            ground_pixels=self.ground.texture(shadow),
            shadow_corners=self.ground.shadow_corners(shadow),
            colors=colors,
        )
