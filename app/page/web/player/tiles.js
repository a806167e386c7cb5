/** The grid of videos: one tile for each motion, and two of them on top of each other. */

import { make } from "../dom.js";
import { Tile } from "./tile.js";

const FLICKER_MS = 500; // one change in half a second: far below what can do harm to anyone

/**
 * All tiles. `mode` is grid, wipe, flicker or ghost; all but the first show two tiles in one place,
 * whose bodies the server has laid onto each other.
 */
export class Tiles {
  #tiles = new Map();
  #player;
  #onPair;
  #handle;
  #legend = make("p", { class: "ghost-legend", role: "note" });
  #large = null;
  #flicker = null;
  #layout = null;
  mode = "grid";
  pair = [null, null];
  closeUp = "hands";

  /** `player` is the Lockstep that the videos join. */
  constructor(player, onPair) {
    this.#player = player;
    this.#onPair = onPair;
    this.element = make("div", { class: "tiles", "data-mode": "grid" });
    this.#handle = make("div", {
      class: "wipe",
      role: "slider",
      tabindex: "0",
      "aria-label": "Where one video ends and the other begins",
      "aria-valuemin": "0",
      "aria-valuemax": "100",
      onpointerdown: (event) => this.#dragWipe(event),
      onkeydown: (event) => this.#keyWipe(event),
    });
  }

  get names() {
    return [...this.#tiles.keys()];
  }

  labelOf(name) {
    return this.#tiles.get(name)?.label ?? name;
  }

  /** Make or complete the tiles of `rows`. */
  show(rows) {
    for (const row of rows) {
      let tile = this.#tiles.get(row.name);
      if (!tile) {
        tile = new Tile(row, this.#tiles.size + 1, this);
        this.#tiles.set(row.name, tile);
        this.element.append(tile.element);
        this.#showCloseUp();
        this.#arrange();
      }
      if (row.motion) tile.offerMotion(row.motion, row);
      if (row.video && !tile.video) {
        this.#player.add(tile.showVideo(row.video, row));
        this.#arrange();
      }
    }
    this.element.append(this.#handle, this.#legend);
    this.element.dataset.count = this.#tiles.size;
  }

  /**
   * Where in a picture the body and each close-up stand: `aspect` of the whole, and for `body`,
   * `face` and `hands` its upper and lower edge as shares of the height.
   */
  setLayout(layout) {
    this.#layout = layout;
    this.#showCloseUp();
  }

  get #layouts() {
    const own = [...this.#tiles.values()].map(({ layout }) => layout).filter(Boolean);
    return [this.#layout ?? {}, ...own];
  }

  /** What may be chosen: what all pictures hold. */
  get closeUps() {
    const [face, hands] = ["face", "hands"].map((name) => this.#layouts.every((layout) => layout[name]));
    return [...(hands ? ["hands"] : []), ...(face ? ["face"] : []), ...(face && hands ? ["both"] : []), "off"];
  }

  setCloseUp(name) {
    this.closeUp = name;
    this.#showCloseUp();
    this.#onPair();
  }

  nextCloseUp() {
    const { closeUps } = this;
    this.setCloseUp(closeUps[(closeUps.indexOf(this.closeUp) + 1) % closeUps.length]);
  }

  /** Pictures hold everything; what is not wanted is cut off by the style sheet. */
  #showCloseUp() {
    if (!this.#layout) return;
    if (!this.closeUps.includes(this.closeUp)) this.closeUp = this.closeUps[0];
    this.#cut(this.element, this.#layout);
    for (const { element, layout } of this.#tiles.values()) if (layout) this.#cut(element, layout);
  }

  #cut(element, { aspect, body, face, hands }) {
    const wanted = { hands: [hands], face: [face], both: [face, hands], off: [] }[this.closeUp];
    const top = Math.min(body[0], ...wanted.map(([upper]) => upper));
    const bottom = Math.max(body[1], ...wanted.map(([, lower]) => lower));
    const shown = bottom - top;
    const set = (name, value) => element.style.setProperty(name, String(value));
    set("--aspect", aspect / shown);
    set("--zoom", 1 / shown);
    set("--top", top / shown);
  }

  clear() {
    this.setMode("grid");
    this.#tiles.clear();
    this.#large = null;
    this.pair = [null, null];
    this.element.replaceChildren();
  }

  /** Make one tile large, or small again. */
  enlarge(name) {
    if (this.mode !== "grid") this.setMode("grid");
    this.#large = this.#large === name ? null : name;
    for (const [each, tile] of this.#tiles) {
      tile.element.classList.toggle("large", each === this.#large);
      tile.enlarge.setAttribute("aria-pressed", String(each === this.#large));
    }
    this.element.classList.toggle("has-large", this.#large !== null);
    if (this.#large) this.#tiles.get(name).element.scrollIntoView({ block: "nearest" });
  }

  enlargeNumber(number) {
    const name = this.names[number - 1];
    if (name) this.enlarge(name);
  }

  setMode(mode) {
    this.mode = mode;
    this.element.dataset.mode = mode;
    clearInterval(this.#flicker);
    if (mode !== "grid") {
      if (this.#large) this.enlarge(this.#large);
      this.mode = mode;
      this.element.dataset.mode = mode;
      const [first, second] = this.#alike();
      this.pair = [this.pair[0] ?? first, this.pair[1] ?? second];
      this.#wipeTo(50);
    }
    if (mode === "flicker") this.#flicker = setInterval(() => this.swap(), FLICKER_MS);
    this.#arrange();
    this.#onPair();
  }

  /** The first two that were made from the same noise, else the first two. */
  #alike() {
    const tiles = [...this.#tiles.values()];
    for (const { name, noise } of tiles) {
      const other = tiles.find((each) => noise && each.noise === noise && each.name !== name);
      if (other) return [name, other.name];
    }
    return this.names;
  }

  setPair(index, name) {
    const other = 1 - index;
    if (this.pair[other] === name) this.pair[other] = this.pair[index];
    this.pair[index] = name;
    this.#arrange();
    this.#onPair();
  }

  /** Show the other one of two that flicker. */
  swap() {
    this.element.classList.toggle("second");
  }

  #arrange() {
    for (const [name, tile] of this.#tiles) {
      const place = this.mode === "grid" ? -1 : this.pair.indexOf(name);
      tile.element.classList.toggle("first-of-two", place === 0);
      tile.element.classList.toggle("second-of-two", place === 1);
      if (tile.video) this.#player.setActive(tile.video, this.mode === "grid" || place >= 0);
    }
    this.#explainGhost();
  }

  /** What the two colours mean, and whether the two can be expected to agree at all. */
  #explainGhost() {
    if (this.mode !== "ghost") return;
    const [first, second] = this.pair.map((name) => this.#tiles.get(name));
    const colour = (place, tile) => make("span", {}, make("i", { class: place, "aria-hidden": "true" }), ` ${tile.label} alone`);
    const isOther = first.noise !== second.noise;
    const ofNoise = isOther ? " They were not made from the same noise, so they are different gestures." : "";
    const ofRuns = first.run !== second.run ? " Each run has a camera of its own, so they may stand a little apart." : "";
    const note = ofNoise + ofRuns;
    this.#legend.replaceChildren(colour("first", first), colour("second", second), make("span", {}, `Grey where both agree.${note}`));
  }

  #wipeTo(percent) {
    const share = Math.max(0, Math.min(100, percent));
    this.element.style.setProperty("--wipe", `${share}%`);
    this.#handle.setAttribute("aria-valuenow", String(Math.round(share)));
  }

  #dragWipe(event) {
    event.preventDefault();
    this.#handle.focus();
    this.#handle.setPointerCapture(event.pointerId);
    const move = ({ clientX }) => {
      const box = this.#tiles.get(this.pair[0]).element.querySelector(".picture").getBoundingClientRect();
      this.#wipeTo((100 * (clientX - box.left)) / box.width);
    };
    this.#handle.addEventListener("pointermove", move);
    this.#handle.addEventListener("lostpointercapture", () => this.#handle.removeEventListener("pointermove", move), { once: true });
  }

  #keyWipe(event) {
    const step = { ArrowLeft: -2, ArrowRight: 2 }[event.key];
    if (!step) return;
    event.preventDefault();
    event.stopPropagation();
    this.#wipeTo(Number(this.#handle.getAttribute("aria-valuenow")) + step);
  }
}
