/** Motion as it travels to the browser: "Live frames" of docs/formats.md, one message after the other. */

export const NUM_JOINTS = 55;
export const FPS = 30; // motion frames per second
const HEADER_BYTES = 20;
const DAMAGED = "The motion data from the server is damaged.";

/** What a skeleton does over time. Rotations are quaternions (x, y, z, w) of joints to parents. */
export class Motion {
  /** `positions` (T, 3) of the root besides its place at rest, `rotations` (T, J, 4), `faces` (T, F) bytes. */
  constructor(positions, rotations, faces, numFaces) {
    this.positions = positions;
    this.rotations = rotations;
    this.faces = faces;
    this.numFaces = numFaces;
    this.length = positions.length / 3;
  }

  /** Frames from one on, up to another. */
  part(from, to = this.length) {
    const cut = (values, width) => values.slice(width * from, width * to);
    return new Motion(cut(this.positions, 3), cut(this.rotations, 4 * NUM_JOINTS), cut(this.faces, this.numFaces), this.numFaces);
  }
}

/**
 * Reads messages that follow each other; throws where they are not motion.
 *
 * @param {ArrayBuffer} bytes
 * @param {number} first Number of the frame that they must begin with.
 */
export function unpacked(bytes, first = 0) {
  const parts = [];
  let [frame, numFaces] = [first, 0];
  for (let at = 0; at < bytes.byteLength || !parts.length; ) {
    if (bytes.byteLength - at < HEADER_BYTES) throw new Error(DAMAGED);
    const header = new DataView(bytes, at, HEADER_BYTES);
    const count = header.getUint16(4, true);
    const size = HEADER_BYTES + count * (12 + 8 * NUM_JOINTS + header.getUint16(6, true));
    const isOther = parts.length > 0 && numFaces !== header.getUint16(6, true);
    if (!count || isOther || header.getUint32(0, true) !== frame || at + size > bytes.byteLength) throw new Error(DAMAGED);
    numFaces = header.getUint16(6, true);
    parts.push(message(bytes, at + HEADER_BYTES, count, numFaces));
    frame += count;
    at += size;
  }
  return joined(parts);
}

/** What one message holds after its header. */
function message(bytes, at, count, numFaces) {
  const turnsAt = at + 12 * count;
  const facesAt = turnsAt + 8 * NUM_JOINTS * count;
  const positions = new Float32Array(bytes.slice(at, turnsAt));
  const rotations = Float32Array.from(new Int16Array(bytes.slice(turnsAt, facesAt)), (level) => level / 32767);
  return new Motion(positions, rotations, new Uint8Array(bytes.slice(facesAt, facesAt + numFaces * count)), numFaces);
}

/** One motion of such as follow each other, the same to the bit as if all had come at once. */
export function joined(parts) {
  const all = (Kind, name) => {
    const whole = new Kind(parts.reduce((sum, part) => sum + part[name].length, 0));
    let at = 0;
    for (const part of parts) {
      whole.set(part[name], at);
      at += part[name].length;
    }
    return whole;
  };
  return new Motion(all(Float32Array, "positions"), smoothSigns(all(Float32Array, "rotations")), all(Uint8Array, "faces"), parts[0].numFaces);
}

/**
 * A motion laid onto others: turned about the world's vertical, then shifted.
 *
 * @param {Motion} motion
 * @param {number[]} place The turn (radians), then the shift (metres).
 * @param {ArrayLike<number>} rest Where the root is at rest.
 */
export function placed(motion, [turn, ...shift], rest) {
  const positions = new Float32Array(motion.positions.length);
  const rotations = Float32Array.from(motion.rotations);
  const [sin, cos] = [Math.sin(turn), Math.cos(turn)];
  const [y, w] = [Math.sin(turn / 2), Math.cos(turn / 2)];
  for (let frame = 0; frame < motion.length; frame++) {
    const at = 3 * frame;
    const [x, z] = [motion.positions[at] + rest[0], motion.positions[at + 2] + rest[2]];
    positions[at] = cos * x + sin * z - rest[0] + shift[0];
    positions[at + 1] = motion.positions[at + 1] + shift[1];
    positions[at + 2] = cos * z - sin * x - rest[2] + shift[2];
    const from = 4 * NUM_JOINTS * frame;
    const [a, b, c, d] = motion.rotations.subarray(from, from + 4);
    rotations.set([w * a + y * c, w * b + y * d, w * c - y * a, w * d - y * b], from);
  }
  return new Motion(positions, rotations, motion.faces, motion.numFaces);
}

