"""A light floor that fades into the background, with a soft shadow under the body."""

import numpy as np
from jaxtyping import Float, Float32, Int, UInt8
from scipy import ndimage

RESOLUTION = 160
"""Texels along each side of the floor; the shadow is soft, so few are enough."""
HALF_SIZE_M = 2.0
TOUCHING_M = 0.10
"""Below this height above the floor a vertex also casts a contact shadow."""
LOST, BLURS, MOST_LOST = (0.30, 0.45), (2.6, 1.5), 0.62
"""Of the light, by the body and by what touches; texels by which either is soft; and at most."""
GLOW, LIGHTEST = 22.0, 252.0
"""Grey levels by which the pool's middle is lighter than the background, and at most."""
POOL_POWER, FADE = 1.2, 2.5
"""How fast the pool of light falls off, and the floor's shadows with it."""


class ShadowGround:
    """Texture of a square floor around ``centre``: a pool of light, darkened where light is lost.

    The shadow is a splat of the vertices along the light's direction, blurred; no ray is cast.
    """

    def __init__(
        self,
        centre_xz: tuple[float, float],
        floor_m: float,
        light_from: tuple[float, float, float],
        background: tuple[float, float, float],
        half_size_m: float = HALF_SIZE_M,
    ) -> None:
        """
        Args:
            light_from: direction towards the light; y must be positive.
            background: display colour in 0..1 that the floor fades into.
        """
        if light_from[1] <= 0.0:
            raise ValueError(f"The light must come from above; its direction is {light_from}.")
        self.centre_xz, self.floor_m, self.half_size_m = centre_xz, floor_m, half_size_m
        self._slope = (light_from[0] / light_from[1], light_from[2] / light_from[1])
        axis = (np.arange(RESOLUTION) + 0.5) / RESOLUTION * 2.0 - 1.0
        radius = np.hypot(axis[:, None], axis[None, :])
        pool = np.clip(1.0 - radius, 0.0, 1.0) ** POOL_POWER
        backdrop = np.asarray(background, np.float32) * 255.0
        glow = np.minimum(backdrop + GLOW, LIGHTEST)
        self._lit = (backdrop + pool[..., None] * (glow - backdrop)).astype(np.float32)
        self._fade = np.clip((1.0 - radius) * FADE, 0.0, 1.0).astype(np.float32)

    def shadow(self, vertices: Float[np.ndarray, "V 3"]) -> Float32[np.ndarray, "R R"]:
        """Share of light lost at each texel, 0 to 1; rows run along z, columns along x."""
        height = np.maximum(vertices[:, 1] - self.floor_m, 0.0)
        scale = RESOLUTION / (2.0 * self.half_size_m)
        offset = np.array(self.centre_xz) - self.half_size_m
        column = (vertices[:, 0] - self._slope[0] * height - offset[0]) * scale
        row = (vertices[:, 2] - self._slope[1] * height - offset[1]) * scale
        inside = (column >= 0) & (column < RESOLUTION) & (row >= 0) & (row < RESOLUTION)
        texel = row[inside].astype(np.intp) * RESOLUTION + column[inside].astype(np.intp)
        touching = texel[height[inside] < TOUCHING_M]
        lost = LOST[0] * _splat(texel, BLURS[0]) + LOST[1] * _splat(touching, BLURS[1])
        return np.clip(lost, 0.0, MOST_LOST) * self._fade

    def texture(self, vertices: Float[np.ndarray, "V 3"]) -> UInt8[np.ndarray, "R R 3"]:
        """Display colours of the floor with the shadow of these vertices on it."""
        return (self._lit * (1.0 - self.shadow(vertices))[..., None]).astype(np.uint8)

    def corners(self) -> Float32[np.ndarray, "4 3"]:
        """Corners at texture coordinates (0,0), (1,0), (1,1), (0,1), metres."""
        half, (x, z) = self.half_size_m, self.centre_xz
        return np.array(
            [
                [x - half, self.floor_m, z - half],
                [x + half, self.floor_m, z - half],
                [x + half, self.floor_m, z + half],
                [x - half, self.floor_m, z + half],
            ],
            np.float32,
        )


def _splat(texel: Int[np.ndarray, " N"], blur: float) -> Float32[np.ndarray, "R R"]:
    """1 where a vertex falls, 0 elsewhere, spread by a Gaussian of ``blur`` texels."""
    covered = np.zeros(RESOLUTION * RESOLUTION, np.float32)
    covered[texel] = 1.0
    return ndimage.gaussian_filter(covered.reshape(RESOLUTION, RESOLUTION), blur, truncate=2.5)
