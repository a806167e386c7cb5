/** Equal noise on the local or on the global rotations of a motion, as model/motion/transforms.py has it. */

import { times } from "./displays.js";
import { rigid } from "./bones.js";
import { forwardKinematics, Motion, NUM_JOINTS, smoothSigns } from "./motion.js";

const FACE = ["jaw", "left_eye", "right_eye"];

/** Normal numbers with deviation 1, the same at every call. */
export function normals(count) {
  let state = 20260;
  const uniform = () => {
    state = (state + 0x6d2b79f5) | 0;
    let mixed = Math.imul(state ^ (state >>> 15), 1 | state);
    mixed = (mixed + Math.imul(mixed ^ (mixed >>> 7), 61 | mixed)) ^ mixed;
    return ((mixed ^ (mixed >>> 14)) >>> 0) / 2 ** 32;
  };
  return Float32Array.from({ length: count }, () => Math.sqrt(-2 * Math.log(1 - uniform())) * Math.cos(2 * Math.PI * uniform()));
}

let drawn = new Float32Array(); // longer motions begin with the noise of shorter ones

/**
 * Add the same random turns, of `rad` about each axis, to the rotations of every joint but the face. With noise on
 * global rotations a joint also loses that of its parent.
 *
 * @param {Motion} motion
 * @param {"local" | "global"} space
 * @param {number} rad
 * @param {{ parents: ArrayLike<number>, names: string[] }} skeleton
 */
export function noisy(motion, space, rad, { parents, names }) {
  if (drawn.length < 3 * NUM_JOINTS * motion.length) drawn = normals(3 * NUM_JOINTS * motion.length);
  const unit = drawn;
  const turns = new Float32Array(4 * NUM_JOINTS * motion.length);
  const rotations = Float32Array.from(motion.rotations);
  for (let at = 0, from = 0; at < turns.length; at += 4, from += 3) {
    const joint = (at / 4) % NUM_JOINTS;
    if (FACE.includes(names[joint])) continue;
    const angle = rad * Math.hypot(unit[from], unit[from + 1], unit[from + 2]);
    const scale = angle ? (rad * Math.sin(angle / 2)) / angle : 0;
    turns.set([scale * unit[from], scale * unit[from + 1], scale * unit[from + 2], Math.cos(angle / 2)], at);
    let [x, y, z, w] = rotations.subarray(at, at + 4);
    if (space === "global" && parents[joint] >= 0) {
      const [a, b, c, d] = turns.subarray(at + 4 * (parents[joint] - joint));
      [x, y, z, w] = times(-a, -b, -c, d, [x, y, z, w], 0);
    }
    rotations.set(times(x, y, z, w, turns, at), at);
  }
  return new Motion(motion.positions, smoothSigns(rotations), motion.faces, motion.numFaces);
}

/**
 * Root mean square distance (m) of a point of one motion from where it is in another, relative to the root.
 *
 * @param {Motion} motion
 * @param {Motion} other
 * @param {{ parents: ArrayLike<number>, offsets: ArrayLike<number> }} skeleton
 * @param {{ joint: number, offset: number[] }} point
 */
export function distance(motion, other, skeleton, { joint, offset }) {
  const world = new Float32Array(12 * NUM_JOINTS);
  const place = ({ rotations }, frame) => rigid(forwardKinematics(skeleton, rotations.subarray(4 * NUM_JOINTS * frame), [0, 0, 0], world), joint, offset);
  let square = 0;
  for (let frame = 0; frame < motion.length; frame++) {
    const [a, b] = [place(motion, frame), place(other, frame)];
    for (let k = 0; k < 3; k++) square += (a[k] - b[k]) ** 2 / motion.length;
  }
  return Math.sqrt(square);
}
