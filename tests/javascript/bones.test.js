/** Lines over bodies, tones of them, and parts. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { axisCorners, boneCorners } from "../../app/page/web/stage/bones.js";
import { lens } from "../../app/page/web/stage/framing.js";
import { Look } from "../../app/page/web/stage/look.js";
import { Mesh } from "../../app/page/web/stage/mesh.js";

const CAMERA = { axes: [[1, 0, 0], [0, 1, 0], [0, 0, 1]], eye: [0, 0, 4] };
const MATRIX = lens(CAMERA, 1, { yfov: Math.PI / 2, near: 0.1 });
const panelBody = (world, overrides = {}) => ({ world: Float32Array.from(world), matrix: MATRIX, size: [200, 200], shift: [0, 0, 0], ...overrides });
const AT = (x, y, z) => [1, 0, 0, x, 0, 1, 0, y, 0, 0, 1, z];
const EACH = 6 * 5; // numbers of one line's corners

/** Middle of a line's corners in the panel, -1 to 1. */
function middle(corners, first) {
  const of = (k) => [0, 1, 2, 3, 4, 5].reduce((sum, corner) => sum + corners[first + 5 * corner + k] / 6, 0);
  return [of(0), of(1)];
}

test("a bone lies between its joints, and goes along with what is shifted", () => {
  const world = [...AT(-1, 0, 0), ...AT(1, 0, 0), ...AT(1, 2, 0)];
  const corners = boneCorners(panelBody(world), [-1, 0, 1]);
  assert.equal(corners.length, 2 * 2 * EACH, "two bones, each with its edge");
  assert.ok(Math.hypot(...middle(corners, 0)) < 1e-9);
  const [x, y] = middle(corners, EACH);
  assert.ok(Math.abs(x - 0.25) < 1e-6 && Math.abs(y - 0.25) < 1e-6, `${[x, y]}`);
  const shifted = boneCorners(panelBody(world, { shift: [1, 0, 0] }), [-1, 0, 1]);
  assert.ok(Math.abs(middle(shifted, 0)[0] - 0.25) < 1e-6);
  assert.deepEqual(boneCorners(panelBody(world, { drawn: [1, 2] }), [-1, 0, 1]).slice(0, EACH), corners.slice(EACH, 2 * EACH));
});

test("axes point where the joint's own do, and a joint behind the camera has none", () => {
  const turned = [0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1, 0]; // its x is the world's y
  const corners = axisCorners(panelBody([...turned, ...AT(0, 0, 9)]), [false, false]);
  assert.equal(corners.length, 3 * EACH);
  const [x, y] = middle(corners, 0);
  assert.ok(Math.abs(x) < 1e-6 && Math.abs(y - 0.07 / 8) < 1e-6, `${[x, y]}`);
  assert.deepEqual(corners.slice(2, 5), [0.86, 0.2, 0.16], "red");
  const fine = axisCorners(panelBody(turned), [true]);
  assert.ok(middle(fine, 0)[1] < middle(corners, 0)[1] / 3, "shorter where joints are close");
});

test("a tone changes each region by its own colour", () => {
  const own = { skin: [0.5, 0.4, 0.3], shirt: [0.1, 0.15, 0.26] };
  const other = { skin: [0.1, 0.05, 0.04], shirt: [0.3, 0.2, 0.1] };
  const levels = (...colors) => Uint16Array.from(colors.flatMap((color) => [...color.map((part) => Math.round(65535 * part)), 65535]));
  const mesh = { colors: levels(own.skin, own.shirt, own.skin) };
  const toned = Mesh.prototype.toned.call(mesh, own, other);
  assert.deepEqual(toned, levels(other.skin, other.shirt, other.skin));
  assert.deepEqual(mesh.colors, levels(own.skin, own.shirt, own.skin), "the mesh keeps its own");
});

const corners = 5; // of each of a tube's three rings, the last of which is its open end

