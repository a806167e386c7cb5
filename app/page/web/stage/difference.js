/** By how many degrees two bodies differ, for each part of the body. */

import { NUM_JOINTS } from "./motion.js";

const DEGREES = 180 / Math.PI;
const FINGERS = "(thumb|index|middle|ring|pinky)";
/** What belongs to a part, by the names of joints; all others are of the face. */
const PARTS = {
  "right arm": /^right_(collar|shoulder|elbow|wrist)/,
  "right hand": new RegExp(`^right_${FINGERS}`),
  "left arm": /^left_(collar|shoulder|elbow|wrist)/,
  "left hand": new RegExp(`^left_${FINGERS}`),
  trunk: /^(pelvis|spine)/,
  head: /^(neck|head)/,
  legs: /_(hip|knee|ankle|foot)/,
};

/** Mean angles between the joints of two motions, each to its parent, frame by frame. */
export class Difference {
  #tracks; // part -> degrees by frame

  /**
   * @param {import("./motion.js").Motion} first
   * @param {import("./motion.js").Motion} second
   * @param {string[]} names Of the joints.
   */
  constructor(first, second, names) {
    this.length = Math.min(first.length, second.length);
    this.#tracks = new Map(
      Object.entries(PARTS).map(([part, pattern]) => {
        const joints = names.map((_, joint) => joint).filter((joint) => joint < NUM_JOINTS && pattern.test(names[joint]));
        return [part, track(first, second, joints, this.length)];
      }),
    );
  }

  /**
   * Degrees by part: the mean of all frames that both have, and at one of them; the most first.
   *
   * @param {number} frame
   */
  at(frame) {
    const now = Math.max(0, Math.min(Math.floor(frame), this.length - 1));
    const found = [...this.#tracks].map(([part, { degrees, mean }]) => ({ part, mean, now: degrees[now] }));
    return found.sort((a, b) => b.mean - a.mean);
  }
}

function track(first, second, joints, length) {
  const degrees = new Float32Array(length);
  let sum = 0;
  for (let frame = 0; frame < length; frame++) {
    for (const joint of joints) degrees[frame] += angle(first.rotations, second.rotations, 4 * (NUM_JOINTS * frame + joint)) / joints.length;
    sum += degrees[frame];
  }
  return { degrees, mean: length ? sum / length : 0 };
}

/** Between two rotations, in degrees; from the way between them, which is exact for small ones too. */
function angle(a, b, at) {
  let [dot, apart, together] = [0, 0, 0];
  for (let i = at; i < at + 4; i++) dot += a[i] * b[i];
  const sign = dot < 0 ? -1 : 1;
  for (let i = at; i < at + 4; i++) {
    apart += (a[i] - sign * b[i]) ** 2;
    together += (a[i] + sign * b[i]) ** 2;
  }
  return 4 * DEGREES * Math.atan2(Math.sqrt(apart), Math.sqrt(together));
}
