"""Drawing with pyrender and OpenGL; import this module only through `offscreen.load_opengl`."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pyrender
import trimesh
from jaxtyping import Bool, Float, Int, UInt8
from OpenGL import GL
from pyrender.constants import RenderFlags
from pyrender.shader_program import ShaderProgram, ShaderProgramCache
from scipy import sparse
from scipy.sparse import csgraph
from trimesh.visual import TextureVisuals

from renderer.body.texture import Texture
from renderer.draw.lighting import SHADERS
from renderer.scene.camera import Z_NEAR_M, Camera
from renderer.scene.studio import ROUGHNESS, STUDIO, Light, PosedFrame, StaticBody

SUPERSAMPLE = 2
"""Samples along each side of a pixel."""
BLOCK_PX = 16
"""Size of blocks (pixels): drawn rectangles begin and end at whole blocks."""


class Canvas(pyrender.Renderer):
    """Drawing surface of one subject in the context of an open `OffscreenRenderer`.

    It runs pyrender's forward pass into framebuffers from which only colours are read. pyrender
    itself always multisamples, reads the depth back and converts it; a video needs none of that.
    The body is supersampled within its own rectangle and composited over the ground, which has no
    edges to smooth. While the camera does not move, the ground is drawn only where the shadow is or
    was, and the picture is composited and read only where body or shadow are or were. The context
    must be current when a canvas is made and whenever it is used.
    """

    def __init__(self, subject: StaticBody, width: int, height: int) -> None:
        has_alpha = subject.is_transparent
        super().__init__(width, height)
        self._program_cache = ShaderProgramCache(shader_dir=str(SHADERS))
        self._programs: dict[object, ShaderProgram] = {}
        self._lit_programs: set[ShaderProgram] = set()
        self._subject = subject
        self._floor_m = float(subject.ground_corners[0, 1])
        self._body: BodyScene | None = None
        self._camera: Camera | None = None
        self._whole = self._covered = self._changed = Box(0, 0, width, height)
        self._shadow = Box(0, 0, 0, 0)
        self._unresolved: Box | None = None
        self._viewport = self._whole.gl_rect
        self._format = GL.GL_RGBA if has_alpha else GL.GL_RGB
        self._pixels = np.empty((height, width, 4 if has_alpha else 3), np.uint8)
        self._samples = _Framebuffer(1, 1)
        self._ground, self._picture = _Framebuffer(width, height), _Framebuffer(width, height)
        self._no_vertices = GL.glGenVertexArrays(1)

    def begin_frame(self, frame: PosedFrame, camera: Camera) -> None:
        """Start drawing a frame; the driver continues while this process does something else."""
        if self._body is None:
            aspect = self._whole.width / self._whole.height
            self._body = BodyScene(self._subject, frame, camera, aspect)
        else:
            self._body.update(frame, camera)
        body = self._box_of(frame.vertices, camera)
        shadow = self._box_of(frame.shadow_corners, camera)
        covered, is_reusable = body.union(shadow), camera == self._camera
        self._changed = covered.union(self._covered) if is_reusable else self._whole
        ground = shadow.union(self._shadow) if is_reusable else self._whole
        self._covered, self._shadow, self._camera = covered, shadow, camera
        GL.glEnable(GL.GL_SCISSOR_TEST)
        if ground.width and ground.height:
            GL.glScissor(*ground.gl_rect)
            self._pass(self._ground, self._whole, "ground")
        GL.glDisable(GL.GL_SCISSOR_TEST)
        if body.width and body.height:
            self._make_room(body)
            # The ground hides what is below it from a camera above.
            is_hiding = camera.eye[1] > self._floor_m and not self._subject.is_transparent
            (GL.glEnable if is_hiding else GL.glDisable)(GL.GL_CLIP_DISTANCE0)
            self._pass(self._samples, self._sampled(body), "body")
        self._unresolved = body
        GL.glFlush()

    def read_pixels(self) -> UInt8[np.ndarray, "H W C"]:
        """Return the picture that was begun last, upper row first; the next call overwrites it.

        A fourth channel is the share of each pixel that the body covers, with straight (not
        premultiplied) colours as in PNG.
        """
        self._resolve()
        box = self._changed
        GL.glBindFramebuffer(GL.GL_READ_FRAMEBUFFER, self._picture.handle)
        GL.glPixelStorei(GL.GL_PACK_ALIGNMENT, 1)
        GL.glPixelStorei(GL.GL_PACK_ROW_LENGTH, self._whole.right)
        GL.glReadPixels(
            *box.gl_rect,
            self._format,
            GL.GL_UNSIGNED_BYTE,
            GL.GLvoidp(self._pixels[box.bottom :, box.left :].ctypes.data),
        )
        GL.glPixelStorei(GL.GL_PACK_ROW_LENGTH, 0)
        picture = self._pixels[::-1]
        if not self._subject.is_transparent:
            return picture
        alpha = picture[..., 3:].astype(np.float32)
        colors = (picture[..., :3] * (255.0 / np.maximum(alpha, 1.0))).clip(0, 255)
        return np.concatenate([colors.round().astype(np.uint8), picture[..., 3:]], axis=2)

    def draw(self, frame: PosedFrame, camera: Camera) -> UInt8[np.ndarray, "H W C"]:
        """Draw a picture and wait for it."""
        self.begin_frame(frame, camera)
        return self.read_pixels()

    def delete(self) -> None:
        """Free all OpenGL objects; pyrender calls this once more when the object is collected."""
        super().delete()
        for framebuffer in (self._samples, self._ground, self._picture):
            framebuffer.delete()

    def _box_of(self, points: Float[np.ndarray, "N 3"], camera: Camera) -> "Box":
        """Return the pixels that a mesh of these points may cover, in whole blocks."""
        if not len(points):
            return Box(0, 0, 0, 0)
        width, height = self._whole.right, self._whole.top
        pixels = np.ascontiguousarray(camera.project(points, width, height).T)
        low, high = pixels.min(axis=1), pixels.max(axis=1)
        if not np.isfinite(low).all():
            return self._whole  # a point behind the camera cannot be projected
        left, upper = (low - 1.0) // BLOCK_PX * BLOCK_PX
        right, lower = -((-high - 1.0) // BLOCK_PX) * BLOCK_PX
        left, right = (int(min(max(each, 0), width)) for each in (left, right))
        bottom, top = (int(min(max(height - each, 0), height)) for each in (lower, upper))
        return Box(left, bottom, right, top)

    def _make_room(self, body: "Box") -> None:
        """Enlarge the framebuffer of samples to a box, if it is smaller.

        It is cleared as a whole, which the driver does at once, unlike a part of it.
        """
        size = (SUPERSAMPLE * body.width, SUPERSAMPLE * body.height)
        if any(new > old for new, old in zip(size, self._samples.size, strict=True)):
            size = tuple(map(max, size, self._samples.size))
            self._samples.delete()
            self._samples = _Framebuffer(*size)

    def _sampled(self, body: "Box") -> "Box":
        """Return the pixels that the framebuffer of samples holds: a box and what is beyond it."""
        width, height = (each // SUPERSAMPLE for each in self._samples.size)
        return Box(body.left, body.bottom, body.left + width, body.bottom + height)

    def _pass(
        self, framebuffer: "_Framebuffer", box: "Box", layer: Literal["body", "ground"]
    ) -> None:
        """Draw body or ground into a framebuffer that holds a box of the picture."""
        assert self._body is not None
        self._main_fb_ms = framebuffer.handle
        scale = framebuffer.size[0] // box.width
        left, bottom, _, _ = box.gl_rect
        shown = (-left, -bottom, self._whole.width, self._whole.height)
        self._viewport = tuple(scale * each for each in shown)
        self._body.show_only(layer)
        self.render(self._body.scene, RenderFlags.OFFSCREEN)

    def _resolve(self) -> None:
        """Composite the supersampled body over the ground, once, after waiting for the samples."""
        body, self._unresolved = self._unresolved, None
        if body is None:
            return
        GL.glBindFramebuffer(GL.GL_DRAW_FRAMEBUFFER, self._picture.handle)
        GL.glBindFramebuffer(GL.GL_READ_FRAMEBUFFER, self._ground.handle)
        box = self._changed
        corners = box.left, box.bottom, box.right, box.top
        GL.glBlitFramebuffer(*corners, *corners, GL.GL_COLOR_BUFFER_BIT, GL.GL_NEAREST)
        if not body.width or not body.height:
            return
        program = self._program_cache.get_program("resolve.vert", "resolve.frag")
        if not program._in_context():
            program._add_to_context()
        GL.glViewport(*self._sampled(body).gl_rect)
        GL.glEnable(GL.GL_SCISSOR_TEST)
        GL.glScissor(*body.gl_rect)
        for state in (GL.GL_DEPTH_TEST, GL.GL_CULL_FACE):
            GL.glDisable(state)
        GL.glBlendFunc(GL.GL_ONE, GL.GL_ONE_MINUS_SRC_ALPHA)  # colours are premultiplied
        GL.glActiveTexture(GL.GL_TEXTURE0)
        GL.glBindTexture(GL.GL_TEXTURE_2D, self._samples.colors)
        program._bind()
        GL.glBindVertexArray(self._no_vertices)
        GL.glDrawArrays(GL.GL_TRIANGLES, 0, 3)
        GL.glBindVertexArray(0)
        program._unbind()
        GL.glBindTexture(GL.GL_TEXTURE_2D, 0)
        GL.glDisable(GL.GL_SCISSOR_TEST)

    # pyrender calls these around and within its forward pass.

    def _configure_main_framebuffer(self) -> None:
        """Keep the framebuffer that `_pass` has set."""

    def _configure_forward_pass_viewport(self, flags: int) -> None:
        super()._configure_forward_pass_viewport(flags)
        GL.glViewport(*self._viewport)

    def _read_main_framebuffer(self, scene: object, flags: int) -> None:
        """Leave the colours in the framebuffer."""

    def _delete_main_framebuffer(self) -> None:
        self._main_fb_ms = None

    def _get_primitive_program(
        self, primitive: object, flags: int, program_flags: int
    ) -> ShaderProgram:
        """Return the program of a mesh, looked up once; it stores a uniform only if it is new."""
        program = self._programs.get(primitive)
        if program is None:
            program = super()._get_primitive_program(primitive, flags, program_flags)
            self._programs[primitive] = program
            if not isinstance(program.set_uniform, _Uniforms):
                program.set_uniform = _Uniforms(program.set_uniform)
        return program

    def _bind_lighting(
        self, scene: object, program: ShaderProgram, node: object, flags: int
    ) -> None:
        """Set lights and floor of a program once: they never change and stay in the program."""
        if program not in self._lit_programs:
            super()._bind_lighting(scene, program, node, flags)
            program.set_uniform("floor_m", self._floor_m)
            self._lit_programs.add(program)


class _Uniforms:
    """pyrender's ``set_uniform`` of a program without calls that would change nothing."""

    def __init__(self, set_uniform: Callable[[str, Any], None]) -> None:
        self._set_uniform, self._values = set_uniform, dict[str, object]()

    def __call__(self, name: str, value: Any) -> None:
        key = value.tobytes() if isinstance(value, np.ndarray) else value
        if self._values.get(name) != key:
            self._values[name] = key
            self._set_uniform(name, value)


