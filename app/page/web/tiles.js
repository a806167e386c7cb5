/** The grid of videos: one tile for each motion, and two of them on top of each other. */

import { icon, make, nameOf } from "./dom.js";
import { GlbView } from "./glb_view.js";
import { FPS } from "./lockstep.js";

const FLICKER_MS = 500; // one change in half a second: far below what can do harm to anyone
const MOST_PREVIEWS = 2; // each takes a WebGL context and, without a GPU, the visitor's processor
const PREVIEW_PX = 384;
const PREVIEW_MS = 80; // between two pictures while it plays
const SLOW_PREVIEW_MS = 600; // where the processor has to draw them

/** One motion: its name, and its video or what stands in for it until that is drawn. */
class Tile {
  video = null;
  #picture;
  #tools;
  #preview = null;
  #motion = null;
  #previewed = -Infinity; // when it was last drawn

  constructor(row, number, onEnlarge) {
    this.name = row.name;
    this.label = row.label ?? row.name;
    this.layout = row.layout ?? null; // where it is not that of all
    this.run = row.run ?? null;
    this.noise = row.noise ?? null;
    this.#picture = make("div", { class: "picture" }, make("p", { class: "drawing" }, "being drawn"));
    this.enlarge = make(
      "button",
      { type: "button", class: "enlarge", "aria-label": `Enlarge ${this.label}`, title: "Enlarge", "aria-pressed": "false", onclick: () => onEnlarge(this) },
      icon("large"),
    );
    this.#tools = make("span", { class: "tools" }, this.enlarge);
    const swatch = make("i", { class: row.dashes.length ? "dashed" : "solid", "aria-hidden": "true" });
    const key = number <= 9 ? make("kbd", { "aria-hidden": "true" }, String(number)) : "";
    const head = make("header", {}, swatch, nameOf(row), key, this.#tools);
    this.element = make("article", { class: "tile", "data-name": row.name, "aria-label": this.label }, head, this.#picture);
    this.element.style.setProperty("--series", row.is_reference ? "var(--reference-ink)" : row.color);
    this.#picture.addEventListener("dblclick", () => onEnlarge(this));
  }

  get hasPreview() {
    return this.#preview !== null;
  }

  /** Put the video in place of what was there; returns it. */
  showVideo(url, row) {
    this.dropPreview();
    this.video = make("video", { muted: true, playsinline: true, preload: "auto", disablepictureinpicture: true, "aria-label": `Motion of ${this.label}` });
    this.video.muted = true; // the attribute counts for the parser only
    if (row.poster) this.video.poster = row.poster;
    this.video.src = url;
    this.#picture.replaceChildren(this.video);
    this.enlarge.before(this.#download(url, `${row.stem}.mp4`, "video"));
    return this.video;
  }

  /** Offer the motion file as soon as there is one. */
  offerMotion(url, row) {
    if (!this.#motion) this.#tools.prepend((this.#motion = this.#download(url, `${row.stem}.npz`, "npz")));
  }

  #download(url, fileName, kind) {
    const label = `Save the ${kind === "video" ? "video" : "motion (npz)"} of ${this.label}`;
    const children = kind === "video" ? [icon("save")] : ["npz"];
    return make("a", { href: url, download: fileName, "aria-label": label, title: label }, ...children);
  }

  /** Show the motion in 3D until the video is there; without WebGL the words stay. */
  async showPreview(url, time) {
    const canvas = make("canvas", { width: PREVIEW_PX, height: PREVIEW_PX, role: "img", "aria-label": `3D preview of ${this.label}` });
    let view;
    try {
      view = new GlbView(canvas);
    } catch {
      return; // no WebGL here
    }
    this.#preview = view;
    try {
      await view.load(url);
    } catch {
      if (this.#preview === view) this.dropPreview();
      return;
    }
    if (this.#preview !== view) return; // the video was faster
    this.#picture.prepend(canvas);
    this.element.classList.add("previewed");
    view.seek(time());
  }

  /** Draw a moment in 3D, where that is still to be seen; while it plays, not every one. */
  seekPreview(seconds, isPlaying) {
    if (!this.#preview) return;
    const now = performance.now();
    if (isPlaying && now - this.#previewed < (this.#preview.isSlow ? SLOW_PREVIEW_MS : PREVIEW_MS)) return;
    this.#previewed = now;
    this.#preview.seek(seconds);
  }

  dropPreview() {
    this.#preview?.dispose();
    this.#preview = null;
    this.element.classList.remove("previewed");
    this.#picture.querySelector("canvas")?.remove();
  }
}

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
    player.addEventListener("time", () => this.#seekPreviews());
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
        tile = new Tile(row, this.#tiles.size + 1, (which) => this.enlarge(which.name));
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
    for (const row of rows) {
      const tile = this.#tiles.get(row.name);
      const live = [...this.#tiles.values()].filter(({ hasPreview }) => hasPreview).length;
      if (row.preview && !tile.video && !tile.hasPreview && !tile.wasTried && live < MOST_PREVIEWS) {
        tile.wasTried = true;
        tile.showPreview(row.preview, () => this.#player.time);
      }
    }
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
    set("--body-top", (body[0] - top) / shown);
    set("--body-height", (body[1] - body[0]) / shown);
  }

  clear() {
    this.setMode("grid");
    for (const tile of this.#tiles.values()) tile.dropPreview();
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

  #seekPreviews() {
    for (const tile of this.#tiles.values()) tile.seekPreview((this.#player.frame + 0.5) / FPS, this.#player.isPlaying);
  }
}
