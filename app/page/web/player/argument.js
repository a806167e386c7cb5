/** The paper's argument on two bodies: the error that equal noise makes of local and of global rotations. */

import { make } from "../dom.js";

const DEGREES = 180 / Math.PI;

export class Argument {
  #stage;
  #isScheduled = false;

  constructor(stage) {
    this.#stage = stage;
    this.headline = make("h2", {});
    this.sentence = make("p", { role: "status" });
    this.head = make("div", { class: "argument-head", hidden: true }, this.headline, this.sentence);
    this.input = make("input", { type: "range", step: 0.001, oninput: () => this.set(Number(this.input.value)) });
    this.output = make("output", {});
    this.slider = make("label", { class: "noise", hidden: true }, make("span", {}, "Noise on every joint"), this.input, this.output);
    stage?.element.addEventListener("bodies", () => this.#tell());
  }

  /** `noise` says how much there is at first (rad), its limits, and whether it has a slider here; null hides all. @param {import("../messages").PlayerValue["noise"] | null} noise */
  show(noise) {
    this.head.hidden = !noise;
    this.slider.hidden = !noise?.has_slider;
    if (!noise) return;
    [this.input.min, this.input.max] = noise.range.map(String);
    this.set(noise.initial_rad);
  }

  /** Pose both bodies with noise of so many radians about each axis, once a picture. */
  set(rad) {
    if (!this.#stage || !(rad > 0)) return;
    this.input.value = String(rad);
    this.output.textContent = `${(DEGREES * rad).toFixed(1)}°`;
    if (this.#isScheduled) return;
    this.#isScheduled = true;
    requestAnimationFrame(() => {
      this.#isScheduled = false;
      this.#stage.setNoise(Number(this.input.value));
    });
  }

  /** The numbers follow from the motion that is shown. */
  #tell() {
    const { local, global: world } = this.#stage.noiseErrors;
    if (this.head.hidden || !local || !world) return;
    const cm = (metres) => `${(100 * metres).toFixed(1)} cm`;
    this.headline.textContent = `The same joint noise moves the fingertip ${(local / world).toFixed(1)} times as far with local as with global rotations`;
    this.sentence.textContent = `Both bodies perform the same motion with the same random errors: ${this.output.textContent} about each axis of every joint. With local rotations (relative to the parent joint), the errors accumulate along the arm, and the fingertip is off by ${cm(local)} (root mean square). With global rotations (in world coordinates), they do not, and it is off by ${cm(world)}.`;
    this.head.dataset.ratio = (local / world).toFixed(3);
  }
}
