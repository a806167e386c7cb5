"""pyrender with OpenGL loaded. Import it only through ``offscreen.open_gl(backend)``."""

import numpy as np
import pyrender
import trimesh
from jaxtyping import Bool, Float, Int, UInt8
from OpenGL import GL
from pyrender.constants import RenderFlags
from pyrender.shader_program import ShaderProgramCache
from trimesh.visual import TextureVisuals

from renderer.draw.offscreen import SHADERS
from renderer.scene.camera import Z_NEAR_M, Camera
from renderer.scene.studio import ROUGHNESS, STUDIO, Light, PosedFrame, Subject

SUPERSAMPLE = 2
"""Samples along each side of a pixel."""


class Canvas(pyrender.Renderer):
    """One subject, drawn within the context of an open `OffscreenRenderer`: pyrender's forward
    pass into a framebuffer that is made for reading colours only.

    pyrender itself always multisamples, reads the depth back and converts it; a video needs none
    of that. The context must be current when this is made and whenever it is used.
    """

    def __init__(self, subject: Subject, width: int, height: int) -> None:
        has_alpha = subject.is_transparent
        super().__init__(SUPERSAMPLE * width, SUPERSAMPLE * height)
        self._program_cache = ShaderProgramCache(shader_dir=str(SHADERS))
        self._subject, self._picture_size = subject, (width, height)
        self._body: BodyScene | None = None
        self._format = GL.GL_RGBA if has_alpha else GL.GL_RGB
        self._pixels = np.empty((height, width, 4 if has_alpha else 3), np.uint8)
        self._canvas = _Framebuffer(self.viewport_width, self.viewport_height, depth=True)
        self._picture = _Framebuffer(width, height, depth=False)

    def begin(self, frame: PosedFrame, camera: Camera) -> None:
        """Have the driver draw, which goes on while this process does something else."""
        if self._body is None:
            width, height = self._picture_size
            self._body = BodyScene(self._subject, frame, camera, width / height)
        else:
            self._body.show(frame, camera)
        self.render(self._body.scene, RenderFlags.OFFSCREEN)  # ends in _read_main_framebuffer

    def picture(self) -> UInt8[np.ndarray, "H W C"]:
        """What was begun last, upper row first; overwritten by the next call. A fourth channel says
        how much of each pixel is covered, by colours that are those of the body itself, as PNG
        wants them."""
        width, height = self._picture_size
        GL.glBindFramebuffer(GL.GL_READ_FRAMEBUFFER, self._picture.handle)
        GL.glPixelStorei(GL.GL_PACK_ALIGNMENT, 1)
        GL.glReadPixels(0, 0, width, height, self._format, GL.GL_UNSIGNED_BYTE, self._pixels)
        picture = self._pixels[::-1]
        if not self._subject.is_transparent:
            return picture
        alpha = picture[..., 3:].astype(np.float32)
        colors = (picture[..., :3] * (255.0 / np.maximum(alpha, 1.0))).clip(0, 255)
        return np.concatenate([colors.round().astype(np.uint8), picture[..., 3:]], axis=2)

    def draw(self, frame: PosedFrame, camera: Camera) -> UInt8[np.ndarray, "H W C"]:
        """Begin a picture and wait for it."""
        self.begin(frame, camera)
        return self.picture()

    def delete(self) -> None:
        """Free everything; pyrender calls this once more when the object is collected."""
        super().delete()
        for framebuffer in (self._canvas, self._picture):
            framebuffer.delete()

    # pyrender calls these two around its forward pass.

    def _configure_main_framebuffer(self) -> None:
        self._main_fb_ms = self._canvas.handle

    def _read_main_framebuffer(self, scene: object, flags: int) -> None:
        width, height = self._picture_size
        GL.glBindFramebuffer(GL.GL_READ_FRAMEBUFFER, self._canvas.handle)
        GL.glBindFramebuffer(GL.GL_DRAW_FRAMEBUFFER, self._picture.handle)
        # A linear blit at half size is the mean of 2 x 2 pixels.
        GL.glBlitFramebuffer(
            *(0, 0, self.viewport_width, self.viewport_height),
            *(0, 0, width, height),
            GL.GL_COLOR_BUFFER_BIT,
            GL.GL_LINEAR,
        )
        GL.glFlush()

    def _delete_main_framebuffer(self) -> None:
        self._main_fb_ms = None


