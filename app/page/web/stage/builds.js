/**
 * The other builds of the page's one body: who has no need of them does not wait for them.
 *
 * A build is { positions, normals }, as those of the mesh; it has the mesh's joints and face.
 */

import { fetched } from "../body/glb.js";

const BUILDS_URL = "stage/builds.bin";
const FULL = 32767; // of a normal's part
let fetching = null;

/**
 * By name; a later call asks again where an earlier one failed.
 *
 * @param {import("./mesh.js").Mesh} mesh
 * @param {import("../told").Facts["builds"]} told
 * @returns {Promise<Map<string, { positions: Float32Array, normals: Float32Array }>>}
 */
export function theBuilds(mesh, told) {
  fetching ??= fetched(BUILDS_URL, new AbortController().signal)
    .then((content) => readBuilds(content, mesh, told))
    .catch((error) => {
      fetching = null;
      throw error;
    });
  return fetching;
}

/** As renderer/files/builds.py writes them; the first of the names is the mesh itself. */
export function readBuilds(content, { positions, normals }, { names, step }) {
  const size = positions.length;
  if (content.byteLength !== 4 * size * (names.length - 1)) throw new Error("The page is of another version; load it again.");
  const builds = new Map([[names[0], { positions, normals }]]);
  names.slice(1).forEach((name, i) => {
    const offsets = new Int16Array(content, 4 * size * i, size);
    const steps = new Int16Array(content, 4 * size * i + 2 * size, size);
    builds.set(name, {
      positions: positions.map((part, k) => part + step * offsets[k]),
      normals: Float32Array.from(steps, (part) => part / FULL),
    });
  });
  return builds;
}
