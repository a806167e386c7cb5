/** How bodies are displayed: everything that a switch of the stage can change, and its address. */

/** What stands in an address: short name, and how a value is read; all are left out at their usual. */
/** @type {Record<string, [string, (text: string) => number | string | boolean]>} */
const FIELDS = {
  factor: ["x", Number],
  cutoff: ["cut", Number],
  hasTrail: ["trail", (text) => text === "1"],
  trailFrames: ["long", Number],
  point: ["point", String],
  hasHeat: ["jerk", (text) => text === "1"],
  heatScale: ["scale", Number],
  isAligned: ["align", (text) => text === "1"],
  isWhole: ["whole", (text) => text === "1"],
  hasWords: ["words", (text) => text === "1"],
  hasBones: ["bones", (text) => text === "1"],
  hasAxes: ["axes", (text) => text === "1"],
  tone: ["tone", String],
  build: ["build", String],
};
/** From the least to the most of what can be set by a slider. */
export const RANGES = { factor: [1, 20], cutoff: [3, 8], trailFrames: [5, 90], heatScale: [50, 2000] };
const USUAL = {
  factor: 1, cutoff: 5, hasTrail: true, trailFrames: 30, point: "right_middle",
  hasHeat: false, heatScale: 500, isAligned: true, isWhole: false, hasWords: true,
  hasBones: false, hasAxes: false, tone: "light", build: "average",
};

/** Emits "change". */
export class Look extends EventTarget {
  #values = { ...USUAL };

  get(name) {
    return this.#values[name];
  }

  set(name, value) {
    const [least, most] = RANGES[name] ?? [];
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
    this.#values = { ...USUAL };
    this.dispatchEvent(new Event("change"));
  }

  /** Adds to an address what is not as usual. */
  write(address) {
    for (const [name, [short]] of Object.entries(FIELDS)) {
      const value = this.#values[name];
      if (value !== USUAL[name]) address.set(short, typeof value === "boolean" ? Number(value) : value);
    }
  }

  /** Takes what an address says. */
  read(address) {
    for (const [name, [short, from]] of Object.entries(FIELDS)) {
      if (address.has(short)) this.set(name, from(address.get(short)));
    }
  }
}
