/** Where cameras stand so that nothing that moves leaves a picture; as renderer/scene has it. */

import { gaussian } from "./filters.js";
import { NUM_JOINTS } from "./motion.js";

/**
 * The nearest camera of a view that has balls around all points inside its picture.
 *
 * `points` are (N, 3), `radii` (N), `axes` the camera's right, up and backward; gives its `eye`.
 */
export function framePoints(points, radii, axes, aspect, { yfov, near, margin }) {
  const [right, up, back] = axes;
  const tanY = (1 - margin) * Math.tan(yfov / 2);
  const tanX = tanY * aspect;
  const [slopeX, slopeY] = [Math.hypot(1, tanX), Math.hypot(1, tanY)];
  let [highX, lowX, highY, lowY, nearest] = new Array(5).fill(-Infinity);
  for (let i = 0; i < radii.length; i++) {
    const [x, y, z] = [points[3 * i], points[3 * i + 1], points[3 * i + 2]];
    const radius = radii[i];
    const depth = x * back[0] + y * back[1] + z * back[2];
    const across = x * right[0] + y * right[1] + z * right[2];
    const above = x * up[0] + y * up[1] + z * up[2];
    const outX = tanX * depth + radius * slopeX;
    const outY = tanY * depth + radius * slopeY;
    highX = Math.max(highX, across + outX);
    lowX = Math.max(lowX, -across + outX);
    highY = Math.max(highY, above + outY);
    lowY = Math.max(lowY, -above + outY);
    nearest = Math.max(nearest, depth + radius);
  }
  const x = (highX - lowX) / 2;
  const y = (highY - lowY) / 2;
  const z = Math.max((highX + lowX) / (2 * tanX), (highY + lowY) / (2 * tanY), nearest + 2 * near);
  return [0, 1, 2].map((k) => x * right[k] + y * up[k] + z * back[k]);
}

export const GLIDE_MS = 700;

/** The stage of some motions: floor, cameras, and what these follow. */
export class Framing {
  #before = null; // while cameras go over to these from those of motions that have grown since
  #begun = performance.now();
  #mesh;
  #facts;
  #all;
  #tracks = new Map();
  #cameras = new Map();
  floor;
  centre; // x and z
  #halfSize; // of the ground
  isFollowing; // whether cameras go along with bodies that wander

