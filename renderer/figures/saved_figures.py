"""Contents of figures in files, from which other file formats are drawn on demand.

A file is an npz of plain arrays with a JSON text of the structure: nothing in it is executed when
it is read, even from an unknown source.
"""

import json
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Shaped

from renderer.figures import curves
from renderer.figures.curves import SpeechEffectRow
from renderer.figures.errors import FigureError
from renderer.figures.figure6.contents import Figure6, JointMarks
from renderer.figures.figure6.layout import draw_figure6
from renderer.figures.jitter import Jitter, JitterSheet, draw_jitter_sheet
from renderer.figures.style import save_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DRAW_FUNCTIONS: Mapping[str, "Callable[[Any], Figure]"] = {
    "figure6": draw_figure6,
    "jitter": draw_jitter_sheet,
    "speech_effect": curves.draw_speech_effect,
    "hearing": curves.draw_speech_effect,  # its former name
    "error_growth": curves.draw_noise_shift_along_chain,
    "steps": curves.draw_speed_quality_tradeoff,
}
"""Functions that redraw a run's figures from the saved contents, by the figure's name."""
_KINDS: Mapping[str, Any] = {
    kind.__name__: kind for kind in (Figure6, SpeechEffectRow, Jitter, JitterSheet, JointMarks)
}
_RENAMED = {
    "HearingRow": "SpeechEffectRow",
    "arm_speed": "arm_speed_deg_s",
    "asked_panels": "requested_panels",
    "by_depth": "jerk_by_depth",
    "by_joint": "jerk_by_joint",
    "chain_drop": "jerk_drop_by_joint",
    "cropped_to": "crop_joints",
    "by_phase": "jerk_by_frame_in_period",
    "by_window_frame": "jerk_by_frame_in_period",
    "period": "period_and_part",
    "shares": "speech_and_noise_shares",
    "values": "joint_jerk",
    "tip_source": "tracked_point_source",
    "point": "tracked_point",
}
"""Kinds and fields of figures of version 1.0, with their present names."""
_TEXT = "contents"


def save_figure_contents(path: Path, name: str, contents: object, caption: str) -> None:
    """Write what `draw_saved_figure` needs to draw the figure ``name`` of `DRAW_FUNCTIONS`."""
    arrays: list[np.ndarray] = []
    metadata = {"name": name, "caption": caption}
    metadata["contents"] = _as_json(contents, arrays)
    text = np.frombuffer(json.dumps(metadata).encode(), np.uint8)
    # Compressed as little as possible: pictures dominate, and numpy's default level is slow.
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for key, array in {_TEXT: text, **dict(enumerate(arrays))}.items():
            with archive.open(f"{key}.npy", "w", force_zip64=True) as file:
                np.lib.format.write_array(file, array, allow_pickle=False)


def draw_saved_figure(path: Path, out: Path) -> None:
    """Draw a figure saved by `save_figure_contents`, by suffix of ``out``; raises FigureError."""
    try:
        with np.load(path, allow_pickle=False) as arrays:
            metadata = json.loads(arrays[_TEXT].tobytes())
            draw, caption = DRAW_FUNCTIONS[metadata["name"]], str(metadata["caption"])
            contents = _from_json(metadata["contents"], arrays)
    except (KeyError, TypeError, ValueError, zipfile.BadZipFile, RecursionError) as error:
        raise FigureError(
            f"{path.name} is not a saved figure, or it is damaged; make the figure again."
        ) from error
    form = out.suffix.lstrip(".")
    save_figure(lambda: draw(contents), out.with_suffix(""), caption, (form,))


def _as_json(value: Any, arrays: list[Shaped[np.ndarray, " ..."]]) -> Any:
    """Convert contents to JSON with the kind of each object; arrays are appended to ``arrays``."""
    if is_dataclass(value):
        of = {field.name: getattr(value, field.name) for field in fields(value)}
        converted = {name: _as_json(each, arrays) for name, each in of.items()}
        return {"kind": type(value).__name__, "of": converted}
    if isinstance(value, np.ndarray):
        arrays.append(value)
        return {"kind": "array", "of": len(arrays) - 1}
    if isinstance(value, Mapping):
        pairs = [[_as_json(each, arrays) for each in pair] for pair in value.items()]
        return {"kind": "mapping", "of": pairs}
    if isinstance(value, tuple | list):
        return [_as_json(each, arrays) for each in value]
    if hasattr(value, "to_dict"):  # a data frame, without importing pandas
        return {"kind": "table", "of": value.to_dict("list")}
    return value.item() if isinstance(value, np.generic) else value


def _from_json(content: Any, arrays: Mapping[str, Shaped[np.ndarray, " ..."]]) -> Any:
    if isinstance(content, Sequence) and not isinstance(content, str):
        return tuple(_from_json(each, arrays) for each in content)
    if not isinstance(content, Mapping):
        return content
    kind, of = content["kind"], content["of"]
    match kind:
        case "array":
            return arrays[str(of)]
        case "mapping":
            return dict(_from_json(pair, arrays) for pair in of)
        case "table":
            from pandas import DataFrame

            return DataFrame(of)
    names = {name: _RENAMED.get(str(name), str(name)) for name in (kind, *of)}
    return _KINDS[names[kind]](**{names[name]: _from_json(one, arrays) for name, one in of.items()})
