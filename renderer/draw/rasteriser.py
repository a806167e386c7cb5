"""Triangles to pixels without OpenGL: the inner loops, compiled by numba.

The light is that of ``shaders/mesh.vert``, once per vertex; the picture is what the OpenGL
backends draw, to a grey level or two. A change to one is a change to the other; a test compares
their pictures.

Depth is kept as its inverse ``1 / z``, which is linear across the picture: 0 is infinitely far.
"""

import numpy as np

from renderer.draw.compiled import compiled

_GROUND_BOUNCE = (0.72, 0.68, 0.65)
_SKY = (1.05, 1.10, 1.20)
_WRAP = 0.20
_SPECULAR = 0.06
_GLOSS = 96.0 + 0.7 * (8.0 - 96.0)  # of roughness 0.7
_EDGE = 0.10
_INSIDE = 0.35


@compiled
def shade(vertices, normals, colors, eye, towards, lights, ambient, lit):
    """Fill ``lit`` (V, 3) with display colours, 0 to 1.

    Args:
        vertices, normals, colors: (V, 3), metres, unit length, linear RGB.
        eye: (3,) position of the camera.
        towards: (L, 3) unit vectors to the lights.
        lights: (L, 3) linear RGB of each light, times its intensity by pi.
        ambient: share of light that comes from everywhere.
    """
    for v in range(len(vertices)):
        nx, ny, nz = normals[v]
        ex, ey, ez = eye[0] - vertices[v, 0], eye[1] - vertices[v, 1], eye[2] - vertices[v, 2]
        scale = 1.0 / np.sqrt(ex * ex + ey * ey + ez * ez)
        ex, ey, ez = ex * scale, ey * scale, ez * scale
        up = 0.5 * ny + 0.5
        edge = 1.0 - max(nx * ex + ny * ey + nz * ez, 0.0)
        rim = _EDGE * edge * edge * edge * edge
        red, green, blue = 0.0, 0.0, 0.0
        shine_red, shine_green, shine_blue = 0.0, 0.0, 0.0
        for i in range(len(towards)):
            lx, ly, lz = towards[i]
            diffuse = max((nx * lx + ny * ly + nz * lz + _WRAP) / (1.0 + _WRAP), 0.0)
            hx, hy, hz = lx + ex, ly + ey, lz + ez
            facing = (nx * hx + ny * hy + nz * hz) / np.sqrt(hx * hx + hy * hy + hz * hz)
            shine = _SPECULAR * diffuse * max(facing, 0.0) ** _GLOSS
            red += diffuse * lights[i, 0]
            green += diffuse * lights[i, 1]
            blue += diffuse * lights[i, 2]
            shine_red += shine * lights[i, 0]
            shine_green += shine * lights[i, 1]
            shine_blue += shine * lights[i, 2]
        for channel, direct, gleam in (
            (0, red, shine_red),
            (1, green, shine_green),
            (2, blue, shine_blue),
        ):
            sky = ambient * (_GROUND_BOUNCE[channel] * (1.0 - up) + _SKY[channel] * up)
            value = colors[v, channel] * (sky + direct + rim) + gleam
            value = 1.12 * value / (1.0 + 0.22 * value)  # rolls off the highlights
            lit[v, channel] = np.sqrt(min(max(value, 0.0), 1.0))


