"""Triangles to pixels without OpenGL: the inner loops, compiled by numba.

The light is that of `renderer.draw.light`, once per vertex that is seen; the picture is what the
OpenGL backends draw, to a grey level or two. A test compares their pictures.

Depth is kept as its inverse ``1 / z``, which is linear across the picture: 0 is infinitely far.
"""

import functools
from pathlib import Path

import numpy as np

from renderer.draw.compiled import inner, loop, prepare
from renderer.draw.light import MESH_FRAGMENT, MESH_SHADER, constants
from renderer.scene import studio

_STATED = constants()
_GROUND_BOUNCE, _SKY = _STATED["GROUND_BOUNCE"], _STATED["SKY"]
_WRAP, _SPECULAR, _POLISHED, _MATT, _EDGE, _EXPOSURE, _ROLL_OFF, _INSIDE = (
    _STATED[name][0] for name in "WRAP SPECULAR POLISHED MATT EDGE EXPOSURE ROLL_OFF INSIDE".split()
)
_GLOSS = _POLISHED + studio.ROUGHNESS * (_MATT - _POLISHED)
_DULL = 0.8
"""Facing below which nothing gleams: its power is less than a tenth of a grey level."""
_OUTSIDE = -1e9
_SLIVER = 1e-7
"""Of a sample, by which each row of a triangle is wider, lest rounding leaves a crack."""


@loop("void(f4[:,::1], f8[::1], f8[:,::1], f8, f8[::1], f8[:,::1])")
def project(vertices, eye, axes, focal, middle, corners):
    """Fill ``corners`` (V, 3): column and row in samples, and inverse depth, of each vertex.

    Args:
        eye, axes: of the camera, as `renderer.scene.camera.Camera` has them.
        focal: length in samples.
        middle: column and row of the picture's middle.
    """
    for v in range(len(vertices)):
        x, y, z = vertices[v, 0] - eye[0], vertices[v, 1] - eye[1], vertices[v, 2] - eye[2]
        backward = x * axes[2, 0] + y * axes[2, 1] + z * axes[2, 2]
        inverse = -1.0 / backward
        right = x * axes[0, 0] + y * axes[0, 1] + z * axes[0, 2]
        up = x * axes[1, 0] + y * axes[1, 1] + z * axes[1, 2]
        corners[v, 0] = middle[0] + focal * right * inverse
        corners[v, 1] = middle[1] - focal * up * inverse
        corners[v, 2] = inverse


@inner
def _shade(point, normal, base, eye, towards, lights, ambient, lit):
    """Fill ``lit`` (3,) with the display colour of one vertex, 0 to 1; see `fill_triangles`."""
    nx, ny, nz = normal
    ex, ey, ez = eye[0] - point[0], eye[1] - point[1], eye[2] - point[2]
    scale = 1.0 / np.sqrt(ex * ex + ey * ey + ez * ez)
    ex, ey, ez = ex * scale, ey * scale, ez * scale
    up = 0.5 * ny + 0.5
    edge = 1.0 - max(nx * ex + ny * ey + nz * ez, 0.0)
    rim = _EDGE * edge * edge * edge * edge
    red, green, blue = 0.0, 0.0, 0.0
    shine_red, shine_green, shine_blue = 0.0, 0.0, 0.0
    for i in range(len(towards)):
        lx, ly, lz = towards[i]
        diffuse = (nx * lx + ny * ly + nz * lz + _WRAP) / (1.0 + _WRAP)
        if diffuse <= 0.0:
            continue
        red += diffuse * lights[i, 0]
        green += diffuse * lights[i, 1]
        blue += diffuse * lights[i, 2]
        hx, hy, hz = lx + ex, ly + ey, lz + ez
        facing = (nx * hx + ny * hy + nz * hz) / np.sqrt(hx * hx + hy * hy + hz * hz)
        if facing > _DULL:
            shine = _SPECULAR * diffuse * facing**_GLOSS
            shine_red += shine * lights[i, 0]
            shine_green += shine * lights[i, 1]
            shine_blue += shine * lights[i, 2]
    for channel, direct, gleam in (
        (0, red, shine_red),
        (1, green, shine_green),
        (2, blue, shine_blue),
    ):
        sky = ambient * (_GROUND_BOUNCE[channel] * (1.0 - up) + _SKY[channel] * up)
        value = base[channel] * (sky + direct + rim) + gleam
        value = _EXPOSURE * value / (1.0 + _ROLL_OFF * value)  # rolls off the highlights
        lit[channel] = np.sqrt(min(max(value, 0.0), 1.0))


