/** How bodies are displayed: everything that a switch of the stage can change, and its address. */

/**
 * One display. `slider`, `choice` or `toggle`, if it has one of them, is its control behind the button of rarer ones.
 *
 * @typedef {object} Display
 * @property {string} short Its name in an address, which leaves it out at its usual value.
 * @property {number | string | boolean} usual
 * @property {[number, number]} [range] From the least to the most.
 * @property {{ label: string, unit: string, step: number }} [slider]
 * @property {{ word: string, label: string, options: (facts: import("../messages").ViewerConstants) => [string, string][] }} [choice]
 *   The word stands before it; options are values and what is read of them.
 * @property {string} [toggle] Its label.
 */

/**
 * All displays by name; their controls stand in this order.
 *
 * @type {Record<string, Display>}
 */
export const DISPLAYS = {
  factor: { short: "x", usual: 1, range: [1, 20] },
  hasTrail: { short: "trail", usual: true },
  hasHeat: { short: "jerk", usual: false },
  cutoff: { short: "cut", usual: 5, range: [3, 8], slider: { label: "Jitter cutoff frequency", unit: "Hz", step: 0.5 } },
  heatScale: { short: "scale", usual: 500, range: [50, 2000], slider: { label: "Maximum of the jerk colour scale", unit: "m/s³", step: 10 } },
  trailFrames: { short: "long", usual: 30, range: [5, 90], slider: { label: "Trail", unit: "frames", step: 1 } },
  point: { short: "point", usual: "right_middle", choice: { word: "of", label: "Body point of the trail", options: ({ points }) => Object.entries(points) } },
  isWhole: { short: "whole", usual: false, toggle: "Whole body" },
  isAligned: { short: "align", usual: true, toggle: "Align at the pelvis" },
  hasWords: { short: "words", usual: true, toggle: "Words" },
  hasBones: { short: "bones", usual: false, toggle: "Skeleton" },
  hasAxes: { short: "axes", usual: false, toggle: "Joint axes" },
  build: { short: "build", usual: "average", choice: { word: "Shape", label: "Body shape", options: ({ builds }) => builds.names.map(capitalised) } },
  tone: { short: "tone", usual: "light", choice: { word: "Tone", label: "Skin tone of the bodies", options: ({ tones }) => Object.keys(tones).map(capitalised) } },
};

/** @type {(name: string) => [string, string]} */
function capitalised(name) {
  return [name, name[0].toUpperCase() + name.slice(1)];
}

/** How a value is read from an address, by the type of the usual one. */
const READ = { number: Number, string: String, boolean: (text) => text === "1" };

/** @returns {Record<string, any>} */
function usualValues() {
  return Object.fromEntries(Object.entries(DISPLAYS).map(([name, { usual }]) => [name, usual]));
}

/** Emits "change". */
export class Look extends EventTarget {
  #values = usualValues();

  get(name) {
    return this.#values[name];
  }

  set(name, value) {
    const [least, most] = DISPLAYS[name].range ?? [];
    const inside = least === undefined ? value : Math.max(least, Math.min(most, value));
    if (this.#values[name] === inside || Number.isNaN(inside)) return;
    this.#values[name] = inside;
    this.dispatchEvent(new Event("change"));
  }

  /** All of it, by name. */
  get values() {
    return { ...this.#values };
  }

  reset() {
    this.#values = usualValues();
    this.dispatchEvent(new Event("change"));
  }

  /** Adds to an address what is not as usual. */
  write(address) {
    for (const [name, { short, usual }] of Object.entries(DISPLAYS)) {
      const value = this.#values[name];
      if (value !== usual) address.set(short, typeof value === "boolean" ? Number(value) : value);
    }
  }

  /** Takes what an address says. */
  read(address) {
    for (const [name, { short, usual }] of Object.entries(DISPLAYS)) {
      if (address.has(short)) this.set(name, READ[typeof usual](address.get(short)));
    }
  }
}
