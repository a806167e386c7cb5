/** Where cameras stand, and how a person moves them. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { Orbit } from "../../app/page/web/body/orbit.js";
import { framePoints, lens, projected } from "../../app/page/web/stage/framing.js";

const LENS = { yfov: 0.6, near: 0.05, margin: 0.06 };
const FRONT = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]; // right, up, backward
const near = (found, wanted, message) => assert.ok(Math.abs(found - wanted) < 1e-9, `${message}: ${found}, not ${wanted}`);

test("all points are inside the picture, and one touches its margin", () => {
  const points = [-0.4, 0, 0.1, 0.7, 1.8, -0.2, 0, 0.9, 0.3, 0.2, -0.1, 0];
  for (const aspect of [0.5, 1, 2]) {
    const eye = framePoints(points, [0, 0, 0, 0], FRONT, aspect, LENS);
    const matrix = lens({ axes: FRONT, eye }, aspect, LENS);
    const seen = [0, 3, 6, 9].map((at) => projected(matrix, points.slice(at, at + 3)));
    const edges = seen.flatMap(([x, y]) => [x, 1 - x, y, 1 - y]);
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
  let told = 0;
  orbit.addEventListener("change", () => (told += 1));
  orbit.turn(0, 9);
  orbit.nearer(1e6);
  assert.equal(told, 2);
  const [, pitch, zoom] = orbit.state;
  assert.ok(pitch < Math.PI / 2 && zoom <= 10);
  const other = new Orbit();
  other.place(orbit.state);
  assert.deepEqual(other.state, orbit.state);
  orbit.reset();
  assert.ok(!orbit.isMoved);
});
