"""Figure 6 of the GlobalDiff paper for any motions: a fingertip's path beside snapshots.

Call it under the settings of :mod:`renderer.figures.files`; without these the type sizes that
the layout measured are not the ones that are drawn.

Left, the trajectory of one point, one axis per coordinate, and its path in space; right, one row of
snapshots per system, all from the same camera. Nothing here knows where the positions or the
pictures come from.
"""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from renderer.figures import style
from renderer.figures.figure6.curves import draw_path, draw_strips
from renderer.figures.figure6.layout import (
    COORDINATE_GAP,
    FRAME_NUMBERS,
    Layout,
    plan_layout,
)
from renderer.figures.figure6.snapshots import JointMarks, crop_alike, mark_joints
from renderer.figures.figure6.spec import (
    COORDINATES,
    MIN_SPAN_M,
    Figure6,
)
from renderer.figures.files import FigureFiles, matplotlib_settings, write_figure
from renderer.figures.page import (
    MARGIN,
    TITLE_GAP,
    Rect,
    caption_lines,
    draw_key,
    write,
    write_caption,
    write_title,
)
from renderer.figures.style import ROUND_NUMBERS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MIN_SHARE = 0.2  # of the height, for the flattest coordinate
_SCALE_MARK, _SCALE_GAP = 0.12, 0.03  # inches of a sample of the marks, and beside it
_SCALE_PIXELS, _SCALE_RADIUS = 60, 0.32
_ROOMY_TICKS, _CLOSEST_TICKS = 0.2, 0.09  # inches between numbers one above the other


def draw_figure6(contents: Figure6) -> "Figure":
    """The figure, without a canvas; its size in inches is its size on paper."""
    from matplotlib.figure import Figure

    snapshots = crop_alike(_marked(contents)) if contents.snapshots else {}
    num_snapshots = len(contents.snapshot_frames) if snapshots else 0
    aspect = 1.0
    if snapshots:
        height, width = next(iter(snapshots.values())).shape[1:3]
        aspect = width / height
    caption = caption_lines(contents.caption)
    limits = _coordinate_limits(contents.trajectories)
    layout = plan_layout(
        tuple(contents.trajectories), num_snapshots, aspect, len(caption),
        _number_width_in(limits), len(contents.tremble),
    )  # fmt: skip

    figure = Figure(figsize=(style.FIGURE_WIDTH_IN, layout.height), facecolor="white")
    for key in (*layout.legend, *layout.row_keys):
        draw_key(figure, key, contents.styles[key.name])
    _draw_coordinates(figure, layout, contents, limits)
    grid_pitch = draw_path(figure, layout.path.fraction_of(layout.height), contents)
    letter = "c" if snapshots else "b"
    write_title(
        figure,
        layout.path.left,
        layout.path.top - TITLE_GAP,
        f"{letter}  Path in space (grid {grid_pitch:g} m)",
    )
    if snapshots:
        _draw_snapshots(figure, layout, contents, snapshots)
    if contents.tremble:
        draw_strips(figure, layout, contents)
    write_caption(figure, caption, layout.caption_top)
    return figure


def _marked(contents: Figure6) -> dict[str, np.ndarray]:
    """The snapshots, with their marks where there are any."""
    marks = contents.marks
    if marks is None:
        return contents.snapshots
    return {
        name: mark_joints(
            pictures, marks.pixels[name], np.asarray(marks.values[name]) / marks.full_scale
        )
        for name, pictures in contents.snapshots.items()
    }


def _draw_scale(figure: "Figure", marks: JointMarks, right: float, bottom: float) -> None:
    """Two marks with their values, ending at the right edge of the snapshots."""
    samples = {1.0: f"{marks.full_scale:g} {marks.unit} {marks.quantity}"}
    samples[0.5] = f"{0.5 * marks.full_scale:g}"
    empty = np.full((1, _SCALE_PIXELS, _SCALE_PIXELS, 3), 255, np.uint8)
    centre = np.full((1, 1, 2), 0.5 * _SCALE_PIXELS)
    for severity, text in samples.items():  # from the right to the left
        right -= style.text_width_in(text, style.SMALL_PT)
        place = (right, bottom - 0.5 * _SCALE_MARK)
        write(figure, *place, text, size=style.SMALL_PT, va="center_baseline")
        right -= _SCALE_MARK + _SCALE_GAP
        rect = Rect(right, bottom - _SCALE_MARK, _SCALE_MARK, _SCALE_MARK)
        axes = figure.add_axes(rect.fraction_of(figure.get_figheight()), label="scale of marks")
        axes.set_axis_off()
        axes.imshow(mark_joints(empty, centre, np.full((1, 1), severity), _SCALE_RADIUS)[0])
        right -= 3.0 * _SCALE_GAP


def _coordinate_limits(
    trajectories: dict[str, np.ndarray],
) -> list[tuple[float, float]]:
    """Limits of x, y and z in metres, in proportion to the heights their axes get."""
    positions = np.concatenate(list(trajectories.values())).astype(np.float64)
    low, high = positions.min(axis=0), positions.max(axis=0)
    spans = np.maximum(1.14 * (high - low), MIN_SPAN_M)
    spans = np.maximum(spans, _MIN_SHARE * spans.sum())
    middle = 0.5 * (low + high)
    return [(float(m - s / 2), float(m + s / 2)) for m, s in zip(middle, spans, strict=True)]