@dataclass(frozen=True)
class Box:
    """Rectangle of a picture in pixels, from the lower left corner as in OpenGL."""

    left: int
    bottom: int
    right: int
    top: int

    @property
    def width(self) -> int:
        return self.right - self.left

    @property
    def height(self) -> int:
        return self.top - self.bottom

    @property
    def gl_rect(self) -> tuple[int, int, int, int]:
        """Left, bottom, width and height."""
        return self.left, self.bottom, self.width, self.height

    def union(self, other: "Box") -> "Box":
        """Return the smallest box around both."""
        return Box(
            min(self.left, other.left),
            min(self.bottom, other.bottom),
            max(self.right, other.right),
            max(self.top, other.top),
        )


class _Framebuffer:
    """OpenGL framebuffer: a colour texture with a depth buffer, and their handles."""

    def __init__(self, width: int, height: int) -> None:
        self.size = width, height
        self.handle, self._depth = GL.glGenFramebuffers(1), GL.glGenRenderbuffers(1)
        self.colors = GL.glGenTextures(1)
        GL.glBindTexture(GL.GL_TEXTURE_2D, self.colors)
        pixels = (GL.GL_RGBA, GL.GL_UNSIGNED_BYTE, None)
        GL.glTexImage2D(GL.GL_TEXTURE_2D, 0, GL.GL_RGBA8, width, height, 0, *pixels)
        for of_filter in (GL.GL_TEXTURE_MIN_FILTER, GL.GL_TEXTURE_MAG_FILTER):
            GL.glTexParameteri(GL.GL_TEXTURE_2D, of_filter, GL.GL_LINEAR)
        for axis in (GL.GL_TEXTURE_WRAP_S, GL.GL_TEXTURE_WRAP_T):
            GL.glTexParameteri(GL.GL_TEXTURE_2D, axis, GL.GL_CLAMP_TO_EDGE)
        GL.glBindTexture(GL.GL_TEXTURE_2D, 0)
        GL.glBindRenderbuffer(GL.GL_RENDERBUFFER, self._depth)
        GL.glRenderbufferStorage(GL.GL_RENDERBUFFER, GL.GL_DEPTH_COMPONENT24, width, height)
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self.handle)
        GL.glFramebufferTexture2D(
            GL.GL_FRAMEBUFFER, GL.GL_COLOR_ATTACHMENT0, GL.GL_TEXTURE_2D, self.colors, 0
        )
        GL.glFramebufferRenderbuffer(
            GL.GL_FRAMEBUFFER, GL.GL_DEPTH_ATTACHMENT, GL.GL_RENDERBUFFER, self._depth
        )

    def delete(self) -> None:
        """Free the handles; a second call does nothing, since another context may own them."""
        if self.handle:
            GL.glDeleteFramebuffers(1, [self.handle])
            GL.glDeleteRenderbuffers(1, [self._depth])
            GL.glDeleteTextures([self.colors])
            self.handle = 0


