/** What the switches of the stage make of a motion, and how they are kept. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { Shown } from "../../app/page/web/stage/displays.js";
import { belowCutoff, derivative, savgol } from "../../app/page/web/stage/filters.js";
import { DISPLAYS, Look } from "../../app/page/web/stage/look.js";
import { NUM_JOINTS, unpacked } from "../../app/page/web/stage/motion.js";
import { Pace } from "../../app/page/web/stage/pace.js";
import { trailCorners } from "../../app/page/web/stage/trail.js";
import { message, SKELETON } from "./made.js";

const FRAMES = 90;
const PLAIN = { isSmoothed: false, factor: 1, cutoff: 5 };
const SHAKEN = 3; // joint

/** Still but for one joint that shakes so many times a second. */
function shaken(hertz, angle = 0.01) {
  const motion = unpacked(message(FRAMES, (frame, joint) => {
    const half = joint === SHAKEN ? (angle / 2) * Math.sin((2 * Math.PI * hertz * frame) / 30) : 0;
    return [0, 0, Math.sin(half), Math.cos(half)];
  }));
  motion.positions.fill(0);
  return new Shown(motion, SKELETON, 1);
}

/** How far a joint at the end moves from frame to frame in the middle of the clip, at most. */
function swing(shown, look) {
  const across = [];
  for (let frame = 30; frame < 60; frame++) across.push(shown.world(frame, look)[12 * (SHAKEN + 5) + 3]);
  return Math.max(...across) - Math.min(...across);
}

test("tremble is made larger by the factor, and slow motion is left as it is", () => {
  const fast = shaken(12);
  const once = swing(fast, PLAIN);
  assert.ok(once > 0.005);
  for (const factor of [2, 7.5, 20]) {
    const ratio = swing(fast, { ...PLAIN, factor }) / once;
    assert.ok(Math.abs(ratio / factor - 1) < 0.06, `${ratio} times, not ${factor}`);
  }
  const slow = shaken(0.5, 0.2);
  const changed = swing(slow, { ...PLAIN, factor: 20 }) / swing(slow, PLAIN);
  assert.ok(Math.abs(changed - 1) < 0.05, `${changed}`);
});

test("smoothing takes tremble away", () => {
  const fast = shaken(12);
  assert.ok(swing(fast, { ...PLAIN, isSmoothed: true }) < 0.25 * swing(fast, PLAIN));
});

test("between two frames a body stands between their poses", () => {
  const fast = shaken(7);
  const across = (moment) => fast.world(moment, PLAIN)[12 * (SHAKEN + 5) + 3];
  const [one, between, two] = [across(31), across(31.5), across(32)];
  assert.ok(Math.abs(between - (one + two) / 2) < 1e-5);
  assert.notEqual(one, two);
});

test("what stands does not jerk, and what shakes does", () => {
  const shown = shaken(12);
  const jerk = shown.jerk(false);
  const [calm, wild] = [SHAKEN, SHAKEN + 1].map((joint) => jerk[NUM_JOINTS * 45 + joint]);
  assert.ok(calm < 1 && wild > 50, `${calm}, ${wild}`);
});

test("at its cut-off a filter that runs both ways halves what it is given", () => {
  const wave = (hertz) => Float32Array.from({ length: 300 }, (_, i) => Math.sin((2 * Math.PI * hertz * i) / 30));
  const largest = (values) => Math.max(...values.subarray(100, 200));
  const left = (hertz) => largest(belowCutoff(wave(hertz), 1, 5)) / largest(wave(hertz));
  assert.ok(Math.abs(left(5) - 0.5) < 0.02, `${left(5)}`);
  assert.ok(left(1) > 0.99 && left(12) < 0.01);
});

