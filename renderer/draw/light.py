"""How bodies are lit: one set of numbers and lines, in ``shaders``, for the three that draw them.

* OpenGL by pyrender (`renderer.draw.gl`), by EGL or OSMesa: fastest on a graphics processor.
* Loops compiled by numba (`renderer.draw.rasteriser`): the same pictures where OpenGL is missing.
* WebGL (``app/page/web/stage``): bodies that move in a browser while nothing is drawn here.

OpenGL and WebGL compile the shader's own lines; the loops follow them with the numbers read here.
"""

import re
from pathlib import Path

SHADERS = Path(__file__).with_name("shaders")
MESH_SHADER = SHADERS / "mesh.vert"
MESH_FRAGMENT = SHADERS / "mesh.frag"
_BEGIN, _END = "// Browsers light bodies by the same lines, from here on:", "// As far as here."
_CONSTANT = re.compile(r"^const (?:float|vec3) (\w+) = (?:vec3\()?([\d., -]+)\)?;", re.MULTILINE)


def lighting_source() -> str:
    """How a body is lit, in what the shading languages of OpenGL and WebGL have in common."""
    between = MESH_SHADER.read_text("utf-8").partition(_BEGIN)[2].partition(_END)[0]
    return between.partition("\n")[2]


def constants() -> dict[str, tuple[float, ...]]:
    """The numbers of both shaders by name, one each or three."""
    stated = MESH_SHADER.read_text("utf-8") + MESH_FRAGMENT.read_text("utf-8")
    return {
        name: tuple(float(number) for number in numbers.split(","))
        for name, numbers in _CONSTANT.findall(stated)
    }
