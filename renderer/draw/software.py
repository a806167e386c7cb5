"""Pictures without any OpenGL: what draws where no graphics processor does.

Its loops are compiled at their first use ever, which takes seconds; after that it is about twice as
fast as OpenGL drivers that work on the processor. The picture is the same body, lights, floor and
shadow.
"""

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, UInt8

from renderer.draw.antialias import SUPERSAMPLE, Antialias, check_picture_size
from renderer.scene.camera import Z_NEAR_M, Camera
from renderer.scene.studio import PosedFrame, Subject

OPENING_EDGES = 4
"""How far from an opening backs are drawn."""


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
        from renderer.draw import rasteriser

        check_picture_size(width, height)
        rasteriser.make_ready()
        self._antialias: Antialias = antialias
        self._scale = 1 if antialias == "none" else SUPERSAMPLE
        samples = (height * self._scale, width * self._scale)
        self._canvas = np.empty((*samples, 3), np.float32)
        self._inverse_depth = np.empty(samples, np.float32)
        self._spans = np.empty((samples[0], 2), np.int32)
        self._pixels = np.empty((height, width, 4 if subject.is_transparent else 3), np.uint8)
        self._faces = np.ascontiguousarray(subject.faces, np.int32)
        self._has_back: np.ndarray | None = None
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

        if self._has_back is None:
            self._has_back = near_openings(self._faces, frame.vertices)
        eye, axes = np.asarray(camera.eye), camera.axes()
        height, width = self._inverse_depth.shape
        focal = 0.5 * height / np.tan(0.5 * camera.yfov_rad)
        vertices, num_vertices = _plain(frame.vertices), len(frame.vertices)
        corners = np.empty((num_vertices, 3))
        middle = np.array([0.5 * width, 0.5 * height])
        rasteriser.project(vertices, eye, axes, focal, middle, corners)
        self._inverse_depth[:] = 0.0
        self._spans[:] = width, -1
        rasteriser.fill_triangles(
            *(vertices, _plain(frame.normals), _plain(self._colors(frame)), corners, self._faces),
            *(
                self._has_back,
                eye,
                self._towards,
                self._lights,
                self._subject.studio.ambient,
                1.0 / Z_NEAR_M,
            ),
            *(np.empty((num_vertices, 3), np.float32), np.zeros(num_vertices, np.bool_)),
            *(self._inverse_depth, self._canvas, self._spans),
        )
        first, across = self._subject.ground_corners[0], self._subject.ground_corners[1]
        floor = np.array([*eye, first[1], first[0], first[2], across[0] - first[0]], np.float64)
        rays = self._rays(axes, focal)
        if self._subject.is_transparent:
            self._pixels[:] = 0
        else:
            rasteriser.fill_floor(
                *(self._scale, rays, floor, frame.ground, self._backdrop, self._pixels)
            )
        rasteriser.lay_body(
            *(self._canvas, self._inverse_depth, self._spans, self._scale, rays, floor),
            self._pixels,
        )
        return self._pixels

    def _colors(self, frame: PosedFrame) -> Float32[np.ndarray, "V 3"]:
        if frame.colors is not None:
            return frame.colors
        return self._subject.colors_of(len(frame.vertices))

    def _rays(self, axes: np.ndarray, focal: float) -> np.ndarray:
        """How the ray of depth 1 changes with each sample right and down, and where it begins."""
        height, width = self._inverse_depth.shape
        right, up, backward = axes
        corner = -backward - 0.5 * width / focal * right + 0.5 * height / focal * up
        return np.stack([right / focal, -up / focal, corner])


def near_openings(
    faces: Int[np.ndarray, "F 3"], vertices: Float[np.ndarray, "V 3"]
) -> Bool[np.ndarray, " F"]:
    """Faces that one may see from behind: those a few edges from where a mesh ends, as at sleeves
    and collars. Farther in, what is turned away lies behind what is not.

    Vertices in one place are one, in whatever pose: seams of colours or normals are no openings.
    """
    _, place = np.unique(vertices, axis=0, return_inverse=True)
    corners = place.reshape(-1)[faces]
    edges = np.sort(corners[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    found, count = np.unique(edges, axis=0, return_counts=True)
    is_near = np.zeros(len(vertices), np.bool_)
    is_near[found[count == 1]] = True
    for _ in range(OPENING_EDGES):
        is_near[corners[is_near[corners].any(axis=1)]] = True
    return np.asarray(is_near[corners].any(axis=1))


def _plain(numbers: Float[np.ndarray, "V 3"]) -> Float32[np.ndarray, "V 3"]:
    """The one kind of array that the loops are compiled for."""
    return np.ascontiguousarray(numbers, np.float32)
