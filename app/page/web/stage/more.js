/** The rarer displays and views of the stage, behind one button. */

import { make } from "../dom.js";
import { currentFilter, followFilter, setFilter } from "../filter_switch.js";
import { theFacts } from "./facts.js";
import { RANGES } from "./look.js";

const SIDES = { Front: [0, 0], "Three quarters": [0.7, 0], Side: [Math.PI / 2, 0], Above: [0, 0.7] }; // yaw and pitch
const SLIDERS = {
  cutoff: { label: "Tremble is faster than", unit: "Hz", step: 0.5 },
  heatScale: { label: "Jerk colours end at", unit: "m/s³", step: 10 },
  trailFrames: { label: "Trail", unit: "frames", step: 1 },
};
const SWITCHES = { isWhole: "Whole body", isAligned: "Pelvis on pelvis", hasWords: "Words", hasBones: "Skeleton", hasAxes: "Axes of joints" };

export class More {
  #look;
  #inputs = new Map();
  #points;
  #tones;
  #builds;

  /** `orbit` is the stage's; `views` are buttons of the player's own, from label to what each does;
   * `without` names switches of the look that would do nothing. */
  constructor(look, orbit, views, without = []) {
    this.#look = look;
    const sliders = Object.entries(SLIDERS).map(([name, told]) => this.#slider(name, told));
    const switches = Object.entries(SWITCHES).filter(([name]) => !without.includes(name)).map(([name, label]) => this.#switch(name, label));
    switches.push(this.#smoothed());
    this.#points = make("select", { "aria-label": "Point of the trail", onchange: () => look.set("point", this.#points.value) });
    this.#tones = make("select", { "aria-label": "Tone of the bodies", onchange: () => look.set("tone", this.#tones.value) });
    this.#builds = make("select", { "aria-label": "Build of the bodies", onchange: () => look.set("build", this.#builds.value) });
    const sides = Object.entries(SIDES).map(([label, [yaw, pitch]]) => make("button", { type: "button", onclick: () => orbit.place([yaw, pitch]) }, label));
    const others = Object.entries(views).map(([label, onclick]) => make("button", { type: "button", onclick }, label));
    this.element = make("div", { class: "more-box", hidden: true, role: "group", "aria-label": "More displays and views" },
      ...sliders, make("label", {}, make("span", {}, "of"), this.#points), ...switches, make("label", {}, make("span", {}, "Build"), this.#builds), make("label", {}, make("span", {}, "Tone"), this.#tones),
      make("span", { class: "switch", role: "group", "aria-label": "Camera" }, ...sides), ...others);
    look.addEventListener("change", () => this.update());
    this.#knowPoints().catch(() => {}); // the stage says why
    this.update();
  }

  async #knowPoints() {
    const { points, tones, builds } = await theFacts();
    const named = (name) => make("option", { value: name }, name[0].toUpperCase() + name.slice(1));
    this.#tones.replaceChildren(...Object.keys(tones).map(named));
    this.#builds.replaceChildren(...builds.names.map(named));
    this.#points.replaceChildren(...Object.entries(points).map(([value, label]) => make("option", { value }, label)));
    this.update();
  }

  #slider(name, { label, unit, step }) {
    const [min, max] = RANGES[name];
    const input = make("input", { type: "range", min, max, step, "aria-label": label, oninput: () => this.#look.set(name, Number(input.value)) });
    const value = make("output", {});
    this.#inputs.set(name, () => {
      input.value = String(this.#look.get(name));
      value.textContent = `${this.#look.get(name)} ${unit}`;
    });
    return make("label", {}, make("span", {}, label), input, value);
  }

  #switch(name, label) {
    const input = make("input", { type: "checkbox", onchange: () => this.#look.set(name, input.checked) });
    this.#inputs.set(name, () => (input.checked = this.#look.get(name)));
    return make("label", {}, input, make("span", {}, label));
  }

  /** Of all plots and bodies of the page. */
  #smoothed() {
    const input = make("input", { type: "checkbox", onchange: () => setFilter(input.checked ? "savgol" : "raw") });
    this.end = followFilter((name) => (input.checked = name === "savgol"));
    this.#inputs.set("smoothed", () => (input.checked = currentFilter() === "savgol"));
    return make("label", { title: "Behind the filter that papers smooth their motion with (Savitzky and Golay, 7 frames)" }, input, make("span", {}, "Smoothed"));
  }

  update() {
    for (const show of this.#inputs.values()) show();
    this.#points.value = this.#look.get("point");
    this.#tones.value = this.#look.get("tone");
    this.#builds.value = this.#look.get("build");
  }
}
