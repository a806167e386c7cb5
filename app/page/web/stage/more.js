/** The rarer displays and views of the stage, behind one button. */

import { make } from "../dom.js";
import { currentFilter, followFilter, setFilter } from "../filter_switch.js";
import { theFacts } from "./facts.js";
import { DISPLAYS } from "./look.js";

const SIDES = { Front: [0, 0], "Three quarters": [0.7, 0], Side: [Math.PI / 2, 0], Above: [0, 0.7] }; // yaw and pitch

export class More {
  #look;
  #inputs = new Map();
  #choices = new Map();

  /** `orbit` is the stage's; `views` are buttons of the player's own, from label to what each does;
   * `without` names displays of the look that would do nothing. */
  constructor(look, orbit, views, without = []) {
    this.#look = look;
    const declared = Object.entries(DISPLAYS).filter(([name, told]) => (told.slider || told.choice || told.toggle) && !without.includes(name));
    const controls = declared.map(([name, told]) => this.#control(name, told));
    // As the switches, behind which it stands, but of the whole page.
    controls.splice(1 + declared.findLastIndex(([, { toggle }]) => toggle), 0, this.#smoothed());
    const sides = Object.entries(SIDES).map(([label, [yaw, pitch]]) => make("button", { type: "button", onclick: () => orbit.place([yaw, pitch]) }, label));
    const others = Object.entries(views).map(([label, onclick]) => make("button", { type: "button", onclick }, label));
    this.element = make("div", { class: "more-box", hidden: true, role: "group", "aria-label": "More displays and views" },
      ...controls, make("span", { class: "switch", role: "group", "aria-label": "Camera" }, ...sides), ...others);
    look.addEventListener("change", () => this.update());
    this.#knowOptions().catch(() => {}); // the stage says why
    this.update();
  }

  async #knowOptions() {
    const facts = await theFacts();
    for (const [name, select] of this.#choices) {
      select.replaceChildren(...DISPLAYS[name].choice.options(facts).map(([value, label]) => make("option", { value }, label)));
    }
    this.update();
  }

  /** @type {(name: string, told: import("./look.js").Display) => HTMLElement} */
  #control(name, { range, slider, choice, toggle }) {
    if (slider) return this.#slider(name, range, slider);
    return choice ? this.#choice(name, choice) : this.#toggle(name, toggle);
  }

  #slider(name, [min, max], { label, unit, step }) {
    const input = make("input", { type: "range", min, max, step, "aria-label": label, oninput: () => this.#look.set(name, Number(input.value)) });
    const value = make("output", {});
    this.#inputs.set(name, () => {
      input.value = String(this.#look.get(name));
      value.textContent = `${this.#look.get(name)} ${unit}`;
    });
    return make("label", {}, make("span", {}, label), input, value);
  }

  #choice(name, { word, label }) {
    const select = make("select", { "aria-label": label, onchange: () => this.#look.set(name, select.value) });
    this.#choices.set(name, select);
    this.#inputs.set(name, () => (select.value = this.#look.get(name)));
    return make("label", {}, make("span", {}, word), select);
  }

  #toggle(name, label) {
    const input = make("input", { type: "checkbox", onchange: () => this.#look.set(name, input.checked) });
    this.#inputs.set(name, () => (input.checked = this.#look.get(name)));
    return make("label", {}, input, make("span", {}, label));
  }

  /** Of all plots and bodies of the page. */
  #smoothed() {
    const input = make("input", { type: "checkbox", onchange: () => setFilter(input.checked ? "savgol" : "raw") });
    followFilter((name) => (input.checked = name === "savgol"));
    this.#inputs.set("smoothed", () => (input.checked = currentFilter() === "savgol"));
    return make("label", { title: "Behind the filter that papers smooth their motion with (Savitzky and Golay, 7 frames)" }, input, make("span", {}, "Smoothed"));
  }

  update() {
    for (const show of this.#inputs.values()) show();
  }
}
