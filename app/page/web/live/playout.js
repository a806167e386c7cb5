/**
 * Frames as they come from the server, and which of them to show now.
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
const JOINTS = 55;
const HEADER_BYTES = 20;

export class Playout {
  delay = null; // ms
  #begun = 0; // when the first sample was spoken: the earliest that the last blocks tell
  #begins = [];
  #samples = 0;
  #frames = [];
  #first = 0; // number of the first in #frames
  #late = []; // [when it came, ms after its moment]
  #shrunkAt = 0;
  #shown = 0; // the moment of what `now` gave
  #latencies = [];

  /** A block of sound was captured just now. */
  captured(samples) {
    this.#samples += samples;
    this.#begins = [...this.#begins.slice(-CLOCK_BLOCKS), performance.now() - this.#samples / 16];
    this.#begun = Math.min(...this.#begins);
  }

  /** Take a message of the server; returns what it says besides its frames. */
  take(message) {
    const view = new DataView(message);
    const [first, count, faces] = [view.getUint32(0, true), view.getUint16(4, true), view.getUint16(6, true)];
    const rotationsAt = HEADER_BYTES + 12 * count;
    const facesAt = rotationsAt + 8 * JOINTS * count;
    for (let i = 0; i < count; i++) {
      const numbers = (Kind, at, length) => new Kind(message, at + i * length * Kind.BYTES_PER_ELEMENT, length);
      this.#frames.push({
        position: numbers(Float32Array, HEADER_BYTES, 3),
        rotations: numbers(Int16Array, rotationsAt, 4 * JOINTS),
        faces: numbers(Uint8Array, facesAt, faces),
      });
    }
    if (this.#frames.length === count) this.#first = first;
    this.#wasLate(performance.now() - this.#moment(first));
    return {
      frames: count,
      madeMs: view.getFloat32(8, true),
      waitedMs: view.getFloat32(12, true),
      visitors: view.getUint16(16, true),
    };
  }

  /** The two frames around now and the share of the second; null before there are any. */
  now() {
    if (this.delay === null) return null;
    const time = performance.now();
    this.#shrink(time);
    const place = (time - this.delay - this.#moment(0)) / FRAME_MS - this.#first;
    const last = this.#frames.length - 1;
    const at = Math.max(0, Math.min(place, last));
    const before = Math.floor(at);
    const pair = [this.#frames[before], this.#frames[Math.min(before + 1, last)], at - before];
    this.#shown = this.#moment(this.#first + at);
    this.#drop(before - 2);
    return pair;
  }

  /** What `now` gave is on the screen. */
  shown() {
    this.#latencies = [...this.#latencies.slice(-29), performance.now() - this.#shown];
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
    this.delay = Math.max(this.delay ?? 0, ms + SPARE_MS);
  }

  #shrink(now) {
    const needed = SPARE_MS + Math.max(...this.#late.map(([, ms]) => ms));
    const passed = Math.min(100, now - this.#shrunkAt);
    this.#shrunkAt = now;
    if (this.delay <= needed) return;
    const rate = this.delay - needed > FAR_MS ? HURRY : SHRINK;
    this.delay = Math.max(needed, this.delay - rate * passed);
  }

  #drop(count) {
    if (count <= 0) return;
    this.#frames.splice(0, count);
    this.#first += count;
  }
}
