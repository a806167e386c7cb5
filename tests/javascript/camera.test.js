/** Where cameras stand, and how a person moves them. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { Orbit } from "../../app/page/web/body/orbit.js";
import { framePoints, Framing, lens, projected } from "../../app/page/web/stage/framing.js";
import { NUM_JOINTS } from "../../app/page/web/stage/motion.js";

const LENS = { yfov: 0.6, near: 0.05, margin: 0.06 };
const FRONT = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]; // right, up, backward
const near = (actual, expected, message) => assert.ok(Math.abs(actual - expected) < 1e-9, `${message}: ${actual}, not ${expected}`);

test("all points are inside the picture, and one touches its margin", () => {
  const points = [-0.4, 0, 0.1, 0.7, 1.8, -0.2, 0, 0.9, 0.3, 0.2, -0.1, 0];
  for (const aspect of [0.5, 1, 2]) {
    const eye = framePoints(points, [0, 0, 0, 0], FRONT, aspect, LENS);
    const matrix = lens({ axes: FRONT, eye }, aspect, LENS);
    const projections = [0, 3, 6, 9].map((at) => projected(matrix, points.slice(at, at + 3)));
    const edges = projections.flatMap(([x, y]) => [x, 1 - x, y, 1 - y]);
    near(Math.min(...edges), LENS.margin / 2, `the least room at ${aspect}`);
  }
});

test("a ball takes the room that it has", () => {
  const eye = framePoints([0, 1, 0], [0.5], FRONT, 1, { ...LENS, margin: 0 });
  near(eye[1], 1, "as high as the ball");
  near(eye[2], 0.5 / Math.sin(LENS.yfov / 2), "so far that its edge is tangent");
});

test("what lies before the camera is in the middle, and right is right", () => {
  const matrix = lens({ axes: FRONT, eye: [1, 2, 5] }, 1.5, LENS);
  const [x, y] = projected(matrix, [1, 2, 0]);
  near(x, 0.5, "x");
  near(y, 0.5, "y");
  assert.ok(projected(matrix, [1.1, 2, 0])[0] > 0.5);
  assert.ok(projected(matrix, [1, 2.1, 0])[1] < 0.5, "up is up");
  assert.equal(projected(matrix, [1, 2, 6]), null, "behind the camera");
});

/** Somebody with a head, a pelvis and a foot, who goes `way(seconds)`, (T, J, 3). */
const walker = (way) =>
  Float32Array.from({ length: 300 * 3 * NUM_JOINTS }, (_, i) => {
    const [frame, joint, axis] = [Math.floor(i / (3 * NUM_JOINTS)), Math.floor(i / 3) % NUM_JOINTS, i % 3];
    return way(frame / 30)[axis] + (axis === 1 ? { pelvis: 1, head: 1.7 }[JOINTS[joint]] ?? 0.1 : 0);
  });
const JOINTS = ["pelvis", "head", "left_ankle", "right_ankle", "left_foot", "right_foot", ...new Array(NUM_JOINTS - 6).fill("left_knee")];
const BODY = { names: JOINTS, reach: new Array(NUM_JOINTS).fill(0.1), rest: Float32Array.of(0, 0.9, ...new Array(3 * NUM_JOINTS - 2).fill(0)), sole: -0.1 };
const FACTS = {
  camera: LENS,
  views: { front: FRONT },
  framing: { below_knees: ["ankle", "foot"], knee_flesh: 0.1, follow_beyond: 1.5, lead: 0.3, close_lead: 0.15, walk_sigma: 30 },
  ground: { half_size: 2 },
};

/** How high a body stands in its picture at a frame, as a share, and where its pelvis is in it. */
function heightAndPelvis(framing, places, number, frame) {
  const { axes, eye } = framing.body("front", 0.6, false);
  const matrix = lens({ axes, eye: eye.map((part, k) => part + (framing.isFollowing ? framing.track(number)[3 * frame + k] : 0)) }, 0.6, LENS);
  const [pelvis, head] = [0, 1].map((joint) => projected(matrix, places.subarray(3 * (NUM_JOINTS * frame + joint))));
  return { height: pelvis[1] - head[1], pelvis };
}

test("a body that goes far shrinks neither others nor itself, and its ground goes along", () => {
  const still = walker(() => [0, 0, 0]);
  const ways = {
    walk: (s) => [2 * s, 0, 0],
    approach: (s) => [0, 0, 2 * s],
    jump: (s) => [s > 5 ? 20 : 0, 0, 0],
    climb: (s) => [0, 2 * (s - 5), 0],
    circle: (s) => [3 * Math.sin(2 * s), 0, 3 * Math.cos(2 * s)],
  };
  const alone = heightAndPelvis(new Framing(BODY, FACTS, [still]), still, 0, 150).height;
  for (const [name, way] of Object.entries(ways)) {
    const places = walker(way);
    const framing = new Framing(BODY, FACTS, [still, places]);
    for (const frame of [0, 75, 149, 151, 299]) {
      assert.ok(heightAndPelvis(framing, still, 0, frame).height > 0.7 * alone, `${name} shrinks others: ${heightAndPelvis(framing, still, 0, frame).height} of ${alone}`);
      const { height, pelvis } = heightAndPelvis(framing, places, 1, frame);
      assert.ok(height > 0.5 * alone && pelvis.every((part) => part > 0 && part < 1), `${name}, frame ${frame}: ${height} of ${alone}, ${pelvis}`);
      const { centre, halfSize } = framing.ground(1, frame);
      assert.ok(halfSize === 2 && Math.hypot(centre[0] - way(frame / 30)[0], centre[1] - way(frame / 30)[2]) < 0.5, `${name}: the ground goes along`);
    }
  }
});

const AROUND = [0, 1, 0];
const CAMERA = { axes: FRONT, eye: [0, 1, 4] };

test("an orbit that nobody has moved leaves the camera where it is", () => {
  assert.deepEqual(new Orbit().from(CAMERA, AROUND), CAMERA);
});

test("a quarter turn stands at the side, as far away", () => {
  const orbit = new Orbit();
  orbit.turn(Math.PI / 2, 0);
  const { eye } = orbit.from(CAMERA, AROUND);
  near(Math.abs(eye[0]), 4, "x");
  near(eye[1], 1, "y");
  near(eye[2], 0, "z");
  orbit.nearer(2);
  near(Math.abs(orbit.from(CAMERA, AROUND).eye[0]), 2, "half as far");
});

test("an orbit tells of each move, keeps within its limits and goes back", () => {
  const orbit = new Orbit();
  let numChanges = 0;
  orbit.addEventListener("change", () => (numChanges += 1));
  orbit.turn(0, 9);
  orbit.nearer(1e6);
  assert.equal(numChanges, 2);
  const [, pitch, zoom] = orbit.state;
  assert.ok(pitch < Math.PI / 2 && zoom <= 10);
  const other = new Orbit();
  other.place(orbit.state);
  assert.deepEqual(other.state, orbit.state);
  orbit.reset();
  assert.ok(!orbit.isMoved);
});