/** A tube along x, a vertex every unit, of a joint for each vertex: the first at 0, the second at its end. */
function tube(first, jointOf) {
  const at = (ring, i) => corners * ring + (i % corners);
  const faces = [0, 1].flatMap((ring) => Array.from({ length: corners }, (_, i) => [at(ring, i), at(ring, i + 1), at(ring + 1, i), at(ring, i + 1), at(ring + 1, i + 1), at(ring + 1, i)]).flat());
  const each = (values) => Float32Array.from({ length: 3 * corners }, (_, vertex) => vertex).reduce((all, vertex) => [...all, ...values(vertex)], []);
  const arrays = {
    POSITION: Float32Array.from(each((vertex) => [vertex, 0, 0])), NORMAL: new Float32Array(9 * corners), COLOR_0: new Uint16Array(12 * corners), WEIGHTS_0: new Uint16Array(12 * corners), JOINTS_0: Uint8Array.from(each((vertex) => [jointOf(vertex), 0, 0, 0])),
    faces: Uint16Array.from(faces), binds: Float32Array.from({ length: 32 }, (_, i) => (i === 28 ? 1 - 3 * corners : 0)),
  };
  const attributes = Object.fromEntries(["POSITION", "NORMAL", "COLOR_0", "WEIGHTS_0", "JOINTS_0"].map((name) => [name, name]));
  const document = { accessors: { POSITION: { count: 3 * corners } }, meshes: [{ primitives: [{ attributes, indices: "faces" }] }], skins: [{ joints: [0, 1], inverseBindMatrices: "binds" }], nodes: [{ name: first, children: [1] }, { name: "b" }] };
  return new Mesh({ document, array: (name) => arrays[name] });
}

test("a part that is cut off a tube is closed where it was cut, and nowhere else", () => {
  const mesh = tube("a", (vertex) => Number(vertex >= corners));
  const part = mesh.part(0, [1]);
  assert.equal(part.length, 3 * (2 * corners + corners - 2), "its side, and a fan");
  const edges = (of) => of.map((from, i) => `${from} ${of[i % 3 === 2 ? i - 2 : i + 1]}`);
  const open = edges([...part]).filter((edge) => !edges([...part]).includes(edge.split(" ").reverse().join(" ")));
  assert.deepEqual(open.map((edge) => Math.min(...edge.split(" ").map(Number)) >= 2 * corners), new Array(corners).fill(true));
});

test("of an arm alone the half at the trunk is left out, whose end would be ragged", () => {
  const [arm, leg] = ["left_shoulder", "left_knee"].map((name) => tube(name, () => 0).part(0, [0, 1]));
  assert.deepEqual([Math.min(...arm), Math.min(...leg)], [7, 0], "7 is the middle of 0 and 14");
});

test("vertices of coarser meshes come first, each with what it had", () => {
  const arrays = {
    POSITION: Float32Array.from({ length: 12 }, (_, i) => i), NORMAL: new Float32Array(12), COLOR_0: new Uint16Array(16), WEIGHTS_0: new Uint16Array(16), JOINTS_0: new Uint8Array(16),
    fine: Uint16Array.of(0, 1, 2, 0, 2, 3), coarse: Uint16Array.of(1, 2, 3), binds: new Float32Array(16), target: { indices: Uint16Array.of(0, 3), values: new Float32Array(6) },
  };
  const attributes = Object.fromEntries(["POSITION", "NORMAL", "COLOR_0", "WEIGHTS_0", "JOINTS_0"].map((name) => [name, name]));
  const meshes = [{ primitives: [{ attributes, indices: "fine", targets: [{ POSITION: "target" }] }] }, { primitives: [{ indices: "coarse" }] }];
  const mesh = new Mesh({ document: { accessors: { POSITION: { count: 4 } }, meshes, skins: [{ joints: [0], inverseBindMatrices: "binds" }], nodes: [{}] }, array: (name) => arrays[name] });
  assert.deepEqual([0, 1, 9].map((level) => mesh.numVertices(level)), [4, 3, 3]);
  assert.deepEqual([...mesh.place], [3, 0, 1, 2]);
  assert.deepEqual([...mesh.level(1)], [0, 1, 2]);
  assert.deepEqual([...mesh.positions.subarray(9)], [0, 1, 2], "the first of the file is the last");
  assert.deepEqual([...mesh.targets[0].indices], [3, 2]);
});

test("an address tells of lines and tone", () => {
  const [look, other] = [new Look(), new Look()];
  for (const [name, value] of [["hasBones", true], ["hasAxes", true], ["tone", "dark"]]) look.set(name, value);
  const address = new URLSearchParams();
  look.write(address);
  other.read(address);
  assert.deepEqual(other.values, look.values);
});
