"""Colours of systems: the same in every run, and distinct for every kind of colour vision."""

from itertools import combinations

import numpy as np

from app.config import AppConfig
from conventions.colors import REFERENCE_COLOR, SYSTEM_COLORS, colors_of
from model.systems.registry import list_systems

# Machado, Oliveira and Fernandes 2009, severity 1, for linear RGB.
VISION = {
    "normal": np.eye(3),
    "protanopia": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "tritanopia": [
        [1.255528, -0.076749, -0.178779],
        [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.303900],
    ],
}
TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])


def linear(color: str) -> np.ndarray:
    parts = np.array([int(color[at : at + 2], 16) for at in (1, 3, 5)]) / 255
    return np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)


def lab(rgb: np.ndarray) -> np.ndarray:
    x, y, z = np.cbrt(np.clip(TO_XYZ @ rgb / (0.9505, 1.0, 1.089), 0.008856, None))
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


def distance(a: str, b: str) -> float:
    """CIELAB distance for the vision that sees the least difference."""
    seen = [[lab(np.clip(np.array(m) @ linear(c), 0, 1)) for c in (a, b)] for m in VISION.values()]
    return min(float(np.linalg.norm(first - second)) for first, second in seen)


def test_any_two_systems_differ_for_every_vision_and_local_from_global_the_most() -> None:
    apart = {
        (a, b): distance(SYSTEM_COLORS[a], SYSTEM_COLORS[b])
        for a, b in combinations(SYSTEM_COLORS, 2)
    }
    closest = min(apart, key=apart.__getitem__)
    assert apart[closest] > 19, closest
    of_pair = apart["globaldiff/local", "globaldiff/global"]
    assert of_pair > 80 and sum(each > of_pair for each in apart.values()) <= 3
    for name, color in SYSTEM_COLORS.items():
        luminance = TO_XYZ[1] @ linear(color)
        dark = TO_XYZ[1] @ linear("#131d29")
        assert min(1.05 / (luminance + 0.05), (luminance + 0.05) / (dark + 0.05)) > 2.05, name


def test_a_system_has_its_colour_in_every_run() -> None:
    assert set(list_systems(AppConfig().weights)) == set(SYSTEM_COLORS)
    local, other = SYSTEM_COLORS["globaldiff/local"], SYSTEM_COLORS["globaldiff/global"]
    names = ["x.npz", "global", "globaldiff/local (A)", "globaldiff/local (B)", "reference"]
    colors = colors_of(names, "reference")
    assert list(colors) == names and len({*colors.values()}) == len(names)
    assert colors["globaldiff/local (A)"] == local and colors["global"] == other
    assert colors["reference"] == REFERENCE_COLOR
    left = [color for color in SYSTEM_COLORS.values() if color not in (local, other)]
    assert [colors["x.npz"], colors["globaldiff/local (B)"]] == left[:2]
    colors = colors_of(["globaldiff/localised", "globaldiff/local.s2"], None)
    assert colors["globaldiff/local.s2"] == local != colors["globaldiff/localised"]