def _draw_coordinates(
    figure: "Figure", layout: Layout, contents: Figure6, limits: list[tuple[float, float]]
) -> None:
    """One axis per coordinate against time, all to one scale in metres per inch."""
    from matplotlib.ticker import MultipleLocator

    area = layout.coordinates
    scale = (area.height - 2 * COORDINATE_GAP) / sum(high - low for low, high in limits)
    tick_step = _tick_step(limits, scale)
    times = (contents.start_frame + np.arange(contents.num_frames)) / contents.fps
    margin = 0.01 * (times[-1] - times[0]) or 0.5 / contents.fps
    write_title(figure, MARGIN, area.top - TITLE_GAP, f"a  {contents.point}")
    top = area.top
    for coordinate, (low, high) in enumerate(limits):
        rect = Rect(area.left, top, area.width, scale * (high - low))
        top = rect.bottom + COORDINATE_GAP
        axes = figure.add_axes(rect.fraction_of(layout.height))
        axes.set_label(COORDINATES[coordinate])
        for frame in contents.snapshot_marks:
            axes.axvline(times[frame], color=style.SNAPSHOT_INK, linewidth=0.5, zorder=0.5)
        for name, positions in contents.trajectories.items():
            axes.plot(
                times,
                positions[:, coordinate],
                label=name,
                markevery=list(contents.marker_frames),
                **contents.styles[name].line_properties,
            )
        axes.set_xlim(times[0] - margin, times[-1] + margin)
        axes.set_ylim(low, high)
        axes.grid(axis="y")
        axes.set_axisbelow(True)
        axes.yaxis.set_major_locator(MultipleLocator(tick_step))
        is_last = coordinate == len(limits) - 1
        axes.tick_params(axis="x", labelbottom=is_last)
        middle = 1.0 - (rect.top + 0.5 * rect.height) / layout.height
        figure.text(
            (MARGIN + 0.06) / style.FIGURE_WIDTH_IN,
            middle,
            f"{COORDINATES[coordinate]} (m)",
            rotation=90,
            size=style.LABEL_PT,
            ha="center",
            va="center",
        )
        if is_last:
            axes.set_xlabel("time (s)", size=style.LABEL_PT, labelpad=2.0)


def _number_width_in(limits: list[tuple[float, float]]) -> float:
    """Room for the numbers at the coordinate axes, whatever step the ticks will have."""
    total_span = sum(high - low for low, high in limits)
    decimals = max(0, int(np.ceil(-np.log10(total_span / 20.0))))
    largest = max(abs(value) for pair in limits for value in pair)
    return style.text_width_in(f"\N{MINUS SIGN}{largest:.{decimals}f}", style.SMALL_PT)


def _tick_step(limits: list[tuple[float, float]], scale: float) -> float:
    """Metres between ticks: 0.2 inches or more, less where an axis would have fewer than two."""
    steps = ROUND_NUMBERS[ROUND_NUMBERS * scale >= _CLOSEST_TICKS]
    roomy = steps[steps * scale >= _ROOMY_TICKS]
    for step in (float(roomy[0]), *steps[steps < roomy[0]][::-1]):
        if all(np.floor(high / step) > np.ceil(low / step) for low, high in limits):
            return float(step)
    return float(roomy[0])


def _draw_snapshots(
    figure: "Figure", layout: Layout, contents: Figure6, snapshots: dict[str, np.ndarray]
) -> None:
    """Rows of pictures under their frame numbers."""
    first_row = layout.cells[0]
    top = layout.row_keys[0].rect.top
    title_bottom = top - FRAME_NUMBERS - TITLE_GAP
    if contents.marks is None:
        write_title(figure, first_row[0].left, title_bottom, "b  Snapshots at frame")
    else:
        write_title(figure, first_row[0].left, title_bottom, "b  Snapshots")
        _draw_scale(figure, contents.marks, layout.row_keys[0].rect.right, title_bottom)
    for cell, frame in zip(first_row, contents.snapshot_frames, strict=True):
        write(
            figure,
            cell.left + 0.5 * cell.width,
            top,
            str(frame),
            size=style.SMALL_PT,
            ha="center",
            va="bottom",
        )
    # One pair of axes in inches for all pictures: 49 pairs would take longer than all the rest.
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), label="snapshots", zorder=-1)
    axes.set_axis_off()
    for row, (name, pictures) in zip(layout.cells, snapshots.items(), strict=True):
        for cell, frame, picture in zip(row, contents.snapshot_frames, pictures, strict=True):
            image = axes.imshow(
                picture, extent=(cell.left, cell.right, cell.bottom, cell.top), aspect="auto"
            )
            image.set_label(f"{name} at frame {frame}")
    axes.set_xlim(0.0, style.FIGURE_WIDTH_IN)
    axes.set_ylim(layout.height, 0.0)


def figure6(contents: Figure6, out_stem: Path) -> FigureFiles:
    """Write ``<out_stem>.png``, ``.svg`` and ``.pdf``, in a folder that is made; each appears whole
    or not at all."""
    with matplotlib_settings():
        return write_figure(draw_figure6(contents), out_stem, description=contents.caption)
