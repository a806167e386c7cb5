/** Skeletons and the axes of joints, as flat lines over a panel. */

import { projected } from "./framing.js";

const BONE = [0.98, 0.98, 0.98];
const EDGE = [0.1, 0.14, 0.18];
const AXES = [[0.86, 0.2, 0.16], [0.2, 0.62, 0.24], [0.16, 0.38, 0.9]]; // x, y and z
const AXIS_M = 0.07;
const FINE_AXIS_M = 0.018; // of fingers and face

/**
 * A body as a panel shows it: its joints, 3 x 4 one after the other, shifted by metres, through a camera's matrix; pixels of
 * the panel; and the joints that it shows, null for all.
 *
 * @typedef {{ world: Float32Array, shift: number[], matrix: number[], size: [number, number], drawn?: number[] | null }} PanelBody
 */

/** Corners for `Painter.ink`: a line from each joint to its parent. @type {(body: PanelBody, parents: ArrayLike<number>) => number[]} */
export function boneCorners(body, parents) {
  const corners = [];
  const isDrawn = (joint) => !body.drawn || body.drawn.includes(joint);
  const places = Array.from(parents, (_, joint) => inPanel(body, joint, [0, 0, 0]));
  for (const [wide, color] of [[4, EDGE], [2, BONE]]) {
    for (const [joint, parent] of Array.from(parents).entries()) {
      if (parent >= 0 && isDrawn(joint) && isDrawn(parent)) line(corners, places[parent], places[joint], wide, color, body.size);
    }
  }
  return corners;
}

/** The same of three short lines where each joint's own x, y and z point, shorter of the `fine`. @type {(body: PanelBody, fine: boolean[]) => number[]} */
export function axisCorners(body, fine) {
  const corners = [];
  for (const [joint, isFine] of fine.entries()) {
    if (body.drawn && !body.drawn.includes(joint)) continue;
    for (const [axis, color] of AXES.entries()) {
      const end = [0, 0, 0].with(axis, isFine ? FINE_AXIS_M : AXIS_M);
      line(corners, inPanel(body, joint, [0, 0, 0]), inPanel(body, joint, end), isFine ? 1.5 : 2.5, color, body.size);
    }
  }
  return corners;
}

/** Where a point is that is rigid with a joint. */
export function rigid(world, joint, offset) {
  const [x, y, z] = offset;
  return [0, 4, 8].map((row) => {
    const at = 12 * joint + row;
    return world[at] * x + world[at + 1] * y + world[at + 2] * z + world[at + 3];
  });
}

/** Its pixels; null behind the camera. */
export function inPanel({ world, shift, matrix, size }, joint, offset) {
  /** @type {any} */
  const place = rigid(world, joint, offset).map((part, k) => part + shift[k]);
  const projection = projected(matrix, place);
  return projection && projection.map((share, k) => share * size[k]);
}

/** Adds a line from one pixel to another, if both are known. */
export function line(corners, a, b, wide, color, [width, height]) {
  if (!a || !b) return;
  const length = Math.hypot(b[0] - a[0], b[1] - a[1]) || 1;
  const [x, y] = [(-(b[1] - a[1]) / length) * (wide / 2), ((b[0] - a[0]) / length) * (wide / 2)];
  const quad = [[a[0] + x, a[1] + y], [a[0] - x, a[1] - y], [b[0] + x, b[1] + y], [b[0] - x, b[1] - y]];
  for (const i of [0, 1, 2, 1, 3, 2]) corners.push((2 * quad[i][0]) / width - 1, 1 - (2 * quad[i][1]) / height, ...color);
}
