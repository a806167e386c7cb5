/**
 * Which frame of those that come from the server is to be shown now: the stage's clock while somebody speaks, as Lockstep is
 * that of a run. Its moments are those of what is kept of the motion.
 *
 * Every frame belongs to a moment of the sound and is shown a delay after that moment. The delay is
 * that of the latest frames that came, and some more; it grows at once and shrinks slowly.
 */

import { FPS } from "../stage/motion.js";

const FRAME_MS = 1000 / FPS;
const SPARE_MS = 50;
const REMEMBERED_MS = 6000; // how long a late message keeps the delay up
const SHRINK = 0.04; // of the time that passes
const HURRY = 0.15; // the same, where the body is far behind
const FAR_MS = 400;
const CLOCK_BLOCKS = 100; // 4 s: a busy machine loses sound, and then its clock is another

/** Emits "time" for each picture that may be drawn, "state" when it begins and ends. */
export class Playout extends EventTarget {
  isPlaying = false;
  isWaiting = false; // the body stands still where no frame has come
  /** ms that a display asks for besides: filters look ahead. */
  ahead = 0;
  /** @type {import("./rolling.js").Rolling | null} */
  rolling = null; // until there is a body
  #place = 0;
  #begins;
  #samples;
  #late; // [when it came, ms after its moment]
  #latencies;
  #begun = 0; // when the first sample was spoken: the earliest that the last blocks tell
  #shrunkAt = 0;

  constructor() {
    super();
    this.clear();
  }

  /** Another session: nothing is known of it yet. */
  clear() {
    this.delay = null; // ms
    this.#begins = [];
    this.#samples = 0;
    this.#late = [];
    this.#latencies = [];
  }

  /** Go on, or stand where it is. */
  go(isPlaying) {
    this.isPlaying = isPlaying;
    this.dispatchEvent(new Event("state"));
  }

  tick() {
    this.dispatchEvent(new Event("time"));
  }

  setLimit() {} // it never waits

  /** Seconds. */
  get time() {
    if (this.isPlaying) this.#place = this.#now ?? this.#place;
    return (this.place - this.#first) / FPS;
  }

  get frame() {
    return Math.floor(this.place - this.#first);
  }

  get #first() {
    return this.rolling?.first ?? 0;
  }

  /** What was last shown, in frames from the first that was spoken. */
  get place() {
    return this.rolling?.within(this.#place) ?? 0;
  }

  /** A block of sound was captured just now. */
  captured(samples) {
    this.#samples += samples;
    this.#begins = [...this.#begins.slice(-CLOCK_BLOCKS), performance.now() - this.#samples / 16];
    this.#begun = Math.min(...this.#begins);
  }

  /** A message of the server has come; returns what it says besides its frames. */
  came(message) {
    const view = new DataView(message);
    const first = view.getUint32(0, true);
    this.#wasLate(performance.now() - this.#moment(first));
    return {
      first,
      madeMs: view.getFloat32(8, true),
      waitedMs: view.getFloat32(12, true),
      visitors: view.getUint16(16, true),
    };
  }

  /** The frame to be shown now, and how far it is on the way to the next; null before any came. */
  get #now() {
    if (this.delay === null) return null;
    const time = performance.now();
    this.#shrink(time);
    return (time - this.delay - this.#moment(0)) / FRAME_MS;
  }

  /** The frame at `place` is on the screen. */
  shown(place) {
    this.#latencies = [...this.#latencies.slice(-29), performance.now() - this.#moment(place)];
  }

  /** Of the last pictures, ms from the moment that each shows being spoken; the median. */
  get latency() {
    const sorted = [...this.#latencies].sort((a, b) => a - b);
    return sorted.length ? sorted[sorted.length >> 1] : null;
  }

  #moment(frame) {
    return this.#begun + (frame + 0.5) * FRAME_MS;
  }

  #wasLate(ms) {
    const now = performance.now();
    this.#late = [...this.#late.filter(([when]) => when > now - REMEMBERED_MS), [now, ms]];
    this.delay = Math.max(this.delay ?? 0, ms + SPARE_MS + this.ahead);
  }

  #shrink(now) {
    const needed = SPARE_MS + this.ahead + Math.max(...this.#late.map(([, ms]) => ms));
    const passed = Math.min(100, now - this.#shrunkAt);
    this.#shrunkAt = now;
    if (this.delay <= needed) return;
    const rate = this.delay - needed > FAR_MS ? HURRY : SHRINK;
    this.delay = Math.max(needed, this.delay - rate * passed);
  }
}
