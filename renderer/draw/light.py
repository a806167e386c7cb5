"""How bodies are lit: one set of numbers and lines, in ``shaders``, for pyrender
(`renderer.draw.gl`) and for the bodies that move in a browser (``app/page/web/stage``): both
compile the same lines.
"""

from pathlib import Path

SHADERS = Path(__file__).with_name("shaders")
MESH_SHADER = SHADERS / "mesh.vert"
_BEGIN, _END = "// Browsers light bodies by the same lines, from here on:", "// As far as here."


def lighting_source() -> str:
    """How a body is lit, in what the shading languages of OpenGL and WebGL have in common."""
    between = MESH_SHADER.read_text("utf-8").partition(_BEGIN)[2].partition(_END)[0]
    return between.partition("\n")[2]
