/** One tile of the grid of videos. */

import { icon, make, nameOf } from "../dom.js";
import { readingOf } from "../stage/reading.js";

/** One motion: its name, and its video or what stands in for it until that is drawn. */
export class Tile {
  video = null;
  #picture;
  #tools;
  #motion = null;
  #reading = make("div", { hidden: true });

  /** `owner` is told: `enlarge(name)`. */
  constructor(row, number, owner) {
    this.name = row.name;
    this.label = row.label ?? row.name;
    this.layout = row.layout ?? null; // where it is not that of all
    this.run = row.run ?? null;
    this.noise = row.noise ?? null;
    this.#picture = make("div", { class: "picture" }, make("p", { class: "drawing" }, row.is_drawn === false ? "no video was asked for" : "being drawn"));
    this.enlarge = make(
      "button",
      { type: "button", class: "enlarge", "aria-label": `Enlarge ${this.label}`, title: "Enlarge", "aria-pressed": "false", onclick: () => owner.enlarge(this.name) },
      icon("large"),
    );
    this.#tools = make("span", { class: "tools" }, this.enlarge);
    const swatch = make("i", { class: row.dashes.length ? "dashed" : "solid", "aria-hidden": "true" });
    const key = number <= 9 ? make("kbd", { "aria-hidden": "true" }, String(number)) : "";
    const head = make("header", {}, swatch, nameOf(row), key, this.#tools);
    this.element = make("article", { class: "tile", "data-name": row.name, "aria-label": this.label }, head, this.#reading, this.#picture);
    this.element.style.setProperty("--series", row.is_reference ? "var(--reference-ink)" : row.color);
    this.#picture.addEventListener("dblclick", () => owner.enlarge(this.name));
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
