"""The path of a point in space, as a box that fills its place in the figure."""

from typing import TYPE_CHECKING

import numpy as np

from renderer.figures.figure6.spec import COORDINATES, MIN_SPAN_M, Figure6
from renderer.figures.style import LABEL_PT, ROUND_NUMBERS

if TYPE_CHECKING:
    from matplotlib.backends.backend_agg import RendererAgg
    from matplotlib.figure import Figure
    from matplotlib.transforms import Bbox
    from mpl_toolkits.mplot3d import Axes3D

_ELEVATION_DEG, _AZIMUTH_DEG = 20.0, -28.0  # from the front, above the body's right hand


def draw_path(
    figure: "Figure", place: tuple[float, float, float, float], contents: Figure6
) -> float:
    """Axes with the positions in space, without perspective, all three axes to one scale.

    Args:
        place: left, bottom, width and height as fractions of the figure.

    Returns:
        Metres between the lines of the grid.
    """
    from matplotlib.ticker import MultipleLocator
    from mpl_toolkits.mplot3d import Axes3D

    positions = np.concatenate(list(contents.trajectories.values())).astype(np.float64)
    low, high = positions.min(axis=0), positions.max(axis=0)
    spans = np.maximum(high - low, max(0.25 * float((high - low).max()), MIN_SPAN_M))
    middle = 0.5 * (low + high)
    grid_pitch = _grid_pitch(float(spans.max()))

    axes = Axes3D(figure, rect=place, label="path")
    figure.add_axes(axes)
    axes.set_facecolor("none")
    axes.set_proj_type("ortho")
    axes.view_init(elev=_ELEVATION_DEG, azim=_AZIMUTH_DEG, vertical_axis="y")
    for name, path in contents.trajectories.items():
        axes.plot(
            path[:, 0],
            path[:, 1],
            path[:, 2],
            label=name,
            markevery=list(contents.marker_frames),
            **contents.styles[name].line_properties,
        )
    for axis, letter, m, s in zip(
        (axes.xaxis, axes.yaxis, axes.zaxis), COORDINATES, middle, 1.06 * spans, strict=True
    ):
        getattr(axes, f"set_{letter}lim")(m - s / 2, m + s / 2)
        getattr(axes, f"set_{letter}label")(letter, size=LABEL_PT, labelpad=-14.0)
        axis.set_major_locator(MultipleLocator(grid_pitch))
        axis.set_ticklabels([])
    _fill_rect(figure, axes, spans)
    return grid_pitch


def _fill_rect(figure: "Figure", axes: "Axes3D", spans: np.ndarray) -> None:
    """Enlarge the box of the path, and move it, until it fills its place with its letters."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    place = axes.get_window_extent().frozen()
    renderer = FigureCanvasAgg(figure).get_renderer()
    zoom = 1.0
    for _ in range(3):  # the letters do not grow with the box, so one step is not exact
        axes.set_box_aspect(spans, zoom=zoom)  # pyright: ignore[reportArgumentType]
        drawn = _box_with_letters(axes, renderer)
        zoom *= 0.99 * min(place.width / drawn.width, place.height / drawn.height)
    off_centre = np.subtract(_centre(place), _centre(drawn))
    axes.set_position(axes.get_position().translated(*(off_centre / figure.bbox.size)))


def _centre(box: "Bbox") -> tuple[float, float]:
    return 0.5 * (box.x0 + box.x1), 0.5 * (box.y0 + box.y1)


def _box_with_letters(axes: "Axes3D", renderer: "RendererAgg") -> "Bbox":
    """Pixels that the box of the path and the letters at its edges cover."""
    from matplotlib.transforms import Bbox
    from mpl_toolkits.mplot3d.proj3d import proj_transform

    axes.draw(renderer)  # puts the letters in their places
    limits = (axes.get_xlim(), axes.get_ylim(), axes.get_zlim())
    corners_x, corners_y, corners_z = (grid.ravel() for grid in np.meshgrid(*limits))
    x, y, _ = proj_transform(corners_x, corners_y, corners_z, axes.get_proj())
    box = Bbox.null()
    box.update_from_data_xy(axes.transData.transform(np.stack([x, y], axis=1)))
    letters = [
        axis.label.get_window_extent(renderer) for axis in (axes.xaxis, axes.yaxis, axes.zaxis)
    ]
    return Bbox.union([box, *letters])


def _grid_pitch(span: float) -> float:
    """The largest round number of metres that cuts the span into at least three."""
    return float(ROUND_NUMBERS[ROUND_NUMBERS <= span / 3.0][-1])
