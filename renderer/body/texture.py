"""Colours and textures of a character: one atlas of all its pictures, with alpha as a cut-out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64, Integer, UInt8
from PIL import Image

from renderer.body.gltf import Gltf

ATLAS_PX = 2048
_PADDING_PX = 4
_MAX_TILES = 4
"""Repetitions of a picture along one axis that are laid out; more are wrapped vertex by vertex."""
_MAX_PICTURES = 64
_CLAMP = 33071
_OPAQUE_ALPHA = 0.5
"""Alpha from which a blended material is drawn; it has no half-transparent parts here."""


@dataclass(frozen=True, eq=False)
class Texture:
    """Texture of a body. Its colour is the vertex colour times the texture's, squared (gamma 2)."""

    uv: Float32[np.ndarray, "V 2"]
    """Texture coordinates as in glTF: (0, 0) is the first pixel of the first row."""
    colors: Float32[np.ndarray, "V 3"]
    """Linear RGB of the vertices, 0 to 1."""
    pixels: UInt8[np.ndarray, "H W 4"]
    """Display colours; where alpha is below 128 nothing is drawn."""
    is_double_sided: Bool[np.ndarray, " V"]
    """True for vertices of materials that are visible from behind."""
    welds: Int64[np.ndarray, " V"]
    """Vertex whose normal each vertex shares: the first at the same place that faces its way."""

    def for_vertices(self, vertices: Integer[np.ndarray, " N"]) -> Texture:
        """Return the texture of some vertices."""
        place = np.full(len(self.uv), -1)
        place[vertices] = np.arange(len(vertices))
        welds = place[self.welds[vertices]]
        return replace(
            self,
            uv=self.uv[vertices],
            colors=self.colors[vertices],
            is_double_sided=self.is_double_sided[vertices],
            welds=np.where(welds < 0, np.arange(len(vertices)), welds),
        )

    def without_image(self) -> Texture:
        """Return the surface without its pixels."""
        return replace(self, pixels=np.full((8, 8, 4), 255, np.uint8))


class TextureAtlasBuilder:
    """Collector of the materials of a file's primitives, from which one texture is made."""

    def __init__(self, gltf: Gltf) -> None:
        self._gltf = gltf
        self.missing = 0
        """Number of pictures that could not be read."""
        self._pictures: dict[tuple, Image.Image] = {(): Image.new("RGBA", (8, 8), "white")}
        self._uv: list[np.ndarray] = []
        self._colors: list[np.ndarray] = []
        self._keys: list[tuple] = []
        self._double: list[np.ndarray] = []

    def add_primitive(self, primitive: dict, num_vertices: int) -> None:
        """Add the texture of a primitive's vertices."""
        gltf, attributes = self._gltf, primitive["attributes"]
        material: dict = {}
        if "material" in primitive:
            material = gltf.element("materials", primitive["material"])
        extensions = material.get("extensions", {})
        gloss = extensions.get("KHR_materials_pbrSpecularGlossiness", {})
        pbr = material.get("pbrMetallicRoughness", {})
        factor = pbr.get("baseColorFactor") or gloss.get("diffuseFactor") or (1, 1, 1, 1)
        reference = pbr.get("baseColorTexture") or gloss.get("diffuseTexture")
        factor = np.clip(np.array(factor, np.float32).reshape(4), 0, 1)
        colors = np.tile(factor[:3], (num_vertices, 1))
        if "COLOR_0" in attributes:
            painted = gltf.accessor_array(attributes["COLOR_0"])[:, :3]
            most = 1 if painted.dtype.kind == "f" else np.iinfo(painted.dtype).max
            colors = colors * np.clip(painted / np.float32(most), 0, 1)
        uv, key = np.zeros((num_vertices, 2), np.float32) + 0.5, ()
        if reference is not None:
            read = self._textured(reference, material, float(factor[3]), attributes)
            self.missing += read is None
            uv, key = read or (uv, key)
        self._uv.append(uv)
        self._colors.append(colors.astype(np.float32))
        self._keys.append(key)
        self._double.append(np.full(num_vertices, bool(material.get("doubleSided", False))))

    def _textured(
        self, reference: dict, material: dict, alpha: float, attributes: dict
    ) -> tuple[np.ndarray, tuple] | None:
        """Return texture coordinates and the key of their picture, or None if it is unreadable."""
        gltf = self._gltf
        texture = gltf.element("textures", reference["index"])
        webp = texture.get("extensions", {}).get("EXT_texture_webp", {})
        source = webp.get("source", texture.get("source"))
        moved = reference.get("extensions", {}).get("KHR_texture_transform", {})
        channel = moved.get("texCoord", reference.get("texCoord", 0))
        if source is None or f"TEXCOORD_{channel}" not in attributes:
            return None
        uv = gltf.accessor_array(attributes[f"TEXCOORD_{channel}"]).astype(np.float64)
        angle, scale = moved.get("rotation", 0.0), np.array(moved.get("scale", (1, 1)))
        cos, sin = np.cos(angle), np.sin(angle)
        uv = (uv * scale) @ np.array([[cos, sin], [-sin, cos]]) + moved.get("offset", (0, 0))
        if not np.isfinite(uv).all():
            return None
        sampler = gltf.element("samplers", texture["sampler"]) if "sampler" in texture else {}
        if sampler.get("wrapS") == _CLAMP:
            uv = uv.clip(0, 1)
        first = np.floor(uv.min(axis=0) + 1e-3)
        tiles = np.maximum(np.ceil(uv.max(axis=0) - 1e-3) - first, 1)
        if tiles.max() > _MAX_TILES:
            uv, first, tiles = uv % 1.0, np.zeros(2), np.ones(2)
        mode = material.get("alphaMode", "OPAQUE")
        cutoff = float(material.get("alphaCutoff", 0.5)) if mode == "MASK" else _OPAQUE_ALPHA
        cutoff = cutoff / max(alpha, 1e-3) if mode in ("MASK", "BLEND") else -1.0
        across, down = int(tiles[0]), int(tiles[1])
        key = (source, across, down, cutoff)
        if key not in self._pictures:
            # The first few keep their detail; the memory of many small files is bounded.
            max_px = ATLAS_PX if len(self._pictures) <= 8 else ATLAS_PX // 2
            picture = gltf.image(source, max_px)
            if picture is None or len(self._pictures) > _MAX_PICTURES:
                return None
            self._pictures[key] = _laid_out(picture, across, down, cutoff)
        return ((uv - first) / tiles).clip(0, 1).astype(np.float32), key

    def build(
        self, positions: Float64[np.ndarray, "V 3"], normals: Float64[np.ndarray, "V 3"]
    ) -> Texture:
        """Return the texture of all primitives in the order in which they were added."""
        keys = list(self._pictures)
        pixels, boxes = pack_texture_atlas([self._pictures[key] for key in keys])
        size = np.array([pixels.shape[1], pixels.shape[0]])
        uv = []
        for key, of_part in zip(self._keys, self._uv, strict=True):
            left, top, width, height = boxes[keys.index(key)]
            # From the middle of the first pixel to that of the last: no neighbour shines through.
            uv.append((np.array([left, top]) + 0.5 + of_part * (width - 1, height - 1)) / size)
        return Texture(
            uv=np.concatenate(uv).astype(np.float32),
            colors=np.concatenate(self._colors),
            pixels=pixels,
            is_double_sided=np.concatenate(self._double),
            welds=_welds(positions, normals),
        )


