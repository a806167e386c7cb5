/**
 * What a system that plans is going to do while somebody speaks: two hands, as strips that pass the
 * present, and the sliders of the whole, which act with the next window.
 */

import { make } from "../dom.js";
import { kindName } from "../player/plan.js";

const COLORS = { rest: "#d5dbe1", preparation: "#9cc3d5", stroke: "#0f6d8c", hold: "#7ba37b", beat: "#c98b2b", retraction: "#b9a6c9" };
const BEFORE_S = 2;
const AFTER_S = 2;
/** @type {Record<string, [string, number, number, number, number]>} */
const SLIDERS = {
  rate_factor: ["Gesture rate", -2, 2, 0.25, 2], // powers of the last number; the middle is as the speech asks
  size_factor: ["Gesture size", -1, 1, 0.125, 2],
  height_offset_m: ["Gesture height", -0.2, 0.2, 0.02, 0],
  speed_factor: ["Gesture speed", -1, 1, 0.125, 1.6],
  joining_factor: ["Two-handed gestures", -2, 2, 0.25, 2.5],
  smile_factor: ["Smile", -2, 2, 0.25, 2],
};
const EXCITED = { rate_factor: 0.7, size_factor: 0.4, height_offset_m: 0.06, speed_factor: 0.5, joining_factor: 0.4 }; // steps of the sliders above

export class Planned {
  #hands = { left: [], right: [] };
  #sliders = new Map();
  #send;

  /** `send` takes what is told to the server. */
  constructor(send) {
    this.#send = send;
    const sliders = Object.entries(SLIDERS).map(([name, [label, min, max, step]]) => this.#slider(name, label, min, max, step));
    const excite = this.#slider("excite", "Arousal (calm to excited)", -1, 1, 0.25);
    const back = make("button", { type: "button", onclick: () => this.#back() }, "Reset (style from the speech)");
    this.canvas = make("canvas", { width: 560, height: 64, role: "img", "aria-label": "Planned phases of both hands" });
    this.now = make("p", { class: "hint" }, "Hands rest.");
    this.element = make("div", { class: "planned", hidden: true }, this.canvas, this.now,
      make("details", { open: true }, make("summary", {}, "Style (takes effect in the next generated window)"), make("div", { class: "sliders" }, ...sliders, excite, back)));
  }

  #slider(name, label, min, max, step) {
    const input = make("input", { type: "range", min, max, step, value: 0, "aria-label": label, oninput: () => this.#tell() });
    this.#sliders.set(name, input);
    return make("label", {}, make("span", {}, label), input);
  }

  #back() {
    for (const input of this.#sliders.values()) input.value = "0";
    this.#tell();
  }

  /** What the sliders say, as app/live/session.py reads it. */
  get manner() {
    const excite = Number(this.#sliders.get("excite").value);
    return Object.fromEntries(Object.entries(SLIDERS).map(([name, [, min, max, , base]]) => {
      const at = Number(this.#sliders.get(name).value) + excite * (EXCITED[name] ?? 0);
      const value = Math.max(min, Math.min(max, at));
      return [name, base ? base ** value : value];
    }));
  }

  #tell() {
    this.#send(JSON.stringify({ manner: this.manner }));
  }

  /** A session begins: with a system that plans or without. */
  begin(plans) {
    this.element.hidden = !plans;
    this.#hands = { left: [], right: [] };
    if (plans) this.#tell();
  }

  /** Take what the server tells: it takes the place of all from its first moment on. */
  take({ from, left, right }) {
    for (const [side, phases] of Object.entries({ left, right })) {
      const earlier = this.#hands[side].filter(([start]) => start < phases[0][0] && start > from - BEFORE_S - 4);
      this.#hands[side] = [...earlier, ...phases];
    }
  }

  /** Draw what is around a moment of the session, in seconds. */
  draw(seconds) {
    if (this.element.hidden || !Number.isFinite(seconds)) return;
    const { canvas } = this;
    const context = canvas.getContext("2d");
    const x = (at) => ((at - seconds + BEFORE_S) / (BEFORE_S + AFTER_S)) * canvas.width;
    context.clearRect(0, 0, canvas.width, canvas.height);
    const labels = [];
    for (const [row, side] of /** @type {const} */ (["left", "right"]).entries()) {
      for (const [start, end, phase, kind] of this.#hands[side]) {
        const [from, to] = [x(start), x(end)];
        if (to < 0 || from > canvas.width) continue;
        context.globalAlpha = start > seconds ? 0.55 : 1; // it may still change
        context.fillStyle = COLORS[phase];
        context.fillRect(from, 4 + 30 * row, Math.max(1, to - from - 1), 26);
        if (start <= seconds && end > seconds) labels.push(`${side} hand: ${phase}${kind && phase !== "rest" ? ` (${kindName(kind)})` : ""}`);
      }
    }
    context.globalAlpha = 1;
    context.fillStyle = getComputedStyle(canvas).color;
    context.fillRect(x(seconds) - 1, 0, 2, canvas.height);
    const words = labels.join(" · ") || "Hands rest.";
    if (this.now.textContent !== words) this.now.textContent = words;
  }
}
