/** How far two bodies are apart, part by part. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { Difference } from "../../app/page/web/stage/difference.js";
import { NUM_JOINTS, unpacked } from "../../app/page/web/stage/motion.js";
import { message } from "./made.js";

const NAMES = Array.from({ length: NUM_JOINTS }, (_, joint) => `other_${joint}`);
for (const [joint, name] of ["pelvis", "left_hip", "right_hip", "spine1", "neck", "right_shoulder", "right_elbow", "right_index1", "left_wrist", "left_thumb1"].entries()) NAMES[joint] = name;
const ELBOW = NAMES.indexOf("right_elbow");
const KNUCKLE = NAMES.indexOf("right_index1");

/** A motion in which a joint is turned by so many degrees about x in a frame. */
function turned(frames, degrees) {
  return unpacked(message(frames, (frame, joint) => {
    const half = (degrees(frame, joint) * Math.PI) / 360;
    return [Math.sin(half), 0, 0, Math.cos(half)];
  }));
}

function byPart(difference, frame) {
  return Object.fromEntries(difference.at(frame).map(({ part, mean, now }) => [part, { mean, now }]));
}

test("each part differs by what its own joints are turned", () => {
  const still = turned(10, () => 0);
  const other = turned(12, (frame, joint) => (joint === ELBOW ? 8 * frame : joint === KNUCKLE ? 170 : 0));
  const difference = new Difference(still, other, NAMES);
  assert.equal(difference.length, 10); // of those frames that both have
  const found = byPart(difference, 5);
  assert.ok(Math.abs(found["right arm"].now - 20) < 0.1, `${found["right arm"].now}`); // one of its two joints
  assert.ok(Math.abs(found["right arm"].mean - 18) < 0.1);
  assert.ok(Math.abs(found["right hand"].now - 170) < 0.1);
  for (const part of ["left arm", "left hand", "trunk", "head", "legs"]) assert.ok(found[part].mean < 0.01, part);
  assert.deepEqual(difference.at(0).slice(0, 2).map(({ part }) => part), ["right hand", "right arm"]); // the most first
});

test("the sign of a quaternion makes no difference, and beyond the end the last frame counts", () => {
  const some = turned(4, () => 30);
  const same = turned(4, () => 30);
  for (let i = 0; i < same.rotations.length; i++) same.rotations[i] *= -1;
  const difference = new Difference(some, same, NAMES);
  for (const { mean, now } of difference.at(99)) assert.ok(mean < 0.01 && now < 0.01);
});