@loop(
    "void(f4[:,::1], f4[:,::1], f4[:,::1], f8[:,::1], i4[:,::1], b1[::1], f8[::1], f8[:,::1], "
    "f8[:,::1], f8, f8, f4[:,::1], b1[::1], f4[:,::1], f4[:,:,::1], i4[:,::1])"
)
def fill_triangles(
    vertices, normals, colors, corners, faces, has_back, eye, towards, lights, ambient, nearest,
    lit, is_lit, inverse_depth, canvas, spans,
):  # fmt: skip
    """Draw lit triangles into ``canvas`` (H, W, 3), nearer over farther.

    A triangle with a corner that is not a number, behind the camera or before the near plane is
    left out whole: cameras are placed so that a body has none.

    Args:
        vertices, normals, colors: (V, 3), metres, unit length, linear RGB.
        corners: (V, 3), as `project` leaves them.
        has_back: (F,), faces that are drawn from behind too; of the others something hides it.
        eye: (3,) position of the camera.
        towards: (L, 3) unit vectors to the lights.
        lights: (L, 3) linear RGB of each light, times its intensity by pi.
        ambient: share of light that comes from everywhere.
        nearest: 1 / depth of the near plane.
        lit: (V, 3), display colours of the vertices that were seen; updated.
        is_lit: (V,), which those are; updated.
        inverse_depth: (H, W), 0 where nothing is drawn; updated.
        spans: (H, 2), first and last column where a row may be drawn; updated.
    """
    height, width = inverse_depth.shape
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        xa, ya, wa = corners[a, 0], corners[a, 1], corners[a, 2]
        xb, yb, wb = corners[b, 0], corners[b, 1], corners[b, 2]
        xc, yc, wc = corners[c, 0], corners[c, 1], corners[c, 2]
        if not (0.0 < wa <= nearest and 0.0 < wb <= nearest and 0.0 < wc <= nearest):
            continue
        area = (xb - xa) * (yc - ya) - (xc - xa) * (yb - ya)
        if not abs(area) > 0.0:  # seen edge on, or not a number
            continue
        # Sample n lies at n + 0.5. Clamped before they become integers: they may be huge.
        left = int(min(max(np.ceil(min(xa, xb, xc) - 0.5), 0.0), width))
        right = int(max(min(np.floor(max(xa, xb, xc) - 0.5), width - 1.0), -1.0))
        top = int(min(max(np.ceil(min(ya, yb, yc) - 0.5), 0.0), height))
        bottom = int(max(min(np.floor(max(ya, yb, yc) - 0.5), height - 1.0), -1.0))
        if left > right or top > bottom:
            continue
        # Rows run downwards, so a triangle that turns its front has a negative area.
        if area > 0.0 and not has_back[f]:
            continue
        tone = 1.0 if area < 0.0 else _INSIDE
        scale = 1.0 / area
        step_b, step_c = (yc - ya) * scale, (ya - yb) * scale
        step_a = -step_b - step_c
        # Columns from ``left`` on at which a share becomes zero, in the uppermost row: no share is
        # negative between the largest of those at which one grows and the least of the others.
        dy, dx = top + 0.5 - ya, left + 0.5 - xa
        share_b = (dx * (yc - ya) - dy * (xc - xa)) * scale
        share_c = (dy * (xb - xa) - dx * (yb - ya)) * scale
        down_b, down_c = (xa - xc) * scale, (xb - xa) * scale
        first, second, first_down, second_down = _OUTSIDE, _OUTSIDE, 0.0, 0.0
        last, next_last, last_down, next_last_down = -_OUTSIDE, -_OUTSIDE, 0.0, 0.0
        for share, step, down in (
            (1.0 - share_b - share_c, step_a, -down_b - down_c),
            (share_b, step_b, down_b),
            (share_c, step_c, down_c),
        ):
            if step == 0.0:
                continue
            per = -1.0 / step
            if step > 0.0:
                second, second_down = first, first_down
                first, first_down = share * per, down * per
            else:
                next_last, next_last_down = last, last_down
                last, last_down = share * per, down * per
        inverse_at = wa + share_b * (wb - wa) + share_c * (wc - wa)
        inverse_step = step_b * (wb - wa) + step_c * (wc - wa)
        inverse_down = down_b * (wb - wa) + down_c * (wc - wa)
        is_seen = False
        ra, ga, ba, rb, gb, bb, rc, gc, bc = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for below in range(bottom - top + 1):
            row = top + below
            begin = max(first + below * first_down, second + below * second_down) - _SLIVER
            end = min(last + below * last_down, next_last + below * next_last_down) + _SLIVER
            if begin > end:
                continue
            inverse_left = inverse_at + below * inverse_down
            for n in range(
                int(np.ceil(max(begin, 0.0))), int(np.floor(min(end, right - left))) + 1
            ):
                column = left + n
                inverse = inverse_left + n * inverse_step
                if inverse > inverse_depth[row, column]:
                    if not is_seen:
                        is_seen = True
                        for v in (a, b, c):
                            if not is_lit[v]:
                                is_lit[v] = True
                                _shade(
                                    vertices[v], normals[v], colors[v], eye, towards, lights,
                                    ambient, lit[v],
                                )  # fmt: skip
                        # Divided by depth on the way, colours follow the surface in
                        # perspective.
                        ra, ga, ba = (
                            tone * wa * lit[a, 0],
                            tone * wa * lit[a, 1],
                            tone * wa * lit[a, 2],
                        )
                        rb, gb, bb = (
                            tone * wb * lit[b, 0],
                            tone * wb * lit[b, 1],
                            tone * wb * lit[b, 2],
                        )
                        rc, gc, bc = (
                            tone * wc * lit[c, 0],
                            tone * wc * lit[c, 1],
                            tone * wc * lit[c, 2],
                        )
                    inverse_depth[row, column] = inverse
                    at_b = share_b + n * step_b + below * down_b
                    at_c = share_c + n * step_c + below * down_c
                    at_a = 1.0 - at_b - at_c
                    depth = 1.0 / inverse
                    canvas[row, column, 0] = depth * (at_a * ra + at_b * rb + at_c * rc)
                    canvas[row, column, 1] = depth * (at_a * ga + at_b * gb + at_c * gc)
                    canvas[row, column, 2] = depth * (at_a * ba + at_b * bb + at_c * bc)
        if is_seen:
            for row in range(top, bottom + 1):
                spans[row, 0] = min(spans[row, 0], left)
                spans[row, 1] = max(spans[row, 1], right)


