/** Builds of the body as the server writes them. */

import assert from "node:assert/strict";
import test from "node:test";

import { readBuilds } from "../../app/page/web/stage/builds.js";

const MESH = { positions: Float32Array.of(1, 2, 3), normals: Float32Array.of(0, 1, 0), inOrder: (values) => values };
const BUILDS = { names: ["average", "broad"], step: 0.001 };

test("a build is its offsets on top of the mesh, with normals of its own", () => {
  const content = Int16Array.of(100, -50, 0, 32767, 0, -32767).buffer;
  const builds = readBuilds(content, MESH, BUILDS);
  assert.deepEqual([...builds.keys()], ["average", "broad"]);
  assert.equal(builds.get("average").positions, MESH.positions);
  const { positions, normals } = builds.get("broad");
  [1.1, 1.95, 3].forEach((part, k) => assert.ok(Math.abs(positions[k] - part) < 1e-6));
  assert.deepEqual([...normals], [1, 0, -1]);
});

test("a file of another number of vertices is of another version", () => {
  assert.throws(() => readBuilds(new ArrayBuffer(10), MESH, BUILDS), /another version/);
});
