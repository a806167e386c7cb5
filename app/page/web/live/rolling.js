/** A motion that goes on for as long as somebody speaks: its last seconds, as the stage shows them. */

import { Shown } from "../stage/displays.js";
import { Framing } from "../stage/framing.js";
import { joined, Motion, NUM_JOINTS } from "../stage/motion.js";

const BUFFER_FRAMES = 150;
const WALK_FRAMES = 90; // in which the ground goes most of the way after the body
const CLOSE_FRAMES = { face: 6, left_hand: 3, right_hand: 3 }; // the same of the cameras of close-ups
const ROOM_M = 0.05; // around a hand, for what its camera lags behind
const AT_ONCE = 0.01; // frames: cameras of poses that have nothing to do with each other

export class Rolling {
  /** Number of the first frame that is kept. */
  first = 0;
  #mesh;
  #maxTurn;
  #motion = null;
  shown; // what is kept, as the stage displays it; another with each `push`
  #centre = null; // x and z
  #tracks = new Map(); // by view: the middle of a close-up, (T, 3)

  constructor(mesh, maxTurn) {
    this.#mesh = mesh;
    this.#maxTurn = maxTurn;
  }

  /** The nearest frame that is there. */
  within(place) {
    return Math.max(this.first, Math.min(place, this.first + this.#motion.length - 1));
  }

  /** Go on with frames from number `first` on; anew where some between were lost. */
  push(first, motion) {
    const goesOn = this.#motion && first === this.first + this.#motion.length;
    if (!goesOn) [this.#motion, this.#centre, this.first] = [null, null, first];
    const centred = this.#centred(motion);
    const whole = this.#motion ? joined([this.#motion, centred]) : centred;
    const from = Math.max(0, whole.length - BUFFER_FRAMES);
    const before = goesOn ? this.#tracks : new Map();
    this.#motion = whole.part(from);
    this.shown = new Shown(this.#motion, this.#mesh, this.#maxTurn);
    this.#tracks = new Map();
    for (const [view, { joints, places }] of before) this.#follow(view, joints, places.subarray(3 * from));
    this.first += from;
  }

  /** What the camera of a close-up goes along with, (T, 3). */
  track({ view, joints }) {
    if (!this.#tracks.has(view)) this.#follow(view, joints, new Float32Array(0));
    return this.#tracks.get(view).places;
  }

  /** On the ground that goes after it, so that nobody walks away. */
  #centred(motion) {
    const positions = Float32Array.from(motion.positions);
    for (let at = 0; at < positions.length; at += 3) {
      const place = [positions[at], positions[at + 2]];
      this.#centre = this.#centre?.map((value, k) => value + lagging(WALK_FRAMES) * (place[k] - value)) ?? place;
      positions[at] -= this.#centre[0];
      positions[at + 2] -= this.#centre[1];
    }
    return new Motion(positions, motion.rotations, motion.faces, motion.numFaces);
  }

  /** Go on with a track from what is known of it. */
  #follow(view, joints, previous) {
    const { places } = this.shown.version(false);
    const track = new Float32Array(places.length / NUM_JOINTS);
    track.set(previous);
    for (let frame = previous.length / 3; frame < track.length / 3; frame++) {
      for (let k = 0; k < 3; k++) {
        let middle = 0;
        for (const joint of joints) middle += places[3 * (NUM_JOINTS * frame + joint) + k] / joints.length;
        const before = frame ? track[3 * (frame - 1) + k] : middle;
        track[3 * frame + k] = before + lagging(CLOSE_FRAMES[view]) * (middle - before);
      }
    }
    this.#tracks.set(view, { joints, places: track });
  }
}

/** Cameras for a motion that nobody knows yet: framed for all that it hardly leaves, and along with it. */
export class Following extends Framing {
  #rolling;
  #nowhere = new Float32Array(3 * BUFFER_FRAMES); // the ground goes along

  /**
   * @param {import("../stage/mesh.js").Mesh} mesh
   * @param {import("../messages").ViewerConstants} facts
   * @param {Motion} reaches Poses that it hardly leaves.
   * @param {Rolling} rolling
   */
  constructor(mesh, facts, reaches, rolling) {
    const { framing } = facts;
    const still = { ...framing, fingertip: framing.fingertip + ROOM_M, follow_beyond: Infinity, walk_sigma: AT_ONCE, face_sigma: AT_ONCE, hand_sigma: AT_ONCE };
    super(mesh, { ...facts, framing: still }, [new Shown(reaches, mesh, 0).version(false).places]);
    this.#rolling = rolling;
  }

  track(_body, closeUp = null) {
    return closeUp ? this.#rolling.track(closeUp) : this.#nowhere;
  }
}

/** Of the way to where something is now, in one frame. */
function lagging(frames) {
  return 1 - Math.exp(-1 / frames);
}
