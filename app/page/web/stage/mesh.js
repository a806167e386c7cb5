/**
 * The body that all motions of a page move: its rest pose, its skeleton, and coarser meshes of the
 * same vertices for machines that draw slowly.
 */

import { readGlb } from "../body/glb.js";
import { answered, fetchedOnce } from "../fetched.js";

const BODY_URL = "live/body.glb";

/** @type {() => Promise<Mesh>} The page's one body. */
export const theBody = fetchedOnce(async () => new Mesh(readGlb(await (await answered(BODY_URL)).arrayBuffer())));

export class Mesh {
  positions; // at rest, (V, 3) one after the other, as all below
  normals;
  colors; // linear, 16 bit, (V, 4)
  joints; // (V, 4), the strongest first
  weights; // 16 bit, (V, 4)
  uv = null; // of a character's texture, (V, 2)
  /** @type {ImageBitmap | null} */
  picture = null; // that texture
  jawTarget = -1; // target that opens a mouth whose jaw is not a bone
  #levels; // faces (F, 3) of each mesh, the whole first
  #counts; // of each, how many vertices it and the coarser ones have: they come first
  place; // of each vertex of the file among those here
  targets; // of the face: each { name, indices, values }
  parents; // of the joints
  offsets; // (J, 3) to their parents
  names; // of the joints
  #parts = new Map();

  constructor({ document, array }) {
    const { attributes, indices, targets = [] } = document.meshes[0].primitives[0];
    const levels = [indices, ...document.meshes.slice(1).map(({ primitives }) => primitives[0].indices)].map(array);
    const coarsest = new Uint8Array(document.accessors[attributes.POSITION].count); // mesh that has the vertex
    for (const [level, faces] of levels.entries()) for (const vertex of faces) coarsest[vertex] = level;
    const order = Uint32Array.from(coarsest.keys()).sort((a, b) => coarsest[b] - coarsest[a] || a - b);
    this.place = new Uint32Array(order.length);
    order.forEach((vertex, i) => (this.place[vertex] = i));
    this.#counts = levels.map((_, level) => coarsest.reduce((count, each) => count + Number(each >= level), 0));
    this.#levels = levels.map((faces) => sorted(faces.map((vertex) => this.place[vertex])));
    this.positions = this.inOrder(array(attributes.POSITION));
    this.normals = this.inOrder(array(attributes.NORMAL));
    this.colors = this.inOrder(array(attributes.COLOR_0));
    this.joints = this.inOrder(array(attributes.JOINTS_0));
    this.weights = this.inOrder(array(attributes.WEIGHTS_0));
    if (attributes.TEXCOORD_0 !== undefined) this.uv = this.inOrder(array(attributes.TEXCOORD_0));
    this.jawTarget = document.meshes[0].extras?.jawTarget ?? -1;
    const named = document.meshes[0].extras?.targetNames ?? [];
    this.targets = targets.map(({ POSITION }, i) => {
      const { indices: moved, values } = array(POSITION);
      return { name: named[i], indices: moved.map((vertex) => this.place[vertex]), values };
    });
    const { joints } = document.skins[0];
    this.names = joints.map((node) => document.nodes[node].name);
    this.parents = new Int16Array(joints.length).fill(-1);
    joints.forEach((node, joint) => {
      for (const child of document.nodes[node].children ?? []) this.parents[joints.indexOf(child)] = joint;
    });
    // Where the animation moves the root, its node has no place of the skeleton's own.
    const binds = array(document.skins[0].inverseBindMatrices);
    this.rest = Float32Array.from({ length: 3 * joints.length }, (_, i) => -binds[16 * Math.floor(i / 3) + 12 + (i % 3)]);
    this.offsets = this.rest.map((place, i) => {
      const parent = this.parents[Math.floor(i / 3)];
      return parent < 0 ? place : place - this.rest[3 * parent + (i % 3)];
    });
    this.reach = this.#reach();
    this.sole = this.positions.reduce((least, y, i) => (i % 3 === 1 ? Math.min(least, y) : least), Infinity);
  }

  /**
   * Colours of all vertices in another tone: each region by its colour in the tone that the mesh has.
   *
   * @param {Record<string, number[]>} own Colour of each region, 0 to 1.
   * @param {Record<string, number[]>} other
   */
  toned(own, other) {
    const regions = Object.entries(own).map(([name, color]) => [color.map((part) => 65535 * part), other[name].map((part) => Math.round(65535 * part))]);
    const colors = Uint16Array.from(this.colors);
    for (let at = 0; at < colors.length; at += 4) {
      let [best, least] = [null, Infinity];
      for (const [from, to] of regions) {
        const away = Math.abs(colors[at] - from[0]) + Math.abs(colors[at + 1] - from[1]) + Math.abs(colors[at + 2] - from[2]);
        if (away < least) [best, least] = [to, away];
      }
      colors.set(best, at);
    }
    return colors;
  }