class _Framebuffer:
    """A colour buffer, with a depth buffer if asked for, and its OpenGL handles."""

    def __init__(self, width: int, height: int, *, depth: bool) -> None:
        self.handle = GL.glGenFramebuffers(1)
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self.handle)
        attachments = [(GL.GL_COLOR_ATTACHMENT0, GL.GL_RGBA8)]
        if depth:
            attachments.append((GL.GL_DEPTH_ATTACHMENT, GL.GL_DEPTH_COMPONENT24))
        self._buffers = []
        for attachment, pixel_format in attachments:
            buffer = GL.glGenRenderbuffers(1)
            GL.glBindRenderbuffer(GL.GL_RENDERBUFFER, buffer)
            GL.glRenderbufferStorage(GL.GL_RENDERBUFFER, pixel_format, width, height)
            GL.glFramebufferRenderbuffer(GL.GL_FRAMEBUFFER, attachment, GL.GL_RENDERBUFFER, buffer)
            self._buffers.append(buffer)

    def delete(self) -> None:
        """Free the handles; a second call does nothing, since another context may own them."""
        if self._buffers:
            GL.glDeleteFramebuffers(1, [self.handle])
            GL.glDeleteRenderbuffers(len(self._buffers), self._buffers)
            self._buffers = []


OPENING_EDGES = 4
"""How many edges from an opening the insides of sleeves and collars are drawn."""


class DynamicMesh:
    """Some faces of a body that moves, lit: pyrender's own buffer, rewritten in place."""

    def __init__(
        self, frame: PosedFrame, colors: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]
    ) -> None:
        """
        Args:
            frame: whole, as ``move`` will get it.
            faces: among its vertices; the others are left out.
        """
        self._used, corners = np.unique(faces, return_inverse=True)
        faces = corners.reshape(-1, 3)
        held = trimesh.Trimesh(
            frame.vertices[self._used],
            # Neighbours one after the other: the driver then lights a shared vertex once.
            faces[np.argsort(faces.min(axis=1), kind="stable")],
            vertex_normals=frame.normals[self._used],
            process=False,
        )
        rgba = np.concatenate([colors, np.ones((len(colors), 1))], axis=1)[self._used]
        # Float factors: pyrender divides integer ones by 255.
        white = pyrender.MetallicRoughnessMaterial(
            baseColorFactor=[1.0, 1.0, 1.0, 1.0], metallicFactor=0.0, roughnessFactor=ROUGHNESS
        )
        self.mesh = pyrender.Mesh.from_trimesh(held, material=white)
        (self._primitive,) = self.mesh.primitives
        self._primitive.color_0 = rgba.astype(np.float32)
        # The layout of pyrender's vertex buffer: position, normal, colour.
        parts = [held.vertices, held.vertex_normals, rgba]
        self._interleaved = np.concatenate(parts, axis=1).astype(np.float32)

    def show_insides(self) -> None:
        """Draw faces also where they are turned away."""
        self._primitive.material.doubleSided = True

    def move(self, frame: PosedFrame) -> None:
        """Put the vertices elsewhere, and in other colours if the frame has any; once drawn."""
        self._interleaved[:, 0:3] = frame.vertices[self._used]
        self._interleaved[:, 3:6] = frame.normals[self._used]
        if frame.colors is not None:
            self._interleaved[:, 6:9] = frame.colors[self._used]
        GL.glBindBuffer(GL.GL_ARRAY_BUFFER, self._primitive._buffers[0])
        GL.glBufferSubData(GL.GL_ARRAY_BUFFER, 0, self._interleaved.nbytes, self._interleaved)
        GL.glBindBuffer(GL.GL_ARRAY_BUFFER, 0)


def near_openings(
    faces: Int[np.ndarray, "F 3"], vertices: Float[np.ndarray, "V 3"]
) -> Bool[np.ndarray, " F"]:
    """Faces that one may see from inside: those a few edges from where a mesh ends, as at sleeves
    and collars. Farther in, what is turned away lies behind what is not, and need not be drawn.

    Vertices in one place are one, in whatever pose: seams of colours or normals are no openings.
    """
    joined = trimesh.Trimesh(vertices, faces, process=False)
    joined.merge_vertices()
    ends = trimesh.grouping.group_rows(joined.edges_sorted, require_count=1)
    is_near = np.zeros(len(joined.vertices), np.bool_)
    is_near[joined.edges_sorted[ends]] = True
    for _ in range(OPENING_EDGES):
        is_near[joined.faces[is_near[joined.faces].any(axis=1)]] = True
    return np.asarray(is_near[joined.faces].any(axis=1))


