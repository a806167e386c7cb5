/**
 * Motion as it is displayed: tremble made large, smoothed, and how much each joint jerks. All of it
 * follows from the motion alone, by the same rules as the videos'.
 */

import { belowCutoff, derivative, gaussian, savgol } from "./filters.js";
import { forwardKinematics, jointPositions, Motion, NUM_JOINTS, smoothSigns } from "./motion.js";

const HEAT_SIGMA = 3; // frames: jerk of one is chance, and would flicker
const AS_THEY_ARE = ["jaw", "left_eye", "right_eye"]; // speech and gaze are quick by nature
const LEAST_FRAMES = 4;

/** One motion with whatever is shown of it, each thing worked out when it is first asked for. */
export class Shown {
  #skeleton;
  #maxTurn;
  #raw;
  #versions = new Map();
  #split = null; // slow and fast parts at a cut-off
  #world;
  #pose;

  /** `skeleton` as a Mesh has it; `maxTurn` limits what is multiplied, radians. */
  constructor(motion, skeleton, maxTurn) {
    this.#raw = motion;
    this.#skeleton = skeleton;
    this.#maxTurn = maxTurn;
    this.#world = new Float32Array(12 * NUM_JOINTS);
    this.#pose = { position: new Float32Array(3), rotations: new Float32Array(4 * NUM_JOINTS) };
  }

  get length() {
    return this.#raw.length;
  }

  /** As generated, or smoothed: the motion, where its joints are, and how they jerk. */
  version(isSmoothed) {
    if (!this.#versions.has(isSmoothed)) {
      const motion = isSmoothed ? smoothed(this.#raw) : this.#raw;
      const places = jointPositions(this.#skeleton, motion);
      this.#versions.set(isSmoothed, { motion, places, jerk: null });
    }
    return this.#versions.get(isSmoothed);
  }

  /** Jerk of all joints, (T, J) in m/s³, evened out over neighbouring frames. */
  jerk(isSmoothed) {
    const version = this.version(isSmoothed);
    version.jerk ??= gaussian(derivative(version.places, NUM_JOINTS, 3), NUM_JOINTS, HEAT_SIGMA);
    return version.jerk;
  }

  /**
   * Where each joint stands at a moment, in frames from the first: 3 x 4 matrices, which the next
   * call overwrites. `look` says `isSmoothed`, `factor` and `cutoff` (Hz).
   */
  world(moment, { isSmoothed, factor, cutoff }) {
    const last = this.length - 1;
    const frame = Math.max(0, Math.min(Math.floor(moment), last));
    const next = Math.min(frame + 1, last);
    const share = Math.max(0, Math.min(moment - frame, 1));
    const { position, rotations } = this.#pose;
    this.#poseOf(frame, isSmoothed, factor, cutoff, position, rotations, 0);
    if (share > 0 && next > frame) this.#poseOf(next, isSmoothed, factor, cutoff, position, rotations, share);
    return forwardKinematics(this.#skeleton, rotations, position, this.#world);
  }

  /** Face weights at a frame, bytes. */
  faces(moment) {
    const frame = Math.max(0, Math.min(Math.floor(moment), this.length - 1));
    const { faces, numFaces } = this.#raw;
    return faces.subarray(numFaces * frame, numFaces * (frame + 1));
  }

  /** One frame's pose blended into what is there by a share; 0 puts it there. */
  #poseOf(frame, isSmoothed, factor, cutoff, position, rotations, share) {
    const { motion } = this.version(isSmoothed);
    const isPlain = factor === 1 || motion.length < LEAST_FRAMES;
    const split = isPlain ? null : this.#splitAt(motion, cutoff);
    const mix = (to, at, value) => (to[at] = share ? to[at] + share * (value - to[at]) : value);
    for (let k = 0; k < 3; k++) {
      const value = motion.positions[3 * frame + k];
      const slow = split ? split.positions[3 * frame + k] : value;
      mix(position, k, slow + factor * (value - slow));
    }
    for (let joint = 0; joint < NUM_JOINTS; joint++) {
      const from = 4 * (NUM_JOINTS * frame + joint);
      if (!split || split.isAsItIs[joint]) {
        for (let i = 0; i < 4; i++) mix(rotations, 4 * joint + i, motion.rotations[from + i]);
        continue;
      }
      const made = multiplied(split, 3 * (NUM_JOINTS * frame + joint), from, factor, this.#maxTurn);
      let dot = 0;
      if (share) for (let i = 0; i < 4; i++) dot += made[i] * rotations[4 * joint + i];
      for (let i = 0; i < 4; i++) mix(rotations, 4 * joint + i, dot < 0 ? -made[i] : made[i]);
    }
  }

  #splitAt(motion, cutoff) {
    if (this.#split?.motion !== motion || this.#split.cutoff !== cutoff) {
      this.#split = { motion, cutoff, ...parts(motion, cutoff), isAsItIs: this.#skeleton.names.map((name) => AS_THEY_ARE.includes(name)) };
    }
    return this.#split;
  }
}

/** The slow part of a motion, and the turn (axis times angle) from it to the motion itself. */
function parts(motion, cutoff) {
  const six = rows(motion.rotations);
  const slow = quaternions(belowCutoff(six, 6 * NUM_JOINTS, cutoff));
  const turns = new Float32Array((3 * slow.length) / 4);
  for (let at = 0, to = 0; at < slow.length; at += 4, to += 3) {
    let [x, y, z, w] = times(-slow[at], -slow[at + 1], -slow[at + 2], slow[at + 3], motion.rotations, at);
    if (w < 0) [x, y, z, w] = [-x, -y, -z, -w];
    const sine = Math.hypot(x, y, z);
    const scale = sine > 1e-9 ? (2 * Math.atan2(sine, w)) / sine : 2;
    turns.set([x * scale, y * scale, z * scale], to);
  }
  return { slow, turns, positions: belowCutoff(motion.positions, 3, cutoff) };
}

/** The slow rotation with a turn multiplied on it. */
function multiplied({ slow, turns }, turn, rotation, factor, maxTurn) {
  const angle = Math.hypot(turns[turn], turns[turn + 1], turns[turn + 2]);
  if (angle < 1e-9) return slow.subarray(rotation, rotation + 4);
  const half = Math.min(factor * angle, maxTurn) / 2;
  const scale = Math.sin(half) / angle;
  const [x, y, z, w] = [slow[rotation], slow[rotation + 1], slow[rotation + 2], slow[rotation + 3]];
  return times(x, y, z, w, [turns[turn] * scale, turns[turn + 1] * scale, turns[turn + 2] * scale, Math.cos(half)], 0);
}

/** Behind the filter: each rotation by its rows, the place and the face. */
function smoothed(motion) {
  const rotations = quaternions(savgol(rows(motion.rotations), 6 * NUM_JOINTS));
  const faces = Uint8Array.from(savgol(motion.faces, motion.numFaces), (value) => Math.max(0, Math.min(255, Math.round(value))));
  return new Motion(savgol(motion.positions, 3), rotations, faces, motion.numFaces);
}

/** Quaternion products. */
export function times(ax, ay, az, aw, b, at) {
  const [bx, by, bz, bw] = [b[at], b[at + 1], b[at + 2], b[at + 3]];
  return [
    aw * bx + ax * bw + ay * bz - az * by,
    aw * by - ax * bz + ay * bw + az * bx,
    aw * bz + ax * by - ay * bx + az * bw,
    aw * bw - ax * bx - ay * by - az * bz,
  ];
}

/** The first two rows of each rotation's matrix. */
export function rows(rotations) {
  const six = new Float32Array((6 * rotations.length) / 4);
  for (let at = 0, to = 0; at < rotations.length; at += 4, to += 6) {
    let [x, y, z, w] = [rotations[at], rotations[at + 1], rotations[at + 2], rotations[at + 3]];
    const length = Math.hypot(x, y, z, w) || 1;
    (x /= length), (y /= length), (z /= length), (w /= length);
    six.set([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), 2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)], to);
  }
  return six;
}