  /** Numbers of all vertices, as they come in files, in the order that they have here. */
  inOrder(values) {
    const width = values.length / this.place.length;
    const ordered = new values.constructor(values.length);
    this.place.forEach((to, from) => ordered.set(values.subarray(width * from, width * (from + 1)), width * to));
    return ordered;
  }

  /** Of a level and the coarser ones. */
  numVertices(level) {
    return this.#counts[Math.min(level, this.#counts.length - 1)];
  }

  /** Of each joint: how far the flesh that follows it reaches at rest, metres. */
  #reach() {
    const reach = new Float32Array(this.names.length);
    for (let v = 0; v < this.place.length; v++) {
      const joint = this.joints[4 * v];
      const far = Math.hypot(...[0, 1, 2].map((k) => this.positions[3 * v + k] - this.rest[3 * joint + k]));
      if (far > reach[joint]) reach[joint] = far;
    }
    return reach;
  }

  /** Faces of a mesh, 0 being the whole and higher ones coarser. */
  level(level) {
    return this.#levels[Math.min(level, this.#levels.length - 1)];
  }

  /** The part of a level that follows some of the joints alone, closed where it is cut off. */
  part(level, joints) {
    const key = `${level} ${joints}`;
    if (!this.#parts.has(key)) {
      const faces = this.level(level);
      const drawn = new Set(joints);
      const isDrawn = (vertex) => drawn.has(this.joints[4 * vertex]) && !this.#isNearTrunk(vertex, joints);
      const [inner, border] = [[], []];
      for (let i = 0; i < faces.length; i += 3) {
        const face = faces.subarray(i, i + 3);
        if (face.every(isDrawn)) inner.push(...face);
        else if (face.some(isDrawn)) border.push(...face);
      }
      this.#parts.set(key, faces.constructor.from([...inner, ...this.#lids(inner, border)]));
    }
    return this.#parts.get(key);
  }

  /** Whether it is of the upper half of an arm that is drawn alone: at the shoulder its end would be ragged. */
  #isNearTrunk(vertex, [shoulder, elbow]) {
    if (this.joints[4 * vertex] !== shoulder || !this.names[shoulder].endsWith("_shoulder")) return false;
    const from = (values, at) => [0, 1, 2].map((k) => values[3 * at + k] - this.rest[3 * shoulder + k]);
    const [arm, here] = [from(this.rest, elbow), from(this.positions, vertex)];
    return arm.reduce((sum, each, k) => sum + each * (here[k] - each / 2), 0) < 0;
  }

  /** Faces over the ends at which some were cut off from others: of each end a fan from one of its corners. */
  #lids(inner, border) {
    const places = new Map(); // seams of colours are not ends
    const placeOf = (vertex) => {
      if (!places.has(vertex)) places.set(vertex, this.positions.subarray(3 * vertex, 3 * vertex + 3).join());
      return places.get(vertex);
    };
    const edges = (faces) => faces.map((vertex, i) => [vertex, placeOf(vertex), placeOf(faces[i % 3 === 2 ? i - 2 : i + 1])]);
    const others = new Set(edges(border).map(([, from, to]) => `${to} ${from}`));
    const cut = edges(inner).filter(([, from, to]) => others.has(`${from} ${to}`));
    const next = new Map(cut.map(([vertex, from, to]) => [from, [vertex, to]]));
    const lids = [];
    while (next.size) {
      const ring = [];
      for (let at = next.keys().next().value; next.has(at); ) {
        const [vertex, to] = next.get(at);
        next.delete(at);
        ring.push(vertex);
        at = to;
      }
      for (let i = 2; i < ring.length; i++) lids.push(ring[0], ring[i], ring[i - 1]);
    }
    return lids;
  }
}

/** Neighbours one after the other: a vertex that two share is then lit once. */
function sorted(faces) {
  const order = Uint32Array.from({ length: faces.length / 3 }, (_, i) => i);
  const least = order.map((i) => Math.min(faces[3 * i], faces[3 * i + 1], faces[3 * i + 2]));
  order.sort((a, b) => least[a] - least[b] || a - b);
  const ordered = new faces.constructor(faces.length);
  order.forEach((from, to) => ordered.set(faces.subarray(3 * from, 3 * from + 3), 3 * to));
  return ordered;
}
