/** The gestures that can be added, as small stick figures which move under the pointer and with the focus. */

import { make, wantsStillness } from "../dom.js";
import { kindName } from "./plan.js";

const SIZE = 60;
const DENSITY = 2;
const FIRST = "you";
let count = 0;

export class GesturePalette {
  #pictures = null;
  #moving = null; // the one whose figure moves

  constructor(onchange) {
    const still = () => this.#still();
    const move = ({ target }) => this.#move(target.closest("label"));
    this.element = make("div", { class: "kinds", role: "radiogroup", "aria-label": "Gesture to add", onchange, onfocusin: move, onfocusout: still, onpointerover: move, onpointerleave: still });
  }

  get value() {
    return this.element.querySelector("input:checked")?.value ?? FIRST;
  }

  /** Offer these kinds, from now on. */
  async offer(kinds) {
    if (this.element.childElementCount) return;
    const name = `gesture-${(count += 1)}`; // another player's are another group
    const input = (kind) => make("input", { type: "radio", name, value: kind, checked: kind === FIRST });
    this.element.append(...kinds.map((kind) => make("label", {}, input(kind), make("canvas", { width: DENSITY * SIZE, height: DENSITY * SIZE }), kindName(kind))));
    const answer = await fetch(new URL("gestures.json", import.meta.url));
    if (!answer.ok) return;
    const pictures = await answer.json();
    const points = Object.entries(pictures.points).map(([kind, base64]) => [kind, atob(base64)]);
    this.#pictures = { ...pictures, points: Object.fromEntries(points) };
    for (const label of this.element.children) this.#draw(label, this.#pictures.still);
  }

  #move(label) {
    if (!label || !this.#pictures || label === this.#moving || wantsStillness()) return;
    this.#still();
    this.#moving = label;
    const begun = performance.now();
    const step = (now) => {
      if (label !== this.#moving || !label.isConnected) return;
      this.#draw(label, Math.floor((Math.max(0, now - begun) / 1000) * this.#pictures.fps) % this.#pictures.frames);
      requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  #still() {
    if (this.#moving) this.#draw(this.#moving, this.#pictures.still);
    this.#moving = null;
  }

  #draw(label, frame) {
    const { points, chains, frames } = this.#pictures;
    const canvas = label.querySelector("canvas");
    const kind = label.querySelector("input").value;
    const bytes = points[kind] ?? "";
    const from = (frame * bytes.length) / frames;
    const at = (point) => [0, 1].map((axis) => (bytes.charCodeAt(from + 2 * point + axis) / 255) * canvas.width);
    const context = canvas.getContext("2d");
    context.clearRect(0, 0, canvas.width, canvas.height);
    context.strokeStyle = getComputedStyle(canvas).color;
    context.lineWidth = 1.2 * DENSITY;
    context.lineCap = context.lineJoin = "round";
    context.beginPath();
    for (const chain of bytes ? chains : []) for (const [i, point] of chain.entries()) context[i ? "lineTo" : "moveTo"](...at(point));
    context.stroke();
  }
}
