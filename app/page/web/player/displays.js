/** What switches displays of bodies: in the bar of a run, and under the body that follows somebody who speaks. */

import { iconButton, make } from "../dom.js";

const CLOSE_UPS = { hands: "Hands", face: "Face", both: "Both", off: "None" };
const STRONG = 20; // what the key makes of tremble

export class DisplayBar {
  #look;
  #viewOf;
  #factor;
  #factorText;
  #toggles;
  #folded;

  /**
   * @param {import("../stage/look.js").Look} look
   * @param {() => any} viewOf Gives the Stage that is steered.
   * @param {HTMLElement} folded What stands behind the button of rarer ones.
   */
  constructor(look, viewOf, folded) {
    this.#look = look;
    this.#viewOf = viewOf;
    this.#folded = folded;
    this.closeUp = make("select", { "aria-label": "Close-up", onchange: () => viewOf().setCloseUp(this.closeUp.value) });
    this.closeUp.append(...Object.entries(CLOSE_UPS).map(([value, label]) => make("option", { value }, label)));
    this.#factor = make("input", { type: "range", min: "0", max: "1", step: "any", "aria-label": "Tremble, times as large", oninput: () => look.set("factor", factorAt(Number(this.#factor.value))) });
    this.#factorText = make("button", { type: "button", class: "worded factor", title: `Tremble ${STRONG} times as large`, onclick: () => this.press("e") });
    const toggle = (label, name, title) =>
      make("button", { type: "button", class: "worded", "data-look": name, title, onclick: () => this.#flip(name) }, label);
    this.#toggles = [toggle("Trail", "hasTrail", "The way of the followed point, coloured by its speed"), toggle("Jerk", "hasHeat", "Bodies in the colours of how they jerk")];
    this.element = make("div", { class: "group displays" }, make("label", { class: "slider", title: "All that is faster than the cut-off, made larger" }, this.#factor), this.#factorText, ...this.#toggles);
    this.more = iconButton("more", "More displays and views", () => this.#fold(), { class: "more", "aria-expanded": "false" });
    look.addEventListener("change", () => this.update());
    folded.addEventListener("keydown", ({ key }) => this.#leave(key));
  }

  #leave(key) {
    const isLeft = key === "Escape" && !this.#folded.hidden;
    if (isLeft) this.#fold();
    return isLeft;
  }

  #fold() {
    this.#folded.hidden = !this.#folded.hidden;
    this.update();
    if (this.#folded.hidden) this.more.focus();
    else this.#folded.scrollIntoView({ block: "nearest" });
  }

  #flip(name) {
    this.#look.set(name, !this.#look.get(name));
  }

  update() {
    this.more.setAttribute("aria-expanded", String(!this.#folded.hidden));
    this.closeUp.value = this.#viewOf()?.closeUp;
    const factor = this.#look.get("factor");
    if (Math.abs(factorAt(Number(this.#factor.value)) - factor) > 1e-6) this.#factor.value = String(Math.log(factor) / Math.log(STRONG));
    this.#factorText.textContent = `×${factor < 9.95 ? Math.round(10 * factor) / 10 : Math.round(factor)}`;
    this.#factorText.setAttribute("aria-pressed", String(factor !== 1));
    for (const button of this.#toggles) button.setAttribute("aria-pressed", String(this.#look.get(button.dataset.look)));
  }

  /** What a key does; true if it does anything. */
  press(key) {
    const actions = {
      c: () => this.#viewOf().nextCloseUp(),
      e: () => this.#look.set("factor", this.#look.get("factor") === 1 ? STRONG : 1),
      j: () => this.#flip("hasHeat"),
      t: () => this.#flip("hasTrail"),
    };
    if (!actions[key]) return this.#leave(key);
    actions[key]();
    return true;
  }
}

/** The slider is even in how much more there is. */
function factorAt(share) {
  const factor = STRONG ** share;
  return Math.abs(factor - 1) < 0.02 ? 1 : factor;
}
