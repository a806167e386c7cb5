/** Leads to the seconds in which the tracked point jerks most or a joint snaps, and plays each slowly again and again. */

import { allow, iconButton, make } from "../dom.js";

const SLOWLY = 0.25;

export class WorstSeconds {
  #player;
  #seconds = [];
  #at = null; // which of them is on, or null

  constructor(player) {
    this.#player = player;
    this.start = make("button", { type: "button", class: "worded", onclick: () => this.toggle() }, "Highest-jerk second");
    this.steps = [iconButton("left", "Previous (more jerk)", () => this.step(-1)), iconButton("right", "Next (less jerk)", () => this.step(1))];
    this.output = make("output", {});
    this.line = make("div", { class: "worst-line", hidden: true }, this.steps[0], this.output, this.steps[1]); // stands where it moves nothing
    this.element = make("div", { class: "group worst", hidden: true }, this.start);
    player.addEventListener("state", () => this.#show());
  }

  /** `seconds` are ordered, the worst first; of an empty list nothing is shown. */
  set(seconds) {
    this.#seconds = seconds;
    this.#at = null;
    this.#show();
  }

  /** Begin with the worst, or go back to playing everything. */
  toggle() {
    if (!this.#seconds.length) return;
    if (this.#isOn) return this.#stop();
    this.#go(0);
  }

  step(by) {
    if (!this.#seconds.length) return;
    this.#go(this.#isOn ? Math.max(0, Math.min(this.#at + by, this.#seconds.length - 1)) : 0);
  }

  /** Whoever sets another loop has left the second. */
  get #isOn() {
    const { loop } = this.#player;
    const second = this.#seconds[this.#at];
    return Boolean(loop && second && loop[0] === second.start_s && loop[1] === second.end_s);
  }

  #go(number) {
    this.#at = number;
    const { start_s, end_s } = this.#seconds[number];
    this.#player.setLoop([start_s, end_s]);
    this.#player.setRate(SLOWLY);
    this.#player.seek(start_s);
    this.#player.play();
  }

  #stop() {
    this.#at = null;
    this.#player.setLoop(null);
    this.#player.setRate(1);
  }

  #show() {
    const isOn = this.#isOn;
    if (this.#at !== null && !this.#player.loop) return this.#stop(); // somebody went elsewhere
    this.element.hidden = !this.#seconds.length;
    this.start.setAttribute("aria-pressed", String(isOn));
    allow(this.steps[0], this.#at !== 0);
    allow(this.steps[1], this.#at !== this.#seconds.length - 1);
    const { name, jerk_m_s3, joint, snap_deg, start_s } = this.#seconds[this.#at] ?? {};
    const why = joint ? `${joint} snaps by ${Math.round(snap_deg)}°` : `${Math.round(jerk_m_s3)} m/s³`;
    this.line.hidden = !isOn;
    const text = isOn ? `${this.#at + 1} of ${this.#seconds.length}: ${name}, ${why} at ${start_s.toFixed(1)} s` : "";
    if (this.output.textContent !== text) this.output.textContent = text;
  }
}