OPENING_M = 0.04
"""Distance from an opening (m) within which insides of sleeves and collars are drawn."""


class DynamicMesh:
    """Lit mesh of some faces of a moving body: pyrender's buffer, rewritten in place."""

    def __init__(
        self,
        frame: PosedFrame,
        colors: Float[np.ndarray, "V 3"],
        faces: Int[np.ndarray, "F 3"],
        texture: Texture | None = None,
    ) -> None:
        """Make the mesh.

        The frame has all vertices of the body, as for ``update``; those not in ``faces`` are left
        out. Colours are multiplied by the texture.
        """
        self._used, faces = _in_order(faces)
        held = trimesh.Trimesh(
            frame.vertices[self._used],
            faces,
            vertex_normals=frame.normals[self._used],
            process=False,
        )
        rgba = np.concatenate([colors, np.ones((len(colors), 1))], axis=1)[self._used]
        # Float factors: pyrender divides integer ones by 255.
        white = pyrender.MetallicRoughnessMaterial(
            baseColorFactor=[1.0, 1.0, 1.0, 1.0], metallicFactor=0.0, roughnessFactor=ROUGHNESS
        )
        if texture is not None:
            # pyrender puts row 0 of a texture at v = 1, glTF at v = 0.
            pixels = np.ascontiguousarray(texture.pixels[::-1])
            white.baseColorTexture = pyrender.Texture(source=pixels, source_channels="RGBA")
        self.mesh = pyrender.Mesh.from_trimesh(held, material=white)
        (self._primitive,) = self.mesh.primitives
        self._primitive.color_0 = rgba.astype(np.float32)
        # The layout of pyrender's vertex buffer: position, normal, texture coordinates, colour.
        parts = [held.vertices, held.vertex_normals, rgba]
        if texture is not None:
            self._primitive.texcoord_0 = texture.uv[self._used]
            parts.insert(2, texture.uv[self._used])
        self._interleaved = np.concatenate(parts, axis=1).astype(np.float32)

    def enable_back_faces(self) -> None:
        """Draw back faces too."""
        self._primitive.material.doubleSided = True

    def update(self, frame: PosedFrame) -> None:
        """Set vertices, normals and, if the frame has them, colours, after the first drawing."""
        self._interleaved[:, 0:3] = frame.vertices[self._used]
        self._interleaved[:, 3:6] = frame.normals[self._used]
        if frame.colors is not None:
            self._interleaved[:, -4:-1] = frame.colors[self._used]
        GL.glBindBuffer(GL.GL_ARRAY_BUFFER, self._primitive._buffers[0])
        GL.glBufferSubData(GL.GL_ARRAY_BUFFER, 0, self._interleaved.nbytes, self._interleaved)
        GL.glBindBuffer(GL.GL_ARRAY_BUFFER, 0)


