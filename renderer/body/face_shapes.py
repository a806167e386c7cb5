"""Blendshapes of a character by ARKit's names, or the nearest that it has for each of them.

ARKit's 52 are found with or without a prefix, and in Apple's or Unreal's spelling. Where there are
none, those of VRM and Oculus visemes take the place of the shapes that look most like them.
"""

from __future__ import annotations

import re

import numpy as np
from jaxtyping import Float32, Float64, Int64

from renderer.body.gltf import Gltf

ComponentWeightsByTarget = dict[int, dict[int, float]]
"""Weights of expression components, by index of a primitive's target."""
_MIN_OFFSET_M = 2e-5
_SIDES = re.compile(r"[_ .](l|r)$", re.IGNORECASE)

ARKIT_TO_VRM_PRESETS: dict[str, tuple[tuple[str, float], ...]] = {
    "jawOpen": (("aa", 1.0), ("a", 1.0)),
    "mouthFunnel": (("oh", 0.8), ("o", 0.8)),
    "mouthPucker": (("ou", 0.8), ("u", 0.8)),
    "mouthStretchLeft": (("ih", 0.5), ("i", 0.5)),
    "mouthStretchRight": (("ih", 0.5), ("i", 0.5)),
    "mouthSmileLeft": (("happy", 0.4), ("joy", 0.4)),
    "mouthSmileRight": (("happy", 0.4), ("joy", 0.4)),
    "mouthFrownLeft": (("sad", 0.3), ("sorrow", 0.3)),
    "mouthFrownRight": (("sad", 0.3), ("sorrow", 0.3)),
    "browInnerUp": (("surprised", 0.4),),
    "browDownLeft": (("angry", 0.3),),
    "browDownRight": (("angry", 0.3),),
    "eyeBlinkLeft": (("blinkLeft", 1.0), ("blink_l", 1.0), ("blink", 0.5)),
    "eyeBlinkRight": (("blinkRight", 1.0), ("blink_r", 1.0), ("blink", 0.5)),
}
"""Presets of VRM for ARKit shapes, each with its weight: of 1.0, then 0.x."""
_FALLBACKS: dict[str, dict[str, tuple[tuple[str, float], ...]]] = {
    "VRM's presets": ARKIT_TO_VRM_PRESETS,
    "Oculus visemes": {
        "jawOpen": (("viseme_aa", 1.0),),
        "mouthFunnel": (("viseme_O", 0.8),),
        "mouthPucker": (("viseme_U", 0.8),),
        "mouthStretchLeft": (("viseme_E", 0.4), ("viseme_I", 0.4)),
        "mouthStretchRight": (("viseme_E", 0.4), ("viseme_I", 0.4)),
        "mouthClose": (("viseme_PP", 0.8),),
        "mouthPressLeft": (("viseme_PP", 0.4),),
        "mouthPressRight": (("viseme_PP", 0.4),),
        "mouthRollLower": (("viseme_FF", 0.6),),
        "eyeBlinkLeft": (("eyesClosed", 0.5), ("blink", 0.5)),
        "eyeBlinkRight": (("eyesClosed", 0.5), ("blink", 0.5)),
    },
}
"""For each ARKit shape, the first of these that the character has, with its weight."""


def _plain(name: str) -> str:
    """Simplify a name: lower case, no punctuation, sides in full, no prefix."""
    name = _SIDES.sub(lambda side: {"l": "Left", "r": "Right"}[side[1].lower()], name)
    return re.sub(r"[^a-z0-9]", "", re.split(r"[.:]", name)[-1].lower())


