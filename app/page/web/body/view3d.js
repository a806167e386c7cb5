/** A motion in 3D, in place of its video or until that is drawn; the mouse and keys turn it. */

import { make } from "../dom.js";
import { GlbView } from "./glb_view.js";
import { ORBIT_HELP } from "./orbit.js";

const PAUSE_MS = 80; // between two pictures while it plays
const SLOW_PAUSE_MS = 600; // where the processor has to draw them
const MOST_PX = 1100; // of the picture's height
const MOST_SLOW_PX = 480;

export class View3d {
  element;
  #canvas;
  #view;
  #orbit;
  #seconds = 0;
  #drawn = -Infinity; // when a picture was last begun
  #asked = 0; // of the browser: a picture
  #letGo;
  #observer = new ResizeObserver(() => this.#fit());
  #draw = () => this.#ask();

  /**
   * `orbit` can be shared with others. `onTouch` is called once somebody looks at it from elsewhere.
   * Throws an Error if the browser has no WebGL 2.
   */
  constructor(label, orbit, onTouch) {
    this.#canvas = make("canvas", { role: "application", tabindex: "0", "aria-label": `3D view of ${label}. ${ORBIT_HELP}`, title: ORBIT_HELP });
    this.#view = new GlbView(this.#canvas);
    this.#view.orbit = this.#orbit = orbit;
    this.back = make("button", { type: "button", hidden: true, onclick: () => orbit.reset() }, "Back to the front");
    this.element = make("div", { class: "view-3d" }, this.#canvas, this.back);
    orbit.addEventListener("change", this.#draw);
    this.#letGo = orbit.hold(this.#canvas);
    for (const name of ["pointerdown", "keydown"]) this.#canvas.addEventListener(name, onTouch, { once: true });
  }

  /** Rejects with an Error that holds a sentence. */
  async load(url) {
    await this.#view.load(url);
    this.#observer.observe(this.#canvas);
  }

  /** Show a moment; while it plays, not every one. */
  seek(seconds, isPlaying) {
    this.#seconds = seconds;
    const pause = this.#view.isSlow ? SLOW_PAUSE_MS : PAUSE_MS;
    if (isPlaying && performance.now() - this.#drawn < pause) return;
    this.#ask();
  }

  dispose() {
    cancelAnimationFrame(this.#asked);
    this.#observer.disconnect();
    this.#orbit.removeEventListener("change", this.#draw);
    this.#letGo();
    this.#view.dispose();
    this.element.remove();
  }

  /** As many pixels as the screen shows of it. */
  #fit() {
    const { clientWidth, clientHeight } = this.#canvas;
    if (!clientWidth || !clientHeight) return;
    const height = Math.min(clientHeight * devicePixelRatio, this.#view.isSlow ? MOST_SLOW_PX : MOST_PX);
    this.#canvas.height = Math.round(height);
    this.#canvas.width = Math.round((height * clientWidth) / clientHeight);
    this.#view.seek(this.#seconds); // at once: a canvas of a new size is black
  }

  /** A picture as soon as the one before is drawn. */
  #ask() {
    this.back.hidden = !this.#orbit.isMoved;
    cancelAnimationFrame(this.#asked);
    this.#asked = requestAnimationFrame(() => {
      if (!this.#canvas.clientWidth) return undefined; // not to be seen
      if (this.#view.isDrawing) return this.#ask();
      this.#drawn = performance.now();
      return this.#view.seek(this.#seconds);
    });
  }
}
