/** One tile of the grid of videos. */

import { icon, make, nameOf } from "../dom.js";
import { View3d } from "../body/view3d.js";

/** One motion: its name, and its video or what stands in for it until that is drawn. */
export class Tile {
  video = null;
  wasTried = false; // the 3D view, by itself
  #picture;
  #tools;
  #owner;
  #view = null; // a View3d
  #isWanted = false; // the 3D view, although there is a video
  #motion = null;
  #button3d = null;

  /** `owner` is told: `enlarge(name)`, `wanted3d(tile)`; its `orbit` turns all 3D views. */
  constructor(row, number, owner) {
    this.#owner = owner;
    this.name = row.name;
    this.label = row.label ?? row.name;
    this.layout = row.layout ?? null; // where it is not that of all
    this.run = row.run ?? null;
    this.noise = row.noise ?? null;
    this.#picture = make("div", { class: "picture" }, make("p", { class: "drawing" }, "being drawn"));
    this.enlarge = make(
      "button",
      { type: "button", class: "enlarge", "aria-label": `Enlarge ${this.label}`, title: "Enlarge", "aria-pressed": "false", onclick: () => owner.enlarge(this.name) },
      icon("large"),
    );
    this.#tools = make("span", { class: "tools" }, this.enlarge);
    const swatch = make("i", { class: row.dashes.length ? "dashed" : "solid", "aria-hidden": "true" });
    const key = number <= 9 ? make("kbd", { "aria-hidden": "true" }, String(number)) : "";
    const head = make("header", {}, swatch, nameOf(row), key, this.#tools);
    this.element = make("article", { class: "tile", "data-name": row.name, "aria-label": this.label }, head, this.#picture);
    this.element.style.setProperty("--series", row.is_reference ? "var(--reference-ink)" : row.color);
    this.#picture.addEventListener("dblclick", () => owner.enlarge(this.name));
  }

  /** Whether a 3D view is open or comes. */
  get is3d() {
    return this.#view !== null;
  }

  /** Put the video in place of what was there; returns it. */
  showVideo(url, row) {
    if (!this.#isWanted) this.close3d();
    this.video = make("video", { muted: true, playsinline: true, preload: "auto", disablepictureinpicture: true, "aria-label": `Motion of ${this.label}` });
    this.video.muted = true; // the attribute counts for the parser only
    if (row.poster) this.video.poster = row.poster;
    this.video.src = url;
    this.#picture.querySelector(".drawing")?.remove();
    this.#picture.prepend(this.video);
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

  /** Offer the motion in 3D as soon as there is a file of it. */
  offer3d(url) {
    if (this.#button3d) return;
    const label = `Turn ${this.label} in 3D`;
    this.#button3d = make("button", { type: "button", class: "turn", "aria-label": label, title: label, "aria-pressed": "false", onclick: () => this.#toggle3d(url) }, "3D");
    this.#tools.prepend(this.#button3d);
  }

  #toggle3d(url) {
    if (this.#isWanted) return this.close3d();
    if (!this.#view) this.open3d(url);
    if (this.#view) this.#want3d();
    return undefined;
  }

  /** Keep the 3D view also when there is a video. */
  #want3d() {
    this.#isWanted = true;
    this.#button3d?.setAttribute("aria-pressed", "true");
    this.element.classList.add("turning");
    this.#owner.wanted3d(this);
  }

  /** Show the motion in 3D; without WebGL all stays as it is. */
  async open3d(url) {
    let view;
    try {
      view = new View3d(this.label, this.#owner.orbit, () => this.#want3d());
    } catch {
      if (this.#button3d) this.#button3d.hidden = true; // no WebGL here
      return;
    }
    this.#view = view;
    this.#picture.querySelector(".said")?.remove();
    try {
      await view.load(url);
    } catch (error) {
      if (this.#view !== view) return; // closed meanwhile
      const wasAsked = this.#isWanted;
      this.close3d();
      if (wasAsked) this.#picture.append(make("p", { class: "said", role: "alert" }, error.message));
      return;
    }
    if (this.#view !== view) return; // closed meanwhile
    this.#picture.append(view.element);
    this.element.classList.add("previewed");
    view.seek(this.#owner.seconds, false);
  }

  seek3d(seconds, isPlaying) {
    this.#view?.seek(seconds, isPlaying);
  }

  close3d() {
    this.#view?.dispose();
    this.#view = null;
    this.#isWanted = false;
    this.#button3d?.setAttribute("aria-pressed", "false");
    this.element.classList.remove("previewed", "turning");
  }
}