/**
 * Matrices of a body laid by `to`, taken back towards where `from` laid it by a share; in place.
 *
 * @param {Float32Array} world 3 x 4, row by row, one joint after the other.
 * @param {number[]} from As `placed` takes it.
 * @param {number[]} to
 * @param {number} share
 */
export function partlyBack(world, from, to, share) {
  const turn = from[0] - to[0];
  const [sin, cos] = [Math.sin(turn), Math.cos(turn)];
  const shift = [from[1] - (cos * to[1] + sin * to[3]), from[2] - to[2], from[3] - (cos * to[3] - sin * to[1])];
  const [s, c] = [Math.sin(share * turn), Math.cos(share * turn)];
  for (let at = 0; at < world.length; at += 12) {
    for (let k = at; k < at + 4; k++) [world[k], world[k + 8]] = [c * world[k] + s * world[k + 8], c * world[k + 8] - s * world[k]];
    for (let row = 0; row < 3; row++) world[at + 4 * row + 3] += share * shift[row];
  }
  return world;
}

/** Neighbouring frames get the same sign, so that a mean of them goes the short way; in place. */
export function smoothSigns(rotations, joints = NUM_JOINTS) {
  const width = 4 * joints;
  for (let at = width; at < rotations.length; at += 4) {
    let dot = 0;
    for (let i = at; i < at + 4; i++) dot += rotations[i] * rotations[i - width];
    if (dot < 0) for (let i = at; i < at + 4; i++) rotations[i] = -rotations[i];
  }
  return rotations;
}

/** Where each joint stands: 3 x 4 matrices, row by row, one joint after the other, into `world`. */
export function forwardKinematics({ parents, offsets }, rotations, position, world) {
  for (let joint = 0; joint < parents.length; joint++) {
    const r = 4 * joint;
    let [x, y, z, w] = [rotations[r], rotations[r + 1], rotations[r + 2], rotations[r + 3]];
    const length = Math.sqrt(x * x + y * y + z * z + w * w) || 1;
    (x /= length), (y /= length), (z /= length), (w /= length);
    const m00 = 1 - 2 * (y * y + z * z), m01 = 2 * (x * y - z * w), m02 = 2 * (x * z + y * w);
    const m10 = 2 * (x * y + z * w), m11 = 1 - 2 * (x * x + z * z), m12 = 2 * (y * z - x * w);
    const m20 = 2 * (x * z - y * w), m21 = 2 * (y * z + x * w), m22 = 1 - 2 * (x * x + y * y);
    const o = 3 * joint;
    const [tx, ty, tz] = [offsets[o], offsets[o + 1], offsets[o + 2]];
    const to = 12 * joint;
    const parent = 12 * parents[joint];
    if (parents[joint] < 0) {
      world.set([m00, m01, m02, tx + position[0], m10, m11, m12, ty + position[1], m20, m21, m22, tz + position[2]], to);
      continue;
    }
    for (let row = 0; row < 12; row += 4) {
      const a = world[parent + row], b = world[parent + row + 1], c = world[parent + row + 2];
      world[to + row] = a * m00 + b * m10 + c * m20;
      world[to + row + 1] = a * m01 + b * m11 + c * m21;
      world[to + row + 2] = a * m02 + b * m12 + c * m22;
      world[to + row + 3] = a * tx + b * ty + c * tz + world[parent + row + 3];
    }
  }
  return world;
}

/** Of all frames, (T, J, 3). */
export function jointPositions(skeleton, motion) {
  const joints = skeleton.parents.length;
  const places = new Float32Array(3 * joints * motion.length);
  const world = new Float32Array(12 * joints);
  for (let frame = 0; frame < motion.length; frame++) {
    const rotations = motion.rotations.subarray(4 * joints * frame, 4 * joints * (frame + 1));
    forwardKinematics(skeleton, rotations, motion.positions.subarray(3 * frame, 3 * frame + 3), world);
    for (let joint = 0; joint < joints; joint++) {
      const to = 3 * (joints * frame + joint);
      for (let k = 0; k < 3; k++) places[to + k] = world[12 * joint + 4 * k + 3];
    }
  }
  return places;
}