@loop("void(i8, f8[:,::1], f8[::1], u1[:,:,::1], f8[::1], u1[:,:,::1])")
def fill_floor(scale, ray, floor, texture, backdrop, pixels):
    """The picture without a body: the floor over the background, one sample a pixel.

    Args:
        scale: samples along each side of a pixel.
        ray: (3, 3) rows: the world direction that a ray of depth 1 gains with each sample to the
            right, with each sample down, and has at the upper left corner. The camera stands
            upright: to the right a ray gains no height.
        floor: eye x, y, z; height of the floor; x and z of its first corner; its side; metres.
        texture: (R, R, 3) uint8 of the floor, unlit.
        backdrop: (3,) display colour, 0 to 255.
        pixels: (H, W, 3) uint8.
    """
    height, width, _ = pixels.shape
    eye_x, eye_y, eye_z, floor_y, first_x, first_z, side = floor
    above = eye_y - floor_y
    last = texture.shape[0] - 1.001
    to_texels = texture.shape[0] / side
    red, green, blue = (
        np.uint8(backdrop[0] + 0.5),
        np.uint8(backdrop[1] + 0.5),
        np.uint8(backdrop[2] + 0.5),
    )
    for row in range(height):
        y = (row + 0.5) * scale
        down = ray[1, 1] * y + ray[2, 1]
        depth = -above / down if down < 0.0 < above else -1.0
        # Texels, from the first to the last column.
        u = (
            eye_x + depth * (0.5 * scale * ray[0, 0] + y * ray[1, 0] + ray[2, 0]) - first_x
        ) * to_texels
        v = (
            eye_z + depth * (0.5 * scale * ray[0, 2] + y * ray[1, 2] + ray[2, 2]) - first_z
        ) * to_texels
        step_u, step_v = (
            depth * scale * ray[0, 0] * to_texels,
            depth * scale * ray[0, 2] * to_texels,
        )
        for column in range(width):
            at_u, at_v = u + column * step_u, v + column * step_v
            if depth < 0.0 or not (0.0 <= at_u <= last + 1.001 and 0.0 <= at_v <= last + 1.001):
                pixels[row, column, 0] = red
                pixels[row, column, 1] = green
                pixels[row, column, 2] = blue
                continue
            at_u = min(max(at_u - 0.5, 0.0), last)
            at_v = min(max(at_v - 0.5, 0.0), last)
            i, j = int(at_v), int(at_u)
            p, q = np.float32(at_v - i), np.float32(at_u - j)
            for channel in range(3):
                upper = np.float32(texture[i, j, channel])
                upper += (np.float32(texture[i, j + 1, channel]) - upper) * q
                lower = np.float32(texture[i + 1, j, channel])
                lower += (np.float32(texture[i + 1, j + 1, channel]) - lower) * q
                pixels[row, column, channel] = np.uint8(
                    upper + (lower - upper) * p + np.float32(0.5)
                )