class FaceBlendshapes:
    """Offsets of the expression components on the zero pose, collected primitive by primitive."""

    def __init__(self, gltf: Gltf, names: tuple[str, ...]) -> None:
        self._gltf = gltf
        self._names = names
        self._binds = self._read_binds()
        self._weights: dict[int, ComponentWeightsByTarget] = {}  # by mesh
        self.remark = self._assign()
        self._rows: list[tuple[np.ndarray, np.ndarray]] = []
        self._count = 0

    def _read_binds(self) -> dict[str, list[tuple[int, int, float]]]:
        """Return mesh, target and weight of each named shape: of meshes, then of VRM's groups."""
        binds: dict[str, list[tuple[int, int, float]]] = {}
        meshes = self._gltf.document.get("meshes", ())
        for mesh, described in enumerate(meshes):
            extras = described.get("extras") or {}
            names = extras.get("targetNames") if isinstance(extras, dict) else None
            primitive = described["primitives"][0]
            if names is None:
                names = (primitive.get("extras") or {}).get("targetNames", ())
            for target, name in enumerate(names[: len(primitive.get("targets", ()))]):
                binds.setdefault(_plain(str(name)), []).append((mesh, target, 1.0))
        extensions = self._gltf.document.get("extensions", {})
        groups = extensions.get("VRM", {}).get("blendShapeMaster", {}).get("blendShapeGroups", ())
        matches: dict[str, list[tuple[int, int, float]]] = {}
        for group in groups:
            bound = [(b["mesh"], b["index"], b["weight"] / 100) for b in group.get("binds") or ()]
            for name in (group.get("presetName", ""), group.get("name", "")):
                matches[_plain(str(name))] = bound
        expressions = extensions.get("VRMC_vrm", {}).get("expressions", {})
        for kind in ("custom", "preset"):
            for name, each in (expressions.get(kind) or {}).items():
                matches[_plain(name)] = [
                    (self._gltf.element("nodes", b["node"])["mesh"], b["index"], b["weight"])
                    for b in each.get("morphTargetBinds") or ()
                ]
        return binds | {name: bound for name, bound in matches.items() if bound and name}

    def _assign(self) -> str:
        """Choose the shapes of each component; return the sentence on what moves the face."""
        matches = {name: ((name, 1.0),) for name in self._names if _plain(name) in self._binds}
        kind = f"{len(matches)} of ARKit's 52 blendshapes"
        if len(matches) < 10:
            for title, table in _FALLBACKS.items():
                matches = {
                    name: next(((n, w),) for n, w in each if _plain(n) in self._binds)
                    for name, each in table.items()
                    if any(_plain(n) in self._binds for n, _ in each)
                }
                kind = title
                if len(matches) >= 3:
                    break
        if len(matches) < 3:
            self._driven: frozenset[str] = frozenset()
            missing = "The character's face has no known blendshapes"
            return f"{missing}; jaw and eyes move only if they have bones"
        for name, shapes in matches.items():
            for shape, share in shapes:
                for mesh, target, weight in self._binds[_plain(shape)]:
                    of_target = self._weights.setdefault(mesh, {}).setdefault(target, {})
                    component = self._names.index(name)
                    of_target[component] = of_target.get(component, 0.0) + share * weight
        self._driven = frozenset(matches)
        return f"The character's face is animated with {kind}"

    def is_driven(self, expression_name: str) -> bool:
        """Check whether an expression component moves the face."""
        return expression_name in self._driven

    def target_weights_by_mesh(self) -> dict[int, ComponentWeightsByTarget]:
        """Return the component weights of each target, by mesh of the file."""
        return self._weights

    def driven_targets(self, mesh: int, primitive: int) -> list[int]:
        """Return the targets of a primitive that any expression component moves."""
        described = self._gltf.element("meshes", mesh)["primitives"][primitive]
        count = len(described.get("targets", ()))
        return [
            each
            for each in self._weights.get(mesh, {})
            if 0 <= each < count and "POSITION" in described["targets"][each]
        ]

    def add_primitive(
        self, mesh: int, primitive: int, matrices: Float64[np.ndarray, "V 3 3"], targets: list[int]
    ) -> None:
        """Add a primitive's vertices, whose offsets go to the zero pose by ``matrices``."""
        described = self._gltf.element("meshes", mesh)["primitives"][primitive].get("targets", ())
        offsets = np.zeros((len(self._names) if targets else 0, len(matrices), 3), np.float32)
        for target in targets:
            moved = self._gltf.accessor_array(described[target]["POSITION"]).astype(np.float64)
            moved = np.einsum("vab,vb->va", matrices, moved)
            for component, weight in self._weights[mesh][target].items():
                offsets[component] += weight * moved
        moving = np.flatnonzero((np.abs(offsets) > _MIN_OFFSET_M).any(axis=(0, 2)))
        if len(moving):
            self._rows.append((moving + self._count, offsets[:, moving]))
        self._count += len(matrices)

    def expression_offsets(self) -> tuple[Int64[np.ndarray, " M"], Float32[np.ndarray, "E M 3"]]:
        """Return the vertices that any component moves, and their offsets by component (m)."""
        if not self._rows:
            return np.zeros(0, np.int64), np.zeros((len(self._names), 0, 3), np.float32)
        return (
            np.concatenate([vertices for vertices, _ in self._rows]),
            np.concatenate([offsets for _, offsets in self._rows], axis=1),
        )
