/**
 * The other builds of the page's one body: who has no need of them does not wait for them.
 *
 * A build is { positions, normals }, as those of the mesh; it has the mesh's joints and face.
 */

import { answered, fetchedOnce } from "../fetched.js";

const BUILDS_URL = "stage/builds.bin";
const FULL = 32767; // of a normal's part

/**
 * By name; a later call asks again where an earlier one failed.
 *
 * @type {(mesh: import("./mesh.js").Mesh, facts: import("../messages").ViewerConstants["builds"]) => Promise<Map<string, { positions: Float32Array, normals: Float32Array }>>}
 */
export const theBuilds = fetchedOnce(async (mesh, facts) => readBuilds(await (await answered(BUILDS_URL)).arrayBuffer(), mesh, facts));

/** As renderer/files/glb.py writes them; the first of the names is the mesh itself. */
export function readBuilds(content, mesh, { names, step }) {
  const { positions, normals } = mesh;
  const size = positions.length;
  if (content.byteLength !== 4 * size * (names.length - 1)) throw new Error("The server has another version of this page. Please reload the page.");
  const builds = new Map([[names[0], { positions, normals }]]);
  names.slice(1).forEach((name, i) => {
    const offsets = mesh.inOrder(new Int16Array(content, 4 * size * i, size));
    const steps = mesh.inOrder(new Int16Array(content, 4 * size * i + 2 * size, size));
    builds.set(name, {
      positions: positions.map((part, k) => part + step * offsets[k]),
      normals: Float32Array.from(steps, (part) => part / FULL),
    });
  });
  return builds;
}
