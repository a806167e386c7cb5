/** What switches displays of bodies: the usual ones in a bar, the rarer behind its last button. */

import { iconButton, make } from "../dom.js";
import { theFacts } from "../fetched.js";
import { currentFilter, followFilter, setFilter } from "../filter_switch.js";
import { bodyChoice } from "../stage/character.js";
import { DISPLAYS } from "../stage/look.js";

const CLOSE_UPS = { hands: "Hands", face: "Face", both: "Both", off: "None" };
const SIDES = { Front: [0, 0], "Three quarters": [0.7, 0], Side: [Math.PI / 2, 0], Above: [0, 0.7] }; // yaw and pitch
const STRONG = 20; // what the key makes of tremble
const SMOOTHED = "Savitzky-Golay filter, 7 frames, as in the official GlobalDiff code. Also applies to plots and metrics.";

export class Displays {
  #look;
  #stage;
  #shows = []; // each has a control say what is the case

  /**
   * @param {import("../stage/look.js").Look} look
   * @param {any} stage Null where the browser draws none: then nobody sees this.
   * @param {Record<string, () => void>} views Buttons of the player's own, and what each does.
   * @param {string[]} without Displays that would do nothing.
   */
  constructor(look, stage, views, without = []) {
    this.#look = look;
    this.#stage = stage;
    this.closeUp = this.#select("Close-up", () => stage?.closeUp, (value) => stage.setCloseUp(value));
    this.closeUp.append(...optionsOf(Object.entries(CLOSE_UPS)));
    const tremble = this.#input({ type: "range", min: 0, max: 1, step: "any", "aria-label": "Jitter exaggeration factor" }, "value", () => shareOf(look.get("factor")), (share) => look.set("factor", factorAt(Number(share))));
    const factor = this.#button("", "factor", `Show jitter ${STRONG} times as large`, () => this.press("e"));
    this.#shows.push(() => {
      const times = look.get("factor");
      factor.textContent = `×${times < 9.95 ? Math.round(10 * times) / 10 : Math.round(times)}`;
      factor.setAttribute("aria-pressed", String(times !== 1));
    });
    this.element = make("div", { class: "group displays" }, make("label", { class: "slider", title: "Amplifies motion above the cutoff frequency" }, tremble), factor,
      this.#toggle("Trail", "hasTrail", "Trajectory of the tracked point, coloured by speed"), this.#toggle("Jerk", "hasHeat", "Colour the bodies by jerk"));
    const rarer = Object.entries(DISPLAYS).filter(([name, display]) => (display.slider || display.choice || display.toggle) && !without.includes(name));
    const controls = rarer.map(([name, display]) => this.#control(name, display));
    const smoothed = this.#checkbox("Filtered", () => currentFilter() === "savgol", (is) => setFilter(is ? "savgol" : "raw")); // of the whole page
    smoothed.title = SMOOTHED;
    controls.splice(1 + rarer.findLastIndex(([, { toggle }]) => toggle), 0, smoothed);
    if (stage && location.protocol.startsWith("http")) controls.push(bodyChoice(stage));
    const button = ([label, onclick]) => make("button", { type: "button", onclick }, label);
    const sides = Object.entries(SIDES).map(([label, side]) => button([label, () => stage.orbit.place(side)]));
    this.box = make("div", { class: "more-box", hidden: true, role: "group", "aria-label": "More displays and views", onkeydown: ({ key }) => this.#leave(key) },
      ...controls, make("span", { class: "switch", role: "group", "aria-label": "Camera" }, ...sides), ...Object.entries(views).map(button));
    this.more = iconButton("more", "More displays and views", () => this.fold(), { class: "more" });
    look.addEventListener("change", () => this.update());
    followFilter(() => this.update());
  }

  #button(label, name, title, onclick) {
    return make("button", { type: "button", class: `worded ${name}`, title, onclick }, label);
  }

  #toggle(label, name, title) {
    const button = this.#button(label, "", title, () => this.#flip(name));
    button.dataset.look = name;
    this.#shows.push(() => button.setAttribute("aria-pressed", String(this.#look.get(name))));
    return button;
  }

  #select(label, get, set) {
    const select = make("select", { "aria-label": label, onchange: () => set(select.value) });
    this.#shows.push(() => (select.value = get()));
    return select;
  }

  /** `property` holds its value. */
  #input(attributes, property, get, set) {
    const input = make("input", { ...attributes, oninput: () => set(input[property]) });
    this.#shows.push(() => input[property] === String(get()) || (input[property] = get()));
    return input;
  }

  #checkbox(label, get, set) {
    return make("label", {}, this.#input({ type: "checkbox" }, "checked", get, set), make("span", {}, label));
  }

  /** @type {(name: string, display: import("../stage/look.js").Display) => any} */
  #control(name, { range, slider, choice, toggle }) {
    const get = () => this.#look.get(name);
    const set = (value) => this.#look.set(name, value);
    if (toggle) return this.#checkbox(toggle, get, set);
    if (choice) {
      const select = this.#select(choice.label, get, set);
      const know = (facts) => {
        select.append(...optionsOf(choice.options(facts)));
        this.update();
      };
      theFacts().then(know, () => {}); // the stage says why
      return make("label", { "data-display": name }, make("span", {}, choice.word), select);
    }
    const [{ label, unit, step }, [min, max], value] = [slider, range, make("output", {})];
    this.#shows.push(() => (value.textContent = `${get()} ${unit}`));
    return make("label", {}, make("span", {}, label), this.#input({ type: "range", min, max, step, "aria-label": label }, "value", get, (text) => set(Number(text))), value);
  }

  /** Open the box, or close it. */
  fold() {
    this.box.hidden = !this.box.hidden;
    this.update();
    if (this.box.hidden) this.more.focus();
    else this.box.scrollIntoView({ block: "nearest" });
  }

  #leave(key) {
    const isLeft = key === "Escape" && !this.box.hidden;
    if (isLeft) this.fold();
    return isLeft;
  }

  #flip(name) {
    this.#look.set(name, !this.#look.get(name));
  }

  update() {
    this.more.setAttribute("aria-expanded", String(!this.box.hidden));
    for (const show of this.#shows) show();
  }

  /** What a key does; true if it does anything. */
  press(key) {
    const actions = {
      c: () => this.#stage.nextCloseUp(),
      e: () => this.#look.set("factor", this.#look.get("factor") === 1 ? STRONG : 1),
      j: () => this.#flip("hasHeat"),
      t: () => this.#flip("hasTrail"),
    };
    if (!actions[key]) return this.#leave(key);
    actions[key]();
    return true;
  }
}

function optionsOf(entries) {
  return entries.map(([value, label]) => make("option", { value }, label));
}

/** The slider is even in how much more there is. */
function factorAt(share) {
  const factor = STRONG ** share;
  return Math.abs(factor - 1) < 0.02 ? 1 : factor;
}

function shareOf(factor) {
  return Math.log(factor) / Math.log(STRONG);
}