@compiled
def fill_triangles(corners, faces, lit, nearest, inverse_depth, canvas):
    """Draw lit triangles into ``canvas`` (H, W, 3), nearer over farther.

    A triangle with a corner that is not a number, behind the camera or before the near plane is
    left out whole: cameras are placed so that a body has none.

    Args:
        corners: (V, 3) column and row in samples, and 1 / depth, of each vertex.
        nearest: 1 / depth of the near plane.
        inverse_depth: (H, W), 0 where nothing is drawn; updated.
    """
    height, width = inverse_depth.shape
    for f in range(len(faces)):
        a, b, c = faces[f]
        xa, ya, wa = corners[a]
        xb, yb, wb = corners[b]
        xc, yc, wc = corners[c]
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
        # Rows run downwards, so a triangle that turns its front has a negative area.
        tone = 1.0 if area < 0.0 else _INSIDE
        scale = 1.0 / area
        step_b, step_c = (yc - ya) * scale, (ya - yb) * scale
        for row in range(top, bottom + 1):
            dy = row + 0.5 - ya
            dx = left + 0.5 - xa
            share_b = (dx * (yc - ya) - dy * (xc - xa)) * scale
            share_c = (dy * (xb - xa) - dx * (yb - ya)) * scale
            for column in range(left, right + 1):
                share_a = 1.0 - share_b - share_c
                if share_a >= 0.0 and share_b >= 0.0 and share_c >= 0.0:
                    pa, pb, pc = share_a * wa, share_b * wb, share_c * wc
                    inverse = pa + pb + pc
                    if inverse > inverse_depth[row, column]:
                        inverse_depth[row, column] = inverse
                        # Divided by depth on the way, colours follow the surface in perspective.
                        by = tone / inverse
                        for channel in range(3):
                            canvas[row, column, channel] = by * (
                                pa * lit[a, channel] + pb * lit[b, channel] + pc * lit[c, channel]
                            )
                share_b += step_b
                share_c += step_c


@compiled
def resolve(canvas, inverse_depth, scale, ray, floor, texture, backdrop, pixels):
    """The finished picture: the body over the floor over the background.

    Each pixel is the mean of its ``scale`` x ``scale`` samples.

    Args:
        ray: (3, 3) rows: the world direction that a ray of depth 1 gains with each sample to the
            right, with each sample down, and has at the upper left corner.
        floor: eye x, y, z; height of the floor; x and z of its first corner; its side; metres.
        texture: (R, R, 3) uint8 of the floor, unlit.
        backdrop: (3,) display colour, 0 to 255.
        pixels: (H, W, 3) uint8, or (H, W, 4) with nothing but the body, on nothing.
    """
    height, width, channels = pixels.shape
    eye_x, eye_y, eye_z, floor_y, first_x, first_z, side = floor
    above = eye_y - floor_y
    has_floor = channels == 3 and above > 0.0
    resolution = texture.shape[0]
    body = np.empty(3)
    behind = np.empty(3)
    for row in range(height):
        for column in range(width):
            body[:] = 0.0
            count = 0
            for sub in range(scale * scale):
                y, x = row * scale + sub // scale, column * scale + sub % scale
                inverse = inverse_depth[y, x]
                if inverse > 0.0:
                    down = ray[0, 1] * (x + 0.5) + ray[1, 1] * (y + 0.5) + ray[2, 1]
                    if not has_floor or inverse >= -down / above:
                        count += 1
                        for channel in range(3):
                            body[channel] += canvas[y, x, channel]
            share = count / (scale * scale)
            if channels == 4:
                pixels[row, column, 3] = int(255.0 * share + 0.5)
                for channel in range(3):
                    mean = body[channel] / count if count else 0.0
                    pixels[row, column, channel] = int(255.0 * mean + 0.5)
                continue
            if share < 1.0:
                behind[:] = backdrop
                x, y = (column + 0.5) * scale, (row + 0.5) * scale
                down = ray[0, 1] * x + ray[1, 1] * y + ray[2, 1]
                if has_floor and down < 0.0:
                    depth = -above / down
                    u = eye_x + depth * (ray[0, 0] * x + ray[1, 0] * y + ray[2, 0])
                    v = eye_z + depth * (ray[0, 2] * x + ray[1, 2] * y + ray[2, 2])
                    u, v = (u - first_x) / side, (v - first_z) / side
                    if 0.0 <= u <= 1.0 and 0.0 <= v <= 1.0:
                        u = min(max(u * resolution - 0.5, 0.0), resolution - 1.001)
                        v = min(max(v * resolution - 0.5, 0.0), resolution - 1.001)
                        i, j = int(v), int(u)
                        p, q = v - i, u - j
                        for channel in range(3):
                            upper = texture[i, j, channel] * (1.0 - q)
                            upper += texture[i, j + 1, channel] * q
                            lower = texture[i + 1, j, channel] * (1.0 - q)
                            lower += texture[i + 1, j + 1, channel] * q
                            behind[channel] = upper * (1.0 - p) + lower * p
            for channel in range(3):
                front = 255.0 * body[channel] / (scale * scale)
                pixels[row, column, channel] = int(front + (1.0 - share) * behind[channel] + 0.5)