def _in_order(
    faces: Int[np.ndarray, "F 3"],
) -> tuple[Int[np.ndarray, " N"], Int[np.ndarray, "F 3"]]:
    """Return the vertices of faces, and the faces among them, neighbours one after the other.

    The driver lights a vertex again for each face that is too far from the last face with it: with
    this order 5 % of the vertices, 36 % in the order of the body's file.
    """
    used, corners = np.unique(faces, return_inverse=True)
    faces, count = corners.reshape(-1, 3), len(used)
    edges = np.concatenate([faces[:, each] for each in ([0, 1], [1, 2], [2, 0])])
    joined = sparse.csr_array((np.ones(len(edges)), edges.T), shape=(count, count))
    order = csgraph.reverse_cuthill_mckee((joined + joined.T).tocsr(), symmetric_mode=True)
    place = np.empty(count, np.intp)
    place[order] = np.arange(count)
    faces = place[faces]
    return used[order], faces[np.argsort(faces.min(axis=1), kind="stable")]


def faces_near_openings(
    faces: Int[np.ndarray, "F 3"], vertices: Float[np.ndarray, "V 3"]
) -> Bool[np.ndarray, " F"]:
    """Return a mask of faces that may be visible from inside, being near to where a mesh ends.

    Such ends are sleeves and collars. Farther in, front faces hide back faces, which need not be
    drawn. Vertices at the same position are merged: seams of colours or normals are not openings.
    """
    joined = trimesh.Trimesh(vertices, faces, process=False)
    joined.merge_vertices()
    ends = trimesh.grouping.group_rows(joined.edges_sorted, require_count=1)
    if not len(ends):
        return np.zeros(len(faces), np.bool_)
    edges, count = joined.edges_unique, len(joined.vertices)
    lengths = sparse.csr_array((joined.edges_unique_length, edges.T), shape=(count, count))
    distance_m = csgraph.dijkstra(
        lengths,
        directed=False,
        indices=np.unique(joined.edges_sorted[ends]),
        min_only=True,
        limit=OPENING_M,
    )
    return np.asarray(np.isfinite(distance_m)[joined.faces].any(axis=1))


