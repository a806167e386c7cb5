/** Videos in place of the stage, where the browser draws no bodies. */

import { make, nameOf } from "../dom.js";
import { filesOf } from "../stage/files.js";
import { readingOf } from "../stage/reading.js";

export class Videos {
  #tiles = new Map(); // name -> its element
  element = make("div", { class: "tiles" });

  /** `player` is the clock: where it stands, videos stand too; each plays by its own controls. */
  constructor(player) {
    player.addEventListener("time", () => {
      for (const video of this.element.querySelectorAll("video")) if (!player.isPlaying) video.currentTime = player.time;
    });
  }

  /** @param {import("../messages").PlayerRow[]} rows */
  show(rows) {
    for (const row of rows) {
      const previous = this.#tiles.get(row.name);
      const content = `${row.motion} ${row.video}`;
      if (previous?.dataset.content === content) continue;
      const label = row.label ?? row.name;
      const video = row.video ? make("video", { src: row.video, controls: true, playsinline: true, preload: "metadata", "aria-label": `Motion of ${label}` }) : make("p", { class: "drawing" }, row.will_have_video === false ? "no video requested" : "rendering");
      const head = make("header", {}, make("i", { "aria-hidden": "true" }), nameOf(row), make("span", { class: "tools" }, filesOf(row) ?? ""));
      const tile = make("article", { class: "tile", "data-name": row.name, "data-content": content, "aria-label": label }, head, readingOf(row) ?? "", video);
      tile.style.setProperty("--series", row.is_reference ? "var(--reference-ink)" : row.color);
      this.#tiles.set(row.name, tile);
      if (previous) previous.replaceWith(tile);
      else this.element.append(tile);
    }
  }

  clear() {
    this.#tiles.clear();
    this.element.replaceChildren();
  }
}