class TexturedQuad:
    """A square that shows a picture as it is, unlit; the picture may change every frame."""

    def __init__(
        self, corners: Float[np.ndarray, "4 3"], pixels: UInt8[np.ndarray, "R R 3"]
    ) -> None:
        """
        Args:
            corners: at texture coordinates (0,0), (1,0), (1,1), (0,1).
            pixels: row 0 lies at texture coordinate v = 0.
        """
        held = trimesh.Trimesh(
            corners,
            [[0, 2, 1], [0, 3, 2]],
            visual=TextureVisuals(uv=[[0, 0], [1, 0], [1, 1], [0, 1]]),
            process=False,
        )
        # pyrender puts row 0 of a texture at v = 1, OpenGL and ``show`` at v = 0.
        texture = pyrender.Texture(
            source=pixels[::-1],
            source_channels="RGB",
            sampler=pyrender.Sampler(
                minFilter=GL.GL_LINEAR,
                magFilter=GL.GL_LINEAR,
                wrapS=GL.GL_CLAMP_TO_EDGE,
                wrapT=GL.GL_CLAMP_TO_EDGE,
            ),
        )
        shown = pyrender.MetallicRoughnessMaterial(baseColorTexture=texture)
        self.mesh = pyrender.Mesh.from_trimesh(held, material=shown)
        self._texture = self.mesh.primitives[0].material.baseColorTexture  # its own copy

    def show(self, pixels: UInt8[np.ndarray, "R R 3"]) -> None:
        """Another picture of the same size; once drawn."""
        rows, columns, _ = pixels.shape
        GL.glActiveTexture(GL.GL_TEXTURE0)
        GL.glBindTexture(GL.GL_TEXTURE_2D, self._texture._texid)
        GL.glPixelStorei(GL.GL_UNPACK_ALIGNMENT, 1)
        GL.glTexSubImage2D(
            *(GL.GL_TEXTURE_2D, 0, 0, 0, columns, rows, GL.GL_RGB, GL.GL_UNSIGNED_BYTE, pixels)
        )
        GL.glBindTexture(GL.GL_TEXTURE_2D, 0)


class BodyScene:
    """A pyrender scene of one body on the floor, moved in place from frame to frame."""

    def __init__(self, subject: Subject, first: PosedFrame, camera: Camera, aspect: float) -> None:
        colors = subject.colors if first.colors is None else first.colors
        is_open = near_openings(subject.faces, first.vertices)
        self._body = [
            DynamicMesh(first, colors, subject.faces[each])
            for each in (~is_open, is_open)
            if each.any()
        ]
        if is_open.any():
            self._body[-1].show_insides()
        self._ground = (
            None if subject.is_transparent else TexturedQuad(subject.ground_corners, first.ground)
        )
        background = (0.0,) * 4 if subject.is_transparent else (*STUDIO.background, 1.0)
        self.scene = _Scene(bg_color=list(background), ambient_light=[STUDIO.ambient] * 3)
        for part in self._body:
            self.scene.add(part.mesh)
        if self._ground:
            self.scene.add(self._ground.mesh)
        self._camera = self.scene.add(
            pyrender.PerspectiveCamera(yfov=camera.yfov_rad, aspectRatio=aspect, znear=Z_NEAR_M),
            pose=camera.pose(),
        )
        for name in ("key", "fill", "rim"):
            light: Light = getattr(STUDIO, name)
            facing = Camera(eye=light.towards, target=(0.0, 0.0, 0.0))
            self.scene.add(
                pyrender.DirectionalLight(color=light.color, intensity=light.intensity),
                name=name,
                pose=facing.pose(),
            )

    def show(self, frame: PosedFrame, camera: Camera) -> None:
        """Move body, shadow and camera, once drawn. The OpenGL context must be current."""
        self.scene.set_pose(self._camera, camera.pose())
        for part in self._body:
            part.move(frame)
        if self._ground:
            self._ground.show(frame.ground)


class _Scene(pyrender.Scene):
    """A scene whose lights have an order.

    pyrender keeps them in a set, by where they lie in memory: the shader would add them up in an
    order of each process's own, and some pixels would round to another grey level.
    """

    @property
    def light_nodes(self) -> list[pyrender.Node]:
        return sorted(super().light_nodes, key=lambda node: node.name)