class TexturedQuad:
    """Unlit textured square with a picture that may change every frame."""

    def __init__(
        self, corners: Float[np.ndarray, "4 3"], pixels: UInt8[np.ndarray, "R R 3"]
    ) -> None:
        """Make the square.

        Corners are at texture coordinates (0,0), (1,0), (1,1), (0,1); pixel row 0 is at v = 0.
        """
        held = trimesh.Trimesh(
            corners,
            [[0, 2, 1], [0, 3, 2]],
            visual=TextureVisuals(uv=[[0, 0], [1, 0], [1, 1], [0, 1]]),
            process=False,
        )
        # pyrender puts row 0 of a texture at v = 1, OpenGL and ``set_pixels`` at v = 0.
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
        self._texture = self.mesh.primitives[0].material.baseColorTexture  # pyrender's copy

    def set_pixels(self, pixels: UInt8[np.ndarray, "R R 3"]) -> None:
        """Set another picture of the same size, after the first drawing."""
        rows, columns, _ = pixels.shape
        GL.glActiveTexture(GL.GL_TEXTURE0)
        GL.glBindTexture(GL.GL_TEXTURE_2D, self._texture._texid)
        GL.glPixelStorei(GL.GL_UNPACK_ALIGNMENT, 1)
        GL.glTexSubImage2D(
            GL.GL_TEXTURE_2D, 0, 0, 0, columns, rows, GL.GL_RGB, GL.GL_UNSIGNED_BYTE, pixels
        )
        GL.glBindTexture(GL.GL_TEXTURE_2D, 0)


