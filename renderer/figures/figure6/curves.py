"""The path of a point in space, and strips of its tremble, all to one scale."""

from typing import TYPE_CHECKING

import numpy as np

from renderer.figures import style
from renderer.figures.figure6.layout import Layout
from renderer.figures.figure6.spec import COORDINATES, CUT_OFF_HZ, MIN_SPAN_M, Figure6
from renderer.figures.page import MARGIN, NAME_BREAKS, TITLE_GAP, write, write_title
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


_SHOWN = 99.0  # percentile of all strips that their common scale holds
_HEADROOM = 1.35  # of that; a motion's name stands there
_SMALLEST_MM = 0.1


def draw_strips(figure: "Figure", layout: Layout, contents: Figure6) -> None:
    """A strip for each motion with x, y and z, all to one scale, and their rms."""
    times = (contents.start_frame + np.arange(contents.num_frames)) / contents.fps
    margin = 0.01 * (times[-1] - times[0])
    top = layout.strips[0].top - TITLE_GAP
    letter = "d" if contents.snapshots else "c"
    write_title(
        figure,
        MARGIN,
        top,
        f"{letter}  Tremble: how far off its own path below {CUT_OFF_HZ:g} Hz, in mm",
    )
    sizes = np.abs(np.concatenate(list(contents.tremble.values())))
    reach = max(_HEADROOM * float(np.percentile(sizes, _SHOWN)), _SMALLEST_MM)
    tick = float(style.ROUND_NUMBERS[style.ROUND_NUMBERS <= 0.8 * reach][-1])
    for rect, (name, values) in zip(layout.strips, contents.tremble.items(), strict=True):
        axes = figure.add_axes(rect.fraction_of(layout.height), label=f"tremble of {name}")
        axes.plot(times, values, color=contents.styles[name].color, linewidth=0.6)
        axes.set_xlim(times[0] - margin, times[-1] + margin)
        axes.set_ylim(-reach, reach)
        axes.set_yticks((-tick, 0.0, tick), ("", f"\N{PLUS-MINUS SIGN}{tick:g}", ""))
        axes.grid(axis="y")
        is_last = rect is layout.strips[-1]
        axes.tick_params(axis="x", labelbottom=is_last)
        if is_last:
            axes.set_xlabel("time (s)", size=style.LABEL_PT, labelpad=2.0)
        rms = float(np.sqrt(np.square(values).sum(axis=1).mean()))
        size = f"{rms:.1f} mm rms"
        room = rect.width - style.text_width_in(size, style.SMALL_PT) - 0.5
        for place, side, text in (
            (rect.left + 0.05, "left", _cut(name, room)),
            (rect.right - 0.03, "right", size),
        ):
            write(
                figure, place, rect.top + 0.01, text, size=style.SMALL_PT, va="top", ha=side,
                bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.5},
            )  # fmt: skip


def _cut(name: str, width: float) -> str:
    """As much of a name as one line holds; the legend has the whole."""
    first, *rest = style.wrap_text(name, style.SMALL_PT, width, breaks_after=NAME_BREAKS)
    return f"{first}\N{HORIZONTAL ELLIPSIS}" if rest else first
