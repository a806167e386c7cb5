/** Parts of the results of a tab, one at a time: what is watched, numbers, figures and files. */

import { make } from "../dom.js";

const PARTS = { watch: "Watch", numbers: "Numbers", figures: "Figures", files: "Files" };

export class Parts {
  #place;

  /** `root` is the player, among the other results of its tab. */
  constructor(root) {
    this.#place = root.closest(".block")?.parentElement ?? null;
    const button = ([name, label]) => make("button", { type: "button", "data-part": name, onclick: () => this.choose(name) }, label);
    this.element = make("div", { class: "switch parts-bar", role: "group", "aria-label": "Parts of the results", hidden: true }, ...Object.entries(PARTS).map(button));
    root.addEventListener("watch", () => this.choose("watch"));
  }

  /** Parts are only of a run. */
  show(isRun) {
    if (!this.#place || this.element.hidden === !isRun) return;
    this.element.hidden = !isRun;
    this.#place.classList.toggle("in-parts", isRun);
    this.choose("watch");
  }

  choose(name) {
    this.#place.dataset.part = name;
    for (const button of this.element.querySelectorAll("button")) button.setAttribute("aria-pressed", String(button.dataset.part === name));
  }
}
