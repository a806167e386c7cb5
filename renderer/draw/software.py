"""Pictures without any OpenGL: the last resort of machines that have none.

Slower to start than a driver, since its loops are compiled at their first use ever, and then about
as fast: the picture is the same body, lights, floor and shadow.
"""

import numpy as np
from jaxtyping import Float32, UInt8

from renderer.draw.antialias import SUPERSAMPLE, Antialias, check_picture_size
from renderer.stage.camera import Z_NEAR_M, Camera
from renderer.stage.studio import PosedFrame, Subject


class SoftwareRenderer:
    """Draws one subject with loops compiled by numba, in one thread. Use it in ``with``."""

    driver = "compiled loops, no OpenGL"

    def __init__(
        self, subject: Subject, width: int, height: int, antialias: Antialias = "supersample"
    ) -> None:
        """
        Raises:
            ValueError: if the picture has no pixel.
        """
        check_picture_size(width, height)
        self._antialias: Antialias = antialias
        self._scale = 1 if antialias == "none" else SUPERSAMPLE
        samples = (height * self._scale, width * self._scale)
        self._canvas = np.empty((*samples, 3), np.float32)
        self._inverse_depth = np.empty(samples, np.float32)
        self._pixels = np.empty((height, width, 4 if subject.is_transparent else 3), np.uint8)
        self._faces = np.ascontiguousarray(subject.faces, np.int32)
        self._subject = subject
        lights = (subject.studio.key, subject.studio.fill, subject.studio.rim)
        towards = np.array([light.towards for light in lights])
        self._towards = towards / np.linalg.norm(towards, axis=1, keepdims=True)
        self._lights = np.array([light.color for light in lights])
        self._lights *= np.array([[light.intensity] for light in lights]) / np.pi
        self._backdrop = 255.0 * np.array(subject.studio.background)

    def __enter__(self) -> "SoftwareRenderer":
        return self

    def __exit__(self, *exception: object) -> None:
        pass

    def beside(self, subject: Subject, width: int, height: int) -> "SoftwareRenderer":
        """What draws another subject in another size."""
        return SoftwareRenderer(subject, width, height, self._antialias)

    def draw(self, frame: PosedFrame, camera: Camera) -> UInt8[np.ndarray, "H W C"]:
        """The picture, upper row first; overwritten by the next call."""
        from renderer.draw import rasteriser

        eye, axes = np.asarray(camera.eye), camera.axes()
        lit = np.empty((len(frame.vertices), 3), np.float32)
        rasteriser.shade(
            *(frame.vertices, frame.normals, self._colors(frame), eye),
            *(self._towards, self._lights, self._subject.studio.ambient, lit),
        )
        self._inverse_depth[:] = 0.0
        focal = 0.5 * self._canvas.shape[0] / np.tan(0.5 * camera.yfov_rad)
        corners = self._project(frame.vertices, eye, axes, focal)
        rasteriser.fill_triangles(
            *(corners, self._faces, lit, 1.0 / Z_NEAR_M, self._inverse_depth, self._canvas)
        )
        first, across = self._subject.ground_corners[0], self._subject.ground_corners[1]
        floor = np.array([*eye, first[1], first[0], first[2], across[0] - first[0]], np.float64)
        rasteriser.resolve(
            *(self._canvas, self._inverse_depth, self._scale, self._rays(axes, focal), floor),
            *(frame.ground, self._backdrop, self._pixels),
        )
        return self._pixels

    def _colors(self, frame: PosedFrame) -> Float32[np.ndarray, "V 3"]:
        if frame.colors is not None:
            return frame.colors
        return self._subject.colors_of(len(frame.vertices))

    def _project(
        self, vertices: np.ndarray, eye: np.ndarray, axes: np.ndarray, focal: float
    ) -> np.ndarray:
        """(V, 3): column and row in samples, and inverse depth, of each vertex."""
        right, up, backward = ((vertices - eye) @ axes.T).T
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            inverse = -1.0 / backward
            column = 0.5 * self._canvas.shape[1] + focal * right * inverse
            row = 0.5 * self._canvas.shape[0] - focal * up * inverse
        return np.stack([column, row, inverse], axis=1)

    def _rays(self, axes: np.ndarray, focal: float) -> np.ndarray:
        """How the ray of depth 1 changes with each sample right and down, and where it begins."""
        height, width = self._inverse_depth.shape
        right, up, backward = axes
        corner = -backward - 0.5 * width / focal * right + 0.5 * height / focal * up
        return np.stack([right / focal, -up / focal, corner])
