/** Skeletons and the axes of joints, as flat lines over a panel. */

import { projected } from "./framing.js";

const BONE = [0.98, 0.98, 0.98];
const EDGE = [0.1, 0.14, 0.18];
const AXES = [[0.86, 0.2, 0.16], [0.2, 0.62, 0.24], [0.16, 0.38, 0.9]]; // x, y and z
const AXIS_M = 0.07;
const FINE_AXIS_M = 0.018; // of fingers and face

/**
 * Corners for `Painter.ink`: a line from each joint to its parent.
 *
 * @param {Float32Array} world Of the joints, 3 x 4 one after the other.
 * @param {ArrayLike<number>} parents
 * @param {number[]} matrix Of the camera.
 * @param {[number, number]} size Pixels of the panel.
 * @param {number[]} shift Metres.
 * @param {number[] | null} drawn Joints that the panel shows; null for all.
 */
export function boneCorners(world, parents, matrix, [width, height], shift, drawn = null) {
  const corners = [];
  const isDrawn = (joint) => !drawn || drawn.includes(joint);
  const places = Array.from(parents, (_, joint) => inPanel(world, joint, [0, 0, 0], matrix, [width, height], shift));
  for (const [wide, color] of [[4, EDGE], [2, BONE]]) {
    for (const [joint, parent] of Array.from(parents).entries()) {
      if (parent >= 0 && isDrawn(joint) && isDrawn(parent)) line(corners, places[parent], places[joint], wide, color, [width, height]);
    }
  }
  return corners;
}

/**
 * The same of three short lines at each joint: where its own x, y and z point. `isFine` says which
 * joints are so near each other that theirs are shorter.
 */
export function axisCorners(world, isFine, matrix, [width, height], shift, drawn = null) {
  const corners = [];
  for (const [joint, fine] of isFine.entries()) {
    if (drawn && !drawn.includes(joint)) continue;
    const at = inPanel(world, joint, [0, 0, 0], matrix, [width, height], shift);
    for (const [axis, color] of AXES.entries()) {
      const offset = [0, 0, 0];
      offset[axis] = fine ? FINE_AXIS_M : AXIS_M;
      line(corners, at, inPanel(world, joint, offset, matrix, [width, height], shift), fine ? 1.5 : 2.5, color, [width, height]);
    }
  }
  return corners;
}

/** Pixels of a point that is rigid with a joint; null behind the camera. */
export function inPanel(world, joint, offset, matrix, [width, height], shift) {
  /** @type {any} */
  const place = [0, 1, 2].map((row) => {
    const at = 12 * joint + 4 * row;
    return world[at] * offset[0] + world[at + 1] * offset[1] + world[at + 2] * offset[2] + world[at + 3] + shift[row];
  });
  const seen = projected(matrix, place);
  return seen && [seen[0] * width, seen[1] * height];
}

/** Adds a line from one pixel to another, if both are known. */
export function line(corners, a, b, wide, color, [width, height]) {
  if (!a || !b) return;
  const length = Math.hypot(b[0] - a[0], b[1] - a[1]) || 1;
  const [x, y] = [(-(b[1] - a[1]) / length) * (wide / 2), ((b[0] - a[0]) / length) * (wide / 2)];
  const quad = [[a[0] + x, a[1] + y], [a[0] - x, a[1] - y], [b[0] + x, b[1] + y], [b[0] - x, b[1] - y]];
  for (const i of [0, 1, 2, 1, 3, 2]) corners.push((2 * quad[i][0]) / width - 1, 1 - (2 * quad[i][1]) / height, ...color);
}