def _welds(
    positions: Float64[np.ndarray, "V 3"], normals: Float64[np.ndarray, "V 3"]
) -> Int64[np.ndarray, " V"]:
    """Return the first vertex at the same place (0.01 mm) whose normal is within 60 degrees."""
    _, first, group = np.unique(
        np.rint(positions * 1e5), axis=0, return_index=True, return_inverse=True
    )
    welds = first[group.ravel()]
    cosine = (normals[welds] * normals).sum(axis=1)
    lengths = np.linalg.norm(normals[welds], axis=1) * np.linalg.norm(normals, axis=1)
    return np.where(cosine >= 0.5 * lengths, welds, np.arange(len(welds)))


def _laid_out(picture: Image.Image, across: int, down: int, cutoff: float) -> Image.Image:
    """Repeat a picture, and make its alpha 255 where it is drawn and 0 elsewhere."""
    picture.thumbnail((ATLAS_PX // across, ATLAS_PX // down))
    pixels = np.array(picture)
    pixels[..., 3] = np.where(pixels[..., 3] >= 255 * cutoff, 255, 0)
    return Image.fromarray(np.tile(pixels, (down, across, 1)))


def pack_texture_atlas(
    pictures: list[Image.Image],
) -> tuple[UInt8[np.ndarray, "H W 4"], list[tuple[int, int, int, int]]]:
    """Lay pictures out in rows of one atlas, all smaller by one factor if they do not fit.

    Returns the atlas, and the left, top, width and height of each picture in it.
    """
    scale = 1.0
    while True:
        sizes = [
            (max(8, int(scale * each.width)), max(8, int(scale * each.height))) for each in pictures
        ]
        boxes, height = _shelves(sizes)
        if height <= ATLAS_PX:
            break
        scale *= 0.93
    sheet = np.zeros((max(1, height), ATLAS_PX, 4), np.uint8)
    pad = _PADDING_PX
    for picture, (left, top, width, tall) in zip(pictures, boxes, strict=True):
        pixels = np.asarray(picture.resize((width, tall)))
        padded = np.pad(pixels, ((pad, pad), (pad, pad), (0, 0)), "edge")
        sheet[top - pad : top + tall + pad, left - pad : left + width + pad] = padded
    return sheet, boxes


def _shelves(sizes: list[tuple[int, int]]) -> tuple[list[tuple[int, int, int, int]], int]:
    """Place rectangles in rows, the tallest first; return them with the height of all rows."""
    boxes: dict[int, tuple[int, int, int, int]] = {}
    left = top = row = 0
    for index in sorted(range(len(sizes)), key=lambda each: -sizes[each][1]):
        width, height = (size + 2 * _PADDING_PX for size in sizes[index])
        if width > ATLAS_PX:
            return [], ATLAS_PX + 1
        if left + width > ATLAS_PX:
            left, top, row = 0, top + row, 0
        boxes[index] = (left + _PADDING_PX, top + _PADDING_PX, *sizes[index])
        left, row = left + width, max(row, height)
    return [boxes[index] for index in range(len(sizes))], top + row
