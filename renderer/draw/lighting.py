"""Shaders of the bodies, and the part of them that browsers share."""

from pathlib import Path

SHADERS = Path(__file__).with_name("shaders")
_BEGIN, _END = "// Browsers light bodies by the same lines, from here on:", "// As far as here."


def lighting_shader_source() -> str:
    """Return the lighting code that pyrender and the browser (``app/page/web/stage``) compile."""
    shader = (SHADERS / "mesh.vert").read_text("utf-8")
    return shader.partition(_BEGIN)[2].partition(_END)[0].partition("\n")[2]
