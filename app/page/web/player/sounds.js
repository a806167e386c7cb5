/** Whose sound plays, where motions of other speech move beside each other. */

import { make } from "../dom.js";

export class Sounds {
  #onChoose;
  /** @type {import("../told").Sound[]} */
  #sounds = [];
  #index = 0;

  /** `onChoose` is called once another is chosen. */
  constructor(onChoose) {
    this.#onChoose = onChoose;
    this.element = make("div", { class: "switch sounds", role: "group", "aria-label": "Whose sound plays", hidden: true });
  }

  /** Which of them, from 0 on. */
  get index() {
    return this.#index;
  }

  /** What plays, and its time line; null where there is no choice. */
  get chosen() {
    return this.#sounds[this.#index] ?? null;
  }

  /** @param {import("../told").Sound[]} sounds */
  show(sounds) {
    this.#sounds = sounds;
    this.#index = Math.max(0, Math.min(this.#index, sounds.length - 1));
    this.element.hidden = sounds.length < 2;
    this.element.replaceChildren(...sounds.map(({ label }, i) => make("button", { type: "button", title: `Play the sound of ${label}`, onclick: () => this.choose(i) }, label)));
    this.#mark();
  }

  choose(index) {
    if (index === this.#index || !this.#sounds[index]) return;
    this.#index = index;
    this.#mark();
    this.#onChoose();
  }

  clear() {
    this.#index = 0;
    this.show([]);
  }

  #mark() {
    for (const [i, button] of [...this.element.children].entries()) button.setAttribute("aria-pressed", String(i === this.#index));
  }
}
