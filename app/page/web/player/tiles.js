/** The grid of videos, where the stage draws no bodies or somebody wants them: one tile for each motion. */

import { icon, make, nameOf } from "../dom.js";
import { readingOf } from "../stage/reading.js";

/** All tiles. It has of the stage's interface what a bar steers of videos; they are not laid over each other. */
export class Tiles {
  #tiles = new Map();
  #player;
  #onChange;
  #large = null;
  #layout = null;
  names = []; // of those that can be compared in one place
  mode = "grid";
  closeUp = "hands";

  /** `player` is the Lockstep that the videos join. */
  constructor(player, onChange) {
    this.#player = player;
    this.#onChange = onChange;
    this.element = make("div", { class: "tiles" });
  }

  /** Make or complete the tiles of `rows`. */
  show(rows) {
    for (const row of rows) {
      let tile = this.#tiles.get(row.name);
      if (!tile) {
        tile = new Tile(row, this.#tiles.size + 1, (name) => this.enlarge(name));
        this.#tiles.set(row.name, tile);
        this.element.append(tile.element);
        this.#showCloseUp();
      }
      if (row.motion) tile.offerMotion(row.motion, row);
      if (row.video && !tile.video) this.#player.add(tile.showVideo(row.video, row));
    }
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
    this.#onChange();
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
    this.#tiles.clear();
    this.#large = null;
    this.element.replaceChildren();
  }

  /** Make one tile large, or small again. */
  enlarge(name) {
    this.#large = this.#large === name ? null : name;
    for (const [each, tile] of this.#tiles) {
      tile.element.classList.toggle("large", each === this.#large);
      tile.enlarge.setAttribute("aria-pressed", String(each === this.#large));
    }
    this.element.classList.toggle("has-large", this.#large !== null);
    if (this.#large) this.#tiles.get(name).element.scrollIntoView({ block: "nearest" });
  }

  enlargeNumber(number) {
    const name = [...this.#tiles.keys()][number - 1];
    if (name) this.enlarge(name);
  }
}

/** One motion: its name, and its video or what stands in for it until that is drawn. */
class Tile {
  video = null;
  #picture;
  #tools;
  #motion = null;
  #reading = make("div", { hidden: true });

  constructor(row, number, enlarge) {
    this.label = row.label ?? row.name;
    this.layout = row.layout ?? null; // where it is not that of all
    this.#picture = make("div", { class: "picture" }, make("p", { class: "drawing" }, row.is_drawn === false ? "no video was asked for" : "being drawn"));
    this.enlarge = make(
      "button",
      { type: "button", class: "enlarge", "aria-label": `Enlarge ${this.label}`, title: "Enlarge", "aria-pressed": "false", onclick: () => enlarge(row.name) },
      icon("large"),
    );
    this.#tools = make("span", { class: "tools" }, this.enlarge);
    const key = number <= 9 ? make("kbd", { "aria-hidden": "true" }, String(number)) : "";
    const head = make("header", {}, make("i", { "aria-hidden": "true" }), nameOf(row), key, this.#tools);
    this.element = make("article", { class: "tile", "data-name": row.name, "aria-label": this.label }, head, this.#reading, this.#picture);
    this.element.style.setProperty("--series", row.is_reference ? "var(--reference-ink)" : row.color);
    this.#picture.addEventListener("dblclick", () => enlarge(row.name));
  }

  /** Put the video in place of what was there; returns it. */
  showVideo(url, row) {
    this.video = make("video", { muted: true, playsinline: true, preload: "auto", disablepictureinpicture: true, "aria-label": `Motion of ${this.label}` });
    this.video.muted = true; // the attribute counts for the parser only
    if (row.poster) this.video.poster = row.poster;
    this.video.src = url;
    this.#picture.querySelector(".drawing")?.remove();
    this.#picture.prepend(this.video);
    this.enlarge.before(this.#download(url, `${row.stem}.mp4`, "video"));
    return this.video;
  }

  /** Offer the motion file, and say how it was read, as soon as that is known. */
  offerMotion(url, row) {
    const reading = this.#reading.hidden ? readingOf(row) : null;
    if (reading) this.#reading.replaceWith((this.#reading = reading));
    if (!this.#motion) this.#tools.prepend((this.#motion = this.#download(url, `${row.stem}.npz`, "npz")));
  }

  #download(url, fileName, kind) {
    const label = `Save the ${kind === "video" ? "video" : "motion (npz)"} of ${this.label}`;
    const children = kind === "video" ? [icon("save")] : ["npz"];
    return make("a", { href: url, download: fileName, "aria-label": label, title: label }, ...children);
  }
}
