/** A motion that goes on: what is kept of it, and where cameras go. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { Playout } from "../../app/page/web/live/playout.js";
import { Rolling } from "../../app/page/web/live/rolling.js";
import { NUM_JOINTS, unpacked } from "../../app/page/web/stage/motion.js";
import { message, SKELETON } from "./made.js";

const MESH = { ...SKELETON, rest: new Float32Array(3 * NUM_JOINTS) };
const HAND = { view: "left_hand", joints: [3, 7] };
const AS_IT_IS = { isSmoothed: false, factor: 1, cutoff: 5 };
const turn = (frame, joint) => (joint === 2 ? [0, 0, Math.sin(frame / 20), Math.cos(frame / 20)] : [0, 0, 0, 1]);
const frames = (first, count) => unpacked(message(count, turn, 2, first), first);

/** Frames 0 to `end` that came `hop` at a time. */
function rolled(end, hop) {
  const rolling = new Rolling(MESH, 1);
  for (let first = 0; first < end; first += hop) {
    rolling.push(first, frames(first, Math.min(hop, end - first)));
    rolling.track(HAND); // from when it is first asked for
  }
  return rolling;
}

test("its last five seconds are kept, whatever the pieces in which it came", () => {
  const [fine, coarse] = [rolled(400, 8), rolled(400, 40)];
  for (const rolling of [fine, coarse]) {
    assert.equal(rolling.first, 250);
    assert.equal(rolling.shown.length, 150);
    assert.deepEqual([0, 300.5, 1000].map((place) => rolling.within(place)), [250, 300.5, 399]);
  }
  const pose = (rolling) => Array.from(rolling.shown.world(97, AS_IT_IS));
  pose(fine).forEach((part, i) => assert.ok(Math.abs(part - pose(coarse)[i]) < 1e-4, `${i}`));
  assert.deepEqual(Array.from(fine.shown.faces(10)), Array.from(frames(260, 1).faces), "each with its own face");
  const [one, other] = [fine, coarse].map((rolling) => Array.from(rolling.track(HAND)));
  one.forEach((part, i) => assert.ok(Math.abs(part - other[i]) < 1e-4, "so does the camera of a close-up"));
});

test("the ground goes after who walks away, and a camera after its hand", () => {
  const rolling = rolled(400, 8); // one metre a frame to the side: no one does, so it lags far behind
  const { motion } = rolling.shown.version(false);
  const along = motion.positions[3 * 149] - motion.positions[3 * 148];
  assert.ok(Math.abs(along) < 0.05, "it has found its pace");
  const { places } = rolling.shown.version(false);
  const track = rolling.track(HAND);
  const middle = (frame) => HAND.joints.reduce((sum, joint) => sum + places[3 * (NUM_JOINTS * frame + joint) + 2] / 2, 0);
  assert.ok(Math.abs(track[3 * 149 + 2] - middle(149)) < 4);
});

test("where frames were lost it begins anew, and a second session after the first", () => {
  const rolling = rolled(96, 8);
  rolling.push(120, frames(120, 8));
  assert.equal(rolling.first, 120);
  assert.equal(rolling.shown.length, 8);
  assert.equal(rolling.track(HAND).length, 24);
  rolling.push(0, frames(0, 8));
  assert.equal(rolling.first, 0);
  assert.deepEqual(Array.from(rolling.shown.version(false).motion.positions.slice(0, 3)), [0, 1, 0], "on its spot");
});

test("its clock tells moments of what is kept, and stands where it was left", () => {
  const [rolling, clock] = [rolled(400, 8), new Playout()];
  let now = 0;
  performance.now = () => now;
  assert.equal(clock.time, 0, "before there is a body");
  clock.rolling = rolling;
  clock.captured(0);
  clock.came(message(1, turn));
  clock.go(true);
  const passes = (place) => (now = (place + 0.5) * 1000 / 30 + clock.delay);
  passes(310.5);
  assert.ok(Math.abs(clock.time - 60.5 / 30) < 1e-9);
  rolling.push(400, frames(400, 8));
  assert.ok(Math.abs(clock.time - 52.5 / 30) < 1e-9, "what is kept has moved on");
  clock.go(false);
  passes(320);
  assert.equal(Math.floor(clock.time * 30), clock.frame);
  assert.equal(clock.frame, 52);
  clock.clear();
  clock.go(true);
  assert.equal(clock.time, 52.5 / 30, "until the first frame of another session has come");
});