test("a parabola passes the smoothing filter, and has no third derivative", () => {
  const parabola = Float32Array.from({ length: 30 }, (_, i) => 0.01 * i * i - 0.2 * i);
  savgol(parabola, 1).forEach((value, i) => assert.ok(Math.abs(value - parabola[i]) < 1e-4));
  const places = new Float32Array(90);
  parabola.forEach((value, i) => (places[3 * i] = value));
  assert.ok(Math.max(...derivative(places, 1, 3)) < 0.1);
  derivative(places, 1, 2).forEach((value) => assert.ok(Math.abs(value - 0.02 * 900) < 0.1));
});

// ---------------------------------------------------------------- how switches are kept

test("a look that an address tells is the same look", () => {
  const look = new Look();
  const address = new URLSearchParams();
  look.write(address);
  assert.equal(String(address), "", "nothing is told of what is usual");
  look.set("factor", 7.5);
  look.set("hasTrail", false);
  look.set("hasHeat", true);
  look.set("point", "head");
  look.write(address);
  const other = new Look();
  other.read(new URLSearchParams(String(address)));
  for (const name of ["factor", "hasTrail", "hasHeat", "point", "cutoff"]) assert.equal(other.get(name), look.get(name), name);
});

test("each display has a name of its own in an address", () => {
  const shorts = Object.values(DISPLAYS).map(({ short }) => short);
  assert.equal(new Set(shorts).size, shorts.length);
});

test("sliders stay within their range, and nonsense changes nothing", () => {
  const look = new Look();
  let numChanges = 0;
  look.addEventListener("change", () => (numChanges += 1));
  look.set("factor", 1000);
  assert.equal(look.get("factor"), DISPLAYS.factor.range[1]);
  look.set("cutoff", -1);
  assert.equal(look.get("cutoff"), DISPLAYS.cutoff.range[0]);
  look.read(new URLSearchParams("x=no+number"));
  assert.equal(look.get("factor"), DISPLAYS.factor.range[1]);
  assert.equal(numChanges, 2);
});

test("pictures that take too long become coarser, step by step, and no further than they must", () => {
  const pace = new Pace(true);
  const before = pace.level;
  const draw = (milliseconds, count) => {
    for (let i = 0; i < count; i++) pace.took(milliseconds);
  };
  draw(40, 100);
  assert.equal(pace.level, before, "fast enough");
  draw(90, 6);
  assert.notEqual(pace.level, before);
  draw(90, 1000);
  assert.ok(pace.level.pixels < before.pixels);
});

test("a trail is drawn where its point is, without what stands behind the camera", () => {
  const options = { width: 200, height: 100, tip: 9, colors: [[0, 0, 1], [1, 0, 0]], spike: [1, 0, 1] };
  const corners = trailCorners({ ...options, places: [[50, 50], [60, 50], null, [150, 25]], speeds: [0, 0, 0, 1], spikes: [false, false, false, true] });
  const places = [];
  for (let at = 0; at < corners.length; at += 5) places.push([corners[at], corners[at + 1]]);
  const first = places.filter(([x]) => x < 0);
  assert.ok(first.every(([x, y]) => x > -0.6 && x < -0.3 && Math.abs(y) < 0.1));
  const dot = places.filter(([x]) => x > 0);
  assert.ok(dot.length && dot.every(([x, y]) => Math.abs(x - 0.5) < 0.1 && Math.abs(y - 0.5) < 0.15));
  const away = (corner) => Math.hypot(100 * (corner[0] - 0.5), 50 * (corner[1] - 0.5));
  const small = trailCorners({ ...options, tip: 1.1, places: [[150, 25]], speeds: [0], spikes: [true] });
  const corner = (at) => small.slice(at, at + 2);
  assert.ok(Math.max(...small.map((_, at) => (at % 5 ? 0 : away(corner(at))))) <= 1.1 + 1e-9, "no dot is larger than a fingertip");
  const empty = trailCorners({ ...options, places: [null, null], speeds: [0, 0], spikes: [true, true] });
  assert.equal(empty.length, 0);
});
