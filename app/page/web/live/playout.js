/**
 * Which frame of those that come from the server is to be shown now.
 *
 * Every frame belongs to a moment of the sound and is shown a delay after that moment. The delay is
 * that of the latest frames that came, and some more; it grows at once and shrinks slowly.
 */

const FRAME_MS = 1000 / 30;
const SPARE_MS = 50;
const REMEMBERED_MS = 6000; // how long a late message keeps the delay up
const SHRINK = 0.04; // of the time that passes
const HURRY = 0.15; // the same, where the body is far behind
const FAR_MS = 400;
const CLOCK_BLOCKS = 100; // 4 s: a busy machine loses sound, and then its clock is another

export class Playout {
  delay = null; // ms
  /** That a display asks for besides, ms: filters look ahead. */
  ahead = 0;
  #begun = 0; // when the first sample was spoken: the earliest that the last blocks tell
  #begins = [];
  #samples = 0;
  #late = []; // [when it came, ms after its moment]
  #shrunkAt = 0;
  #latencies = [];

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
  get place() {
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
