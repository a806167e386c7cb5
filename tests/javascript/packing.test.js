/** Motion as it travels, and how bodies share the stage. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { Arrival } from "../../app/page/web/stage/arrival.js";
import { forwardKinematics, NUM_JOINTS, partlyBack, placed, smoothSigns, unpacked } from "../../app/page/web/stage/motion.js";
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
    const packed = panels([10, 20, 240, 430], closeUp, SHOTS);
    assert.equal(packed.length, number);
    assert.equal(packed[0].view, null);
    const inside = packed.map(({ rect: [left, top, w, h] }) => [left - 10, top - 20, w, h]);
    assert.ok(covered(inside, [240, 430]).every((times) => times === 1));
    assert.ok(packed[0].rect[3] >= 120, "the body has room");

    const [body, ...beside] = panels([0, 0, 900, 430], closeUp, SHOTS);
    assert.equal(beside.length, number - 1);
    const times = closeUp === "hands" || closeUp === "off" ? 1 : 0; // over a face is some room
    assert.ok(covered([body, ...beside].map(({ rect }) => rect), [900, 430]).every((count) => count >= times && count <= 1));
    assert.equal(body.rect[3], 430, "in a wide cell they take none of its height");
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

// ---------------------------------------------------------------- window by window

/** A body that turns, as one message or as several that begin at `starts`. */
function turning(count, starts = [0]) {
  const turn = (frame, joint) => [0, Math.sin(frame * joint * 0.03), 0, Math.cos(frame * joint * 0.03)];
  const parts = starts.map((start, i) => new Uint8Array(message((starts[i + 1] ?? count) - start, turn, 2, start)));
  return new Uint8Array(parts.flatMap((part) => [...part])).buffer;
}

const same = (one, two) => ["positions", "rotations", "faces"].forEach((name) => assert.deepEqual(one[name], two[name], name));

for (const starts of [[0, 52], [0, 1, 2, 111], [0, 59, 60, 61]]) {
  test(`windows from ${starts} make the same motion as the whole, to the bit`, async () => {
    const whole = unpacked(turning(112));
    const file = turning(112, starts);
    same(unpacked(file), whole);
    const sizes = starts.map((start, i) => 20 + ((starts[i + 1] ?? 112) - start) * (12 + 440 + 2));
    const requests = [];
    const arrival = new Arrival("there", async (url, from, to) => {
      requests.push([from, to]);
      return file.slice(from, to);
    });
    let [bytes, motion] = [0, null];
    for (const [i, size] of sizes.entries()) {
      bytes += size;
      const end = starts[i + 1] ?? 112;
      motion = await arrival.next({ num_bytes: bytes, end, num_frames: 112, place: [0, 0, 0, 0] }, end);
      assert.equal(motion.length, end, "all that has come");
    }
    same(motion, whole);
    assert.equal(requests[0][0], 0);
    requests.forEach(([from], i) => assert.equal(from, i ? requests[i - 1][1] : 0, "nothing is fetched twice"));
    assert.equal(await arrival.next({ num_bytes: bytes, end: 112, num_frames: 112, place: [0, 0, 0, 0] }, 112), null, "nothing new");
  });
}

test("a little more is left until it is needed, or the last", async () => {
  const file = turning(112, [0, 100, 105]);
  const arrival = new Arrival("there", async (url, from, to) => file.slice(from, to));
  const there = (end, messages) => ({ num_bytes: 20 * messages + end * 454, end, num_frames: 112, place: [0, 0, 0, 0] });
  assert.equal((await arrival.next(there(100, 1), 0)).length, 100);
  assert.equal(await arrival.next(there(105, 2), 60), null);
  assert.equal((await arrival.next(there(105, 2), 101)).length, 105, "it is about to be shown");
  assert.equal((await arrival.next(there(112, 3), 0)).length, 112);
});

test("a window that is missing, or comes twice, is not a motion", () => {
  const first = new Uint8Array(message(5, () => [0, 0, 0, 1]));
  const third = new Uint8Array(message(5, () => [0, 0, 0, 1], 2, 10));
  for (const other of [first, third]) assert.throws(() => unpacked(new Uint8Array([...first, ...other]).buffer), /damaged/);
  assert.throws(() => unpacked(message(5, () => [0, 0, 0, 1]), 5), /damaged/, "not what was asked for");
});

test("a motion is laid where it is told to be, and taken back from there", () => {
  const motion = unpacked(turning(3));
  const rest = [0.01, 0.9, -0.02];
  const place = [0.7, 0.3, -0.1, 0.2];
  const skeleton = { parents: new Array(NUM_JOINTS).fill(-1).map((_, j) => j - 1), offsets: new Float32Array(3 * NUM_JOINTS).fill(0.05) };
  skeleton.offsets.set(rest);
  const world = (each, frame) => {
    const turns = each.rotations.subarray(4 * NUM_JOINTS * frame, 4 * NUM_JOINTS * (frame + 1));
    return forwardKinematics(skeleton, turns, each.positions.subarray(3 * frame, 3 * frame + 3), new Float32Array(12 * NUM_JOINTS));
  };
  const laid = world(placed(motion, place, rest), 2);
  const plain = world(motion, 2);
  const [sin, cos] = [Math.sin(place[0]), Math.cos(place[0])];
  for (let at = 0; at < plain.length; at += 12) {
    const [x, y, z] = [plain[at + 3], plain[at + 7], plain[at + 11]];
    const wanted = [cos * x + sin * z + 0.3, y - 0.1, cos * z - sin * x + 0.2];
    wanted.forEach((part, k) => assert.ok(Math.abs(laid[at + 4 * k + 3] - part) < 1e-4));
  }
  partlyBack(laid, [0, 0, 0, 0], place, 1).forEach((part, i) => assert.ok(Math.abs(part - plain[i]) < 1e-4, `${i}`));
});
