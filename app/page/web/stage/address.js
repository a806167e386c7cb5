/** What is seen, in the part of the address behind the #: a link shows the same picture. */

const MARK = "stage";
const WAIT_MS = 400; // browsers allow few changes in a while

export class Address {
  #parts;
  #timer = 0;

  /** `parts` each `write(params)` what they are and `read(params)` it again. */
  constructor(parts) {
    this.#parts = parts;
  }

  /** Take what the page was opened with; false where it says nothing of this. */
  read() {
    const params = new URLSearchParams(location.hash.slice(1));
    if (!params.has(MARK)) return false;
    for (const part of this.#parts) part.read(params);
    return true;
  }

  /** Soon, once nothing changes any more. */
  note() {
    clearTimeout(this.#timer);
    this.#timer = setTimeout(() => this.#write(), WAIT_MS);
  }

  /** No more. */
  end() {
    clearTimeout(this.#timer);
  }

  /** What is seen now, also where all is as usual. */
  get text() {
    const params = new URLSearchParams();
    for (const part of this.#parts) part.write(params);
    return params.size ? `#${MARK}&${params}` : "";
  }

  #write() {
    if (!location.protocol.startsWith("http")) return; // a file by itself has no address to be shared
    const hash = this.text;
    if (hash === location.hash || (!hash && !location.hash.startsWith(`#${MARK}`))) return;
    history.replaceState(history.state, "", location.pathname + location.search + hash);
  }
}