@loop("void(f4[:,:,::1], f4[:,::1], i4[:,::1], i8, f8[:,::1], f8[::1], u1[:,:,::1])")
def lay_body(canvas, inverse_depth, spans, scale, ray, floor, pixels):
    """Lay the body over the picture of `fill_floor`, or over nothing.

    Each pixel is the mean of its ``scale`` x ``scale`` samples. Arguments are those of
    `fill_triangles` and `fill_floor`; ``pixels`` may be (H, W, 4), with nothing but the body, on
    nothing.
    """
    height, width, channels = pixels.shape
    above = floor[1] - floor[3]
    has_floor = channels == 3 and above > 0.0
    samples = scale * scale
    for row in range(height):
        left, right = width * scale, -1
        for y in range(row * scale, (row + 1) * scale):
            left, right = min(left, spans[y, 0]), max(right, spans[y, 1])
        if left > right:
            continue
        for column in range(left // scale, right // scale + 1):
            red, green, blue = np.float32(0.0), np.float32(0.0), np.float32(0.0)
            count = 0
            for y in range(row * scale, (row + 1) * scale):
                down = ray[1, 1] * (y + 0.5) + ray[2, 1]
                sunk = -down / above if has_floor else 0.0
                for x in range(column * scale, (column + 1) * scale):
                    inverse = inverse_depth[y, x]
                    if inverse > 0.0 and inverse >= sunk:
                        count += 1
                        red += canvas[y, x, 0]
                        green += canvas[y, x, 1]
                        blue += canvas[y, x, 2]
            if count == 0:
                continue
            if channels == 4:
                by = np.float32(255.0 / count)
                pixels[row, column, 0] = np.uint8(by * red + 0.5)
                pixels[row, column, 1] = np.uint8(by * green + 0.5)
                pixels[row, column, 2] = np.uint8(by * blue + 0.5)
                pixels[row, column, 3] = np.uint8(255.0 * count / samples + 0.5)
                continue
            by, behind = np.float32(255.0 / samples), np.float32(1.0 - count / samples)
            half = np.float32(0.5)
            pixels[row, column, 0] = np.uint8(by * red + behind * pixels[row, column, 0] + half)
            pixels[row, column, 1] = np.uint8(by * green + behind * pixels[row, column, 1] + half)
            pixels[row, column, 2] = np.uint8(by * blue + behind * pixels[row, column, 2] + half)


LOOPS = (project, fill_triangles, fill_floor, lay_body)
SOURCES = (Path(__file__), MESH_SHADER, MESH_FRAGMENT, Path(studio.__file__))


@functools.cache
def make_ready() -> None:
    """Have the loops' machine code at hand, as every process must before it calls one."""
    prepare(LOOPS, SOURCES, _draw_one_triangle)


def _draw_one_triangle() -> None:
    """Call each loop once, for a picture of four pixels."""
    side, one = 4, np.ones(3)
    vertices = np.array([[-1, -1, -2], [1, -1, -2], [0, 1, -2]], np.float32)
    corners, axes = np.empty((3, 3)), np.eye(3)
    project(vertices, np.zeros(3), axes, float(side), np.array([2.0, 2.0]), corners)
    depth, canvas = np.zeros((side, side), np.float32), np.zeros((side, side, 3), np.float32)
    spans = np.tile(np.array([side, -1], np.int32), (side, 1))
    normals = np.tile(np.array([0, 0, 1], np.float32), (3, 1))
    faces = np.array([[0, 1, 2]], np.int32)
    fill_triangles(
        *(vertices, normals, normals, corners, faces, np.ones(1, np.bool_), np.zeros(3)),
        *(normals.astype(np.float64), np.eye(3), 0.5, 10.0, np.empty((3, 3), np.float32)),
        *(np.zeros(3, np.bool_), depth, canvas, spans),
    )
    pixels = np.zeros((2, 2, 3), np.uint8)
    floor = np.array([0.0, 1.0, 0.0, 0.0, -1.0, -1.0, 2.0])
    fill_floor(2, axes, floor, np.zeros((4, 4, 3), np.uint8), one, pixels)
    lay_body(canvas, depth, spans, 2, axes, floor, pixels)