  /**
   * @param {import("./mesh.js").Mesh} mesh
   * @param {import("../messages").ViewerConstants} facts
   * @param {Float32Array[]} all Where joints are, of each body (T, J, 3).
   * @param {Framing | null} before From whose cameras these go over, so that none jumps.
   */
  constructor(mesh, facts, all, before = null) {
    this.#mesh = mesh;
    this.#facts = facts;
    this.#all = all;
    const [bounds, pelvis] = [3, 3 * NUM_JOINTS].map((step) => boundsOf(all, step));
    this.floor = median(all.map((places) => this.#floorOf(places)));
    this.centre = [0, 2].map((k) => (bounds.low[k] + bounds.high[k]) / 2);
    this.#halfSize = facts.ground.half_size + Math.max(...[0, 2].map((k) => bounds.high[k] - bounds.low[k])) / 2;
    this.isFollowing = Math.max(...pelvis.high.map((high, k) => high - pelvis.low[k])) > facts.framing.follow_beyond;
    if (before?.isFollowing === this.isFollowing) this.#before = before;
  }

  /** The ground that a body stands on at a frame, as Painter has it: where cameras follow, it goes along over a grid. */
  ground(body, frame) {
    const { floor, centre, isFollowing } = this;
    if (!isFollowing) return { centre, floor, halfSize: this.#halfSize, hasGrid: false };
    const [x, , z] = this.#track(body).subarray(3 * frame);
    return { centre: [x, z], floor, halfSize: this.#facts.ground.half_size, hasGrid: true };
  }

  /** A camera of these, or on its way from where it stood before. */
  #eased(after, of) {
    const left = 1 - Math.min(1, (performance.now() - this.#begun) / GLIDE_MS);
    if (!left) this.#before = null;
    if (!this.#before) return after;
    const { eye } = of(this.#before);
    const share = left * left * (3 - 2 * left);
    return { axes: after.axes, eye: after.eye.map((part, k) => part + share * (eye[k] - part)) };
  }

  /** Height of the soles in the median frame. */
  #floorOf(places) {
    const feet = ["left_ankle", "right_ankle", "left_foot", "right_foot"].map((name) => this.#mesh.names.indexOf(name));
    const lowest = [];
    for (let at = 0; at < places.length; at += 3 * NUM_JOINTS) {
      lowest.push(Math.min(...feet.map((joint) => places[at + 3 * joint + 1] - (this.#mesh.rest[3 * joint + 1] - this.#mesh.sole))));
    }
    return median(lowest);
  }

  /** The camera of the whole picture: its axes and eye, where it follows relative to `track`. */
  body(view, aspect, isWhole) {
    const key = `${view} ${aspect.toFixed(3)} ${isWhole}`;
    if (!this.#cameras.has(key)) {
      const { below_knees: below, knee_flesh: flesh } = this.#facts.framing;
      const joints = this.#mesh.names.flatMap((name, joint) => (isWhole || !below.some((part) => name.includes(part)) ? [joint] : []));
      const reach = joints.map((joint) => {
        const isKnee = !isWhole && this.#mesh.names[joint].endsWith("_knee");
        return isKnee ? Math.min(this.#mesh.reach[joint], flesh) : this.#mesh.reach[joint];
      });
      this.#cameras.set(key, this.#camera(view, aspect, joints, reach, (k) => (this.isFollowing ? this.#track(k) : null)));
    }
    return this.#eased(this.#cameras.get(key), (before) => before.body(view, aspect, isWhole));
  }

  /** That of a close-up, relative to its `track`; of a hand, no more of the arm than there is room for. */
  closeUp({ view, joints }, aspect) {
    const key = `${view} ${aspect.toFixed(3)}`;
    if (!this.#cameras.has(key)) {
      const { fingertip } = this.#facts.framing;
      const reach = joints.map((joint) => (view === "face" ? this.#mesh.reach[joint] : Math.min(this.#mesh.reach[joint], fingertip)));
      this.#cameras.set(key, this.#camera(view, aspect, joints, reach, (k) => this.#track(k, { view, joints })));
    }
    return this.#eased(this.#cameras.get(key), (before) => before.closeUp({ view, joints }, aspect));
  }

  #camera(view, aspect, joints, reach, trackOf) {
    const axes = this.#facts.views[view];
    const points = [];
    const radii = [];
    for (const [k, places] of this.#all.entries()) {
      const track = trackOf(k);
      for (let frame = 0; frame < places.length / (3 * NUM_JOINTS); frame++) {
        joints.forEach((joint, i) => {
          const at = 3 * (NUM_JOINTS * frame + joint);
          for (let axis = 0; axis < 3; axis++) points.push(places[at + axis] - (track ? track[3 * frame + axis] : 0));
          radii.push(reach[i]);
        });
      }
    }
    return { axes, eye: framePoints(points, radii, axes, aspect, this.#facts.camera) };
  }

  /**
   * What a camera goes along with, (T, 3), never far from it: the middle of a close-up's joints, or the way of the
   * pelvis, up and down only of a body that rises far.
   */
  track(body, closeUp = null) {
    return this.#track(body, closeUp);
  }

  #track(body, closeUp = null) {
    const key = `${body} ${closeUp?.view ?? ""}`;
    if (!this.#tracks.has(key)) {
      const places = this.#all[body];
      const joints = closeUp?.joints ?? [0];
      const middle = new Float32Array(places.length / NUM_JOINTS);
      for (let frame = 0; frame < middle.length / 3; frame++) {
        for (const joint of joints) {
          for (let k = 0; k < 3; k++) middle[3 * frame + k] += places[3 * (NUM_JOINTS * frame + joint) + k] / joints.length;
        }
      }
      const { walk_sigma: walk, face_sigma: face, hand_sigma: hand, lead, close_lead: closeLead, follow_beyond: beyond } = this.#facts.framing;
      if (!closeUp) {
        const stands = this.#floorOf(places) + this.#mesh.rest[1] - this.#mesh.sole;
        const { low, high } = boundsOf([middle], 3);
        const isRising = high[1] - low[1] > beyond;
        for (let at = 1; at < middle.length; at += 3) middle[at] = isRising ? middle[at] - stands : 0;
      }
      const sigma = !closeUp ? walk : closeUp.view === "face" ? face : hand;
      this.#tracks.set(key, leashed(gaussian(middle, 3, sigma), middle, closeUp ? closeLead : lead));
    }
    return this.#tracks.get(key);
  }
}

/** A camera's matrix, 4 x 4 row by row, from world to clip coordinates, and where it stands. */
export function lens({ axes, eye }, aspect, { yfov, near }) {
  const tangent = Math.tan(yfov / 2);
  const [right, up, back] = axes.map((axis) => [...axis, -axis.reduce((sum, part, k) => sum + part * eye[k], 0)]);
  const forward = back.map((part) => -part);
  return [
    ...right.map((part) => part / (tangent * aspect)),
    ...up.map((part) => part / tangent),
    ...forward.map((part, i) => (i === 3 ? part - 2 * near : part)), // nothing is too far away
    ...forward,
  ];
}

/** Where a point lies in a picture: 0 to 1 from its upper left corner; null behind the camera. */
export function projected(matrix, [x, y, z]) {
  const row = (i) => matrix[i] * x + matrix[i + 1] * y + matrix[i + 2] * z + matrix[i + 3];
  const depth = row(12);
  return depth > 0 ? [0.5 + row(0) / (2 * depth), 0.5 - row(4) / (2 * depth)] : null;
}

/** Each point of `track` at most `lead` from that of `goal`; in place. */
function leashed(track, goal, lead) {
  for (let at = 0; at < track.length; at += 3) {
    const away = [0, 1, 2].map((k) => track[at + k] - goal[at + k]);
    const share = Math.min(1, lead / (Math.hypot(...away) || 1));
    away.forEach((part, k) => (track[at + k] = goal[at + k] + share * part));
  }
  return track;
}

/** Of each `step`th number and the two after it. */
function boundsOf(all, step) {
  const [low, high] = [new Array(3).fill(Infinity), new Array(3).fill(-Infinity)];
  for (const places of all) {
    for (let at = 0; at < places.length; at += step) {
      for (let k = 0; k < 3; k++) {
        low[k] = Math.min(low[k], places[at + k]);
        high[k] = Math.max(high[k], places[at + k]);
      }
    }
  }
  return { low, high };
}

function median(values) {
  const ordered = [...values].sort((a, b) => a - b);
  const middle = ordered.length >> 1;
  return ordered.length % 2 ? ordered[middle] : (ordered[middle - 1] + ordered[middle]) / 2;
}
