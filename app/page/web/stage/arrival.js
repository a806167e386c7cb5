/** A motion that comes window by window: its file grows, and what is new of it is fetched. */

import { answered } from "../fetched.js";
import { joined, unpacked } from "./motion.js";

const GROWN = 1.2; // so many times as long, it is worth working out anew

export class Arrival {
  #url;
  #fetched;
  #parts = [];
  #bytes = 0;
  #end = 0; // frames fetched
  #numReturned = 0;

  /** `fetched(url, from, to)` gives bytes of a file. */
  constructor(url, fetched = bytesOf) {
    this.#url = url;
    this.#fetched = fetched;
  }

  /**
   * The motion as far as it has come, or null where nothing of it is new, or worth working out yet.
   *
   * @param {import("../messages").FramesAvailable} there What the server has by now.
   * @param {number} needed Frames that are about to be shown.
   */
  async next(there, needed) {
    if (there.num_bytes > this.#bytes) {
      const part = unpacked(await this.#fetched(this.#url, this.#bytes, there.num_bytes), this.#end);
      this.#parts.push(part);
      this.#bytes = there.num_bytes;
      this.#end += part.length;
    }
    const isWorthIt = this.#end === there.num_frames || this.#end >= GROWN * this.#numReturned || needed > this.#numReturned;
    if (this.#end === this.#numReturned || !isWorthIt) return null;
    this.#numReturned = this.#end;
    return joined(this.#parts);
  }
}

const fetching = new Map(); // what several bodies want at once

async function bytesOf(url, from, to) {
  const key = `${url} ${from}-${to}`;
  if (!fetching.has(key)) fetching.set(key, fetchBytes(url, from, to).finally(() => fetching.delete(key)));
  return fetching.get(key);
}

async function fetchBytes(url, from, to) {
  const answer = await answered(url, { headers: { Range: `bytes=${from}-${to - 1}` }, cache: "no-store" });
  const content = await answer.arrayBuffer();
  return answer.status === 206 ? content : content.slice(from, to); // a proxy may send the whole
}
