/** Motion as it travels, and how bodies share the stage. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { forwardKinematics, NUM_JOINTS, smoothSigns, unpacked } from "../../app/page/web/stage/motion.js";
import { cells, grid, pairPanels, panels } from "../../app/page/web/stage/packing.js";
import { message } from "./made.js";

test("a message holds places, turns and faces, frame by frame", () => {
  const motion = unpacked(message(3, (frame, joint) => (joint === 2 ? [0, Math.sin(frame / 10), 0, Math.cos(frame / 10)] : [0, 0, 0, 1])));
  assert.equal(motion.length, 3);
  assert.deepEqual(Array.from(motion.positions), [0, 1, 2, 1, 2, 3, 2, 3, 4]);
  const at = 4 * (NUM_JOINTS * 2 + 2);
  assert.ok(Math.abs(motion.rotations[at + 1] - Math.sin(0.2)) < 1 / 32767);
  assert.deepEqual(Array.from(motion.faces), [0, 0, 1, 2, 2, 4]);
});

test("504 bytes hold a frame of a body with its face", () => {
  const whole = message(10, () => [0, 0, 0, 1], 52);
  assert.equal(whole.byteLength, 20 + 10 * 504);
});

test("what is cut short, too long or empty is refused", () => {
  const whole = message(2, () => [0, 0, 0, 1]);
  const longer = new Uint8Array([...new Uint8Array(whole), 0]).buffer;
  for (const bytes of [whole.slice(0, -1), longer, message(0, () => [])]) assert.throws(() => unpacked(bytes), /damaged/);
});

test("neighbouring frames take the short way", () => {
  const turns = new Float32Array([0, 0, 0, 1, 0, 0, -0.1, -0.99, 0, 0, 0.2, 0.98]);
  assert.deepEqual(Array.from(smoothSigns(turns, 1), (part) => Math.sign(part) || 0), [0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 1]);
});

test("a skeleton that turns nowhere stands at rest, and a turned root turns all", () => {
  const skeleton = { parents: [-1, 0, 1], offsets: [0, 1, 0, 0, 0.5, 0, 0.25, 0, 0] };
  const still = [0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1];
  const place = (world, joint) => [world[12 * joint + 3], world[12 * joint + 7], world[12 * joint + 11]];
  assert.deepEqual(place(forwardKinematics(skeleton, still, [0, 0, 2], new Float32Array(36)), 2), [0.25, 1.5, 2]);
  const half = Math.SQRT1_2;
  const turned = forwardKinematics(skeleton, [0, half, 0, half, ...still.slice(4)], [0, 0, 0], new Float32Array(36));
  const [x, y, z] = place(turned, 2);
  assert.ok(Math.abs(x) < 1e-6 && Math.abs(y - 1.5) < 1e-6 && Math.abs(z + 0.25) < 1e-6, `${[x, y, z]}`);
});

// ---------------------------------------------------------------- room

const SHOTS = { face: [{ view: "face" }], hands: [{ view: "right_hand" }, { view: "left_hand" }] };

/** How often each pixel is covered. */
function covered(rects, [width, height]) {
  const count = new Uint8Array(width * height);
  for (const [left, top, w, h] of rects) {
    for (let y = top; y < top + h; y++) for (let x = left; x < left + w; x++) count[y * width + x] += 1;
  }
  return count;
}

test("cells cover the stage once, up to twelve of them", () => {
  for (let number = 1; number <= 12; number++) {
    for (const size of [[1210, 510], [390, 560], [811, 333]]) {
      const { columns, rows } = grid(number, ...size);
      assert.ok(columns * rows >= number && columns * (rows - 1) < number, `${number} in ${columns} x ${rows}`);
      const count = covered(cells(number, ...size, columns), size);
      assert.ok(count.every((times) => times <= 1), "none stands on another");
      if (columns * rows === number) assert.ok(count.every((times) => times === 1), "no room is left");
    }
  }
  assert.equal(grid(5, 1280, 430).rows, 1, "five stand in one row");
});

for (const [closeUp, number] of [["hands", 3], ["face", 2], ["both", 4], ["off", 1]]) {
  test(`a body and its close-ups (${closeUp}) share their cell`, () => {
    const found = panels([10, 20, 240, 430], closeUp, SHOTS);
    assert.equal(found.length, number);
    assert.equal(found[0].view, null);
    const inside = found.map(({ rect: [left, top, w, h] }) => [left - 10, top - 20, w, h]);
    assert.ok(covered(inside, [240, 430]).every((times) => times === 1));
    assert.ok(found[0].rect[3] >= 120, "the body has room");
  });

  test(`two in one place keep their close-ups (${closeUp}) apart`, () => {
    for (const size of [[1200, 500], [390, 560]]) {
      const { body, sides } = pairPanels([0, 0, ...size], closeUp, SHOTS);
      const rects = [body.rect, ...sides.flat().map(({ rect }) => rect)];
      assert.equal(rects.length, 1 + 2 * (number - 1));
      assert.ok(covered(rects, size).every((times) => times <= 1));
      const right = Math.max(0, ...sides[0].map(({ rect }) => rect[0] + rect[2]));
      assert.ok(sides[1].every(({ rect }) => rect[0] >= right), "of the first to the left");
    }
  });
}
