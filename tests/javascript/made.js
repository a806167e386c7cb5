/** Motion made for tests. */

import { NUM_JOINTS } from "../../app/page/web/stage/motion.js";

/**
 * Bytes as app/live/session.py writes them: the root at (f, f + 1, f + 2), each joint as
 * `turn(frame, joint)` says, face weights f * k; `first` is the number of the first frame.
 */
export function message(count, turn, numFaces = 2, first = 0) {
  const bytes = new ArrayBuffer(20 + count * (12 + 8 * NUM_JOINTS + numFaces));
  const view = new DataView(bytes);
  view.setUint32(0, first, true);
  view.setUint16(4, count, true);
  view.setUint16(6, numFaces, true);
  let at = 20;
  for (let f = first; f < first + count; f++) for (let k = 0; k < 3; k++, at += 4) view.setFloat32(at, f + k, true);
  for (let f = first; f < first + count; f++) {
    for (let joint = 0; joint < NUM_JOINTS; joint++) for (const part of turn(f, joint)) (view.setInt16(at, Math.round(32767 * part), true), (at += 2));
  }
  for (let f = first; f < first + count; f++) for (let k = 0; k < numFaces; k++) view.setUint8(at++, f * (k + 1));
  return bytes;
}

/** A skeleton whose joints all follow the root, each in a place of its own. */
export const SKELETON = {
  parents: Int16Array.from({ length: NUM_JOINTS }, (_, joint) => (joint ? joint - 1 : -1)),
  offsets: Float32Array.from({ length: 3 * NUM_JOINTS }, (_, i) => (i % 3 === 1 ? 0.1 : 0)),
  names: Array.from({ length: NUM_JOINTS }, (_, joint) => `joint_${joint}`),
};
