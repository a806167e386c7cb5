/** Motion as it travels to the browser: "Live frames" of docs/formats.md, all of a clip in one. */

export const NUM_JOINTS = 55;
const HEADER_BYTES = 20;

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
}

/** Reads the bytes; throws where they are no motion. */
export function unpacked(bytes) {
  const header = new DataView(bytes, 0, HEADER_BYTES);
  const [count, numFaces] = [header.getUint16(4, true), header.getUint16(6, true)];
  const size = HEADER_BYTES + count * (12 + 8 * NUM_JOINTS + numFaces);
  if (!count || bytes.byteLength !== size) throw new Error("The motion that came is damaged.");
  const positions = new Float32Array(bytes.slice(HEADER_BYTES, HEADER_BYTES + 12 * count));
  const from = HEADER_BYTES + 12 * count;
  const levels = new Int16Array(bytes.slice(from, from + 8 * NUM_JOINTS * count));
  const rotations = Float32Array.from(levels, (level) => level / 32767);
  const faces = new Uint8Array(bytes, from + 8 * NUM_JOINTS * count);
  return new Motion(positions, smoothSigns(rotations), faces, numFaces);
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
