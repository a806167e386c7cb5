/**
 * The end of the phase that is chosen: a handle in its tier that is dragged, or
 * moved by keys until Enter, or until the focus leaves. It shows what will be, and tells where it was let go.
 */

import { drag, make } from "../dom.js";
import { FPS } from "../stage/motion.js";
import { hasEnd, stretched } from "./plan.js";

const STEPS_S = { ArrowLeft: -0.1, ArrowRight: 0.1, ",": -1 / FPS, ".": 1 / FPS };
const LEAST_MOVE_S = 0.005; // less asks for nothing

export class PhaseEnd {
  #tiers;
  #secondsAt;
  #isBusy;
  #onMoved;
  #onShown;
  /** @type {import("./plan.js").Chosen | null} */
  #chosen = null;
  #by = 0; // seconds by which it stands elsewhere than in the plan
  #requested = 0; // of these, what has been asked for

  /** `isBusy` says that nothing can be asked for now; `onMoved` takes what is chosen, its end and where that is to be; `onShown` is called when it stands elsewhere. */
  constructor(tiers, { secondsAt, isBusy, onMoved, onShown }) {
    this.#tiers = tiers;
    this.#secondsAt = secondsAt;
    this.#isBusy = isBusy;
    this.#onMoved = onMoved;
    this.#onShown = onShown;
    this.element = make("i", {
      class: "phase-end", role: "slider", tabindex: "0", "aria-valuemin": "0",
      onpointerdown: (event) => event.button === 0 && this.drag(event),
      onclick: (event) => event.stopPropagation(),
      onkeydown: (event) => this.#key(event),
      onblur: () => this.#tell(),
    });
  }

  /** The phase whose end it is, if it has one that can be moved; null hides it. `goesOn` says that it is the phase that it was, of another plan. */
  show(chosen, goesOn = false) {
    if (!goesOn || !chosen) this.#forget();
    const { plan } = this.#tiers;
    this.#chosen = chosen && plan && hasEnd(plan, chosen) ? chosen : null;
    if (!this.#chosen) return this.#tiers.hang(this.element, null);
    const { phase } = this.#phase;
    this.element.setAttribute("aria-label", `End of the ${phase}`);
    this.element.setAttribute("aria-valuemax", plan.duration_s.toFixed(2));
    this.#tiers.hang(this.element, chosen.list, () => this.#place());
    return undefined;
  }

  /** What it is the end of, and where it stands; null of nothing. */
  get selection() {
    return this.#chosen && { list: this.#chosen.list, phase: this.#phase.phase, seconds: this.#now };
  }

  /** What was asked for has been done, or refused: go on with what has not been. */
  requestDone() {
    this.#by -= this.#requested;
    this.#requested = 0;
    if (!this.#chosen) return;
    this.#place();
    this.#tell();
  }

  /** A pointer that is down on it, or on the phase's edge, moves it until it is let go. */
  drag(event) {
    event.preventDefault();
    event.stopPropagation();
    const { element } = this;
    const { list, index } = this.#chosen;
    const before = this.#by;
    const from = this.#secondsAt(event.clientX);
    element.focus({ preventScroll: true });
    const isSame = () => this.#chosen?.list === list && this.#chosen.index === index;
    const move = ({ clientX }) => isSame() && this.#move(before + this.#secondsAt(clientX) - from);
    drag(element, event.pointerId, move, (up) => (up ? this.#tell() : isSame() && this.#move(before)));
  }

  get #phase() {
    return this.#tiers.plan[this.#chosen.list][this.#chosen.index];
  }

  get #stretched() {
    const { plan } = this.#tiers;
    const { list, index } = this.#chosen;
    return stretched(plan[list], index, plan[list][index].end_s + this.#by, plan.duration_s);
  }

  get #now() {
    return this.#by ? this.#stretched[this.#chosen.index].end_s : this.#phase.end_s;
  }

  #key(event) {
    const step = STEPS_S[event.key];
    const isConfirmed = event.key === "Enter" || event.key === " ";
    if (event.ctrlKey || event.metaKey || event.altKey || (!step && !isConfirmed && event.key !== "Escape")) return;
    event.preventDefault();
    event.stopPropagation();
    if (isConfirmed) this.#tell();
    else this.#move(step ? this.#by + step : this.#requested);
  }

  #move(by) {
    this.#by = by;
    if (by) this.#by = this.#now - this.#phase.end_s; // no farther than it can be shown
    this.#place();
    this.#onShown();
  }

  #place() {
    const { list, index } = this.#chosen;
    if (!this.#tiers.plan?.[list][index]) return; // of another plan
    this.#tiers.preview(list, this.#by ? this.#stretched : null);
    const share = this.#tiers.shareOf(this.#now);
    this.element.hidden = share < 0 || share > 1;
    this.element.style.left = `${100 * share}%`;
    this.element.setAttribute("aria-valuenow", this.#now.toFixed(2));
    this.element.setAttribute("aria-valuetext", `${this.#phase.phase} ends at ${this.#now.toFixed(2)} s`);
  }

  #tell() {
    if (!this.#chosen || this.#isBusy() || Math.abs(this.#by) < LEAST_MOVE_S) return;
    this.#requested = this.#by;
    this.#onMoved(this.#chosen, this.#phase.end_s, this.#now);
  }

  #forget() {
    this.#by = this.#requested = 0;
    if (this.#chosen && this.#tiers.plan) this.#tiers.preview(this.#chosen.list, null);
    this.#chosen = null;
  }
}
