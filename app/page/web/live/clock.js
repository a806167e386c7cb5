/** The stage's clock while somebody speaks; as Lockstep is that of a run. Moments are those of what is kept of the motion. */

import { FPS } from "../stage/motion.js";

/** Emits "time" for each picture that may be drawn, "state" when it begins and ends. */
export class LiveClock extends EventTarget {
  isWaiting = false; // the body stands still where no frame has come
  /** @type {import("./rolling.js").Rolling | null} */
  #rolling = null; // until there is a body
  #playout = null; // null while nothing goes on
  #place = 0;

  /** @param {import("./rolling.js").Rolling} rolling */
  follow(rolling) {
    this.#rolling = rolling;
  }

  get isPlaying() {
    return this.#playout !== null;
  }

  /** Seconds. */
  get time() {
    const place = this.#playout?.place ?? null;
    if (place !== null) this.#place = place;
    return (this.place - this.#first) / FPS;
  }

  get frame() {
    return Math.floor(this.place - this.#first);
  }

  get #first() {
    return this.#rolling?.first ?? 0;
  }

  /** What was last shown, in frames from the first that was spoken. */
  get place() {
    return this.#rolling?.within(this.#place) ?? 0;
  }

  /** @param {import("./playout.js").Playout} playout */
  begin(playout) {
    this.#playout = playout;
    this.dispatchEvent(new Event("state"));
  }

  /** Stand where it is. */
  end() {
    this.#playout = null;
    this.dispatchEvent(new Event("state"));
  }

  tick() {
    this.dispatchEvent(new Event("time"));
  }

  setLimit() {} // it never waits
}