/** Rotations again from what a filter has left of their rows (Gram and Schmidt). */
export function quaternions(six) {
  const rotations = new Float32Array((4 * six.length) / 6);
  for (let at = 0, to = 0; at < six.length; at += 6, to += 4) {
    const [a, b, c] = unit(six[at], six[at + 1], six[at + 2]);
    const along = a * six[at + 3] + b * six[at + 4] + c * six[at + 5];
    const [d, e, f] = unit(six[at + 3] - along * a, six[at + 4] - along * b, six[at + 5] - along * c);
    rotations.set(quaternion(a, b, c, d, e, f, b * f - c * e, c * d - a * f, a * e - b * d), to);
  }
  return smoothSigns(rotations);
}

function unit(x, y, z) {
  const length = Math.hypot(x, y, z) || 1;
  return [x / length, y / length, z / length];
}

/** Of a matrix, row by row. */
function quaternion(a, b, c, d, e, f, g, h, i) {
  const trace = a + e + i;
  let q;
  if (trace > 0) q = [h - f, c - g, d - b, 1 + trace];
  else if (a > e && a > i) q = [1 + a - e - i, b + d, c + g, h - f];
  else if (e > i) q = [b + d, 1 - a + e - i, f + h, c - g];
  else q = [c + g, f + h, 1 - a - e + i, d - b];
  const length = Math.hypot(...q);
  return q.map((part) => part / length);
}