class BodyScene:
    """pyrender scene of one body on the floor, updated in place from frame to frame."""

    def __init__(
        self, subject: StaticBody, first: PosedFrame, camera: Camera, aspect: float
    ) -> None:
        colors = subject.colors if first.colors is None else first.colors
        texture = subject.texture
        if texture is None:
            is_open = faces_near_openings(subject.faces, first.vertices)
        else:
            is_open = texture.is_double_sided[subject.faces[:, 0]]
        if texture is not None and first.colors is not None:
            texture = texture.without_image()  # only the colours of the overlay are seen
        self._body = [
            DynamicMesh(first, colors, subject.faces[each], texture)
            for each in (~is_open, is_open)
            if each.any()
        ]
        if is_open.any():
            self._body[-1].enable_back_faces()
        self._ground = (
            None
            if subject.is_transparent
            else TexturedQuad(subject.ground_corners, first.ground_pixels)
        )
        self._background = (0.0,) * 4 if subject.is_transparent else (*STUDIO.background, 1.0)
        self.scene = _Scene(ambient_light=[STUDIO.ambient] * 3)
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
            facing = Camera(eye=light.direction_to_light, target=(0.0, 0.0, 0.0))
            self.scene.add(
                pyrender.DirectionalLight(color=light.color, intensity=light.intensity),
                name=name,
                pose=facing.pose(),
            )

    def show_only(self, layer: Literal["body", "ground"]) -> None:
        """Show only the body, or only the ground and background."""
        is_body = layer == "body"
        for part in self._body:
            part.mesh.is_visible = is_body
        if self._ground:
            self._ground.mesh.is_visible = not is_body
        self.scene.bg_color = np.array((0.0,) * 4 if is_body else self._background)

    def update(self, frame: PosedFrame, camera: Camera) -> None:
        """Update body, shadow and camera after the first drawing; the context must be current."""
        self.scene.set_pose(self._camera, camera.pose())
        for part in self._body:
            part.update(frame)
        if self._ground:
            self._ground.set_pixels(frame.ground_pixels)


class _Scene(pyrender.Scene):
    """Scene with ordered lights.

    pyrender stores lights in a set ordered by memory address: the shader would sum them in another
    order in each process, and some pixels would round to another grey level.
    """

    @property
    def light_nodes(self) -> list[pyrender.Node]:
        return sorted(super().light_nodes, key=lambda node: node.name)
