/** Noise on rotations, as the first screen shows it. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { jointPositions, NUM_JOINTS, unpacked } from "../../app/page/web/stage/motion.js";
import { distance, noisy, normals } from "../../app/page/web/stage/noise.js";
import { message, SKELETON } from "./made.js";

const FRAMES = 200;
const RAD = 0.02;
const bent = ([x, y, z, w]) => [x, y, z, w].map((part) => part / Math.hypot(x, y, z, w));
const motion = unpacked(message(FRAMES, (frame, joint) => bent([0.02 * Math.sin(frame / 9), 0, 0.03, 1 + joint / 50])));

test("noise is the same at every call and normal", () => {
  const values = normals(20000);
  assert.deepEqual(values, normals(20000));
  const mean = values.reduce((sum, each) => sum + each, 0) / values.length;
  const square = values.reduce((sum, each) => sum + each ** 2, 0) / values.length;
  assert.ok(Math.abs(mean) < 0.03 && Math.abs(square - 1) < 0.03, `${mean} ${square}`);
});

test("a point is moved as far as the lever arms say, by noise on local and on global rotations", () => {
  // A turn n with deviation s of each part moves what is r away by n x r: 2 s² |r|² in the mean square.
  const last = 12;
  const places = jointPositions(SKELETON, motion);
  const lever = (from, to) => {
    let square = 0;
    for (let frame = 0; frame < FRAMES; frame++) for (let k = 0; k < 3; k++) square += (places[3 * (NUM_JOINTS * frame + to) + k] - places[3 * (NUM_JOINTS * frame + from) + k]) ** 2 / FRAMES;
    return square;
  };
  const sum = (of) => Array.from({ length: last }, (_, joint) => of(joint)).reduce((total, each) => total + each);
  const expected = { local: sum((joint) => lever(joint, last)), global: sum((joint) => lever(joint, joint + 1)) };
  for (const space of /** @type {const} */ (["local", "global"])) {
    const moved = distance(noisy(motion, space, RAD, SKELETON), motion, SKELETON, { joint: last, offset: [0, 0, 0] });
    const ratio = moved / (RAD * Math.sqrt(2 * expected[space]));
    assert.ok(Math.abs(ratio - 1) < 0.06, `${space}: ${ratio}`);
  }
});

test("the face keeps its rotations", () => {
  const names = SKELETON.names.with(20, "jaw");
  for (const space of /** @type {const} */ (["local", "global"])) {
    const { rotations } = noisy(motion, space, RAD, { ...SKELETON, names });
    const of = (all) => [...all.subarray(4 * 20, 4 * 21)];
    assert.deepEqual(of(rotations), of(motion.rotations));
  }
});
