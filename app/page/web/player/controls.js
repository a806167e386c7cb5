/** The bar under the videos: play, frame by frame, speed, loop, sound, and how they are compared. */

import { clockText, make, relabel } from "../dom.js";
import { WorstSeconds } from "./worst.js";

const RATES = [0.25, 0.5, 1, 2];
const MODES = { grid: "All", wipe: "Wipe", flicker: "Flicker", ghost: "Ghost" };
const CLOSE_UPS = { hands: "Hands", face: "Face", both: "Both", off: "Off" };
const LOOP_S = 2; // what a loop holds at first
const HOP_S = 1; // of the arrow keys
const KEYS_HELP = "Space: play or pause. Arrows: one second. Comma and full stop: one frame. L: loop. W: worst second. C: close-up. X: the other of two. G: ghost, one over another. 1 to 9: enlarge. Plus, minus, 0: zoom of the time line.";

export class Controls {
  #player;
  #tiles;
  #audio;

  constructor(player, tiles, audio) {
    this.#player = player;
    this.#tiles = tiles;
    this.#audio = audio;
    this.#build();
    player.addEventListener("time", () => this.#showTime());
    player.addEventListener("state", () => this.update());
    this.update();
  }

  #build() {
    const button = (name, label, onclick) => {
      const made = make("button", { type: "button", onclick });
      relabel(made, name, label);
      return made;
    };
    this.play = button("play", "Play", () => this.#player.toggle());
    this.play.classList.add("play");
    const back = button("back", "One frame back", () => this.#player.step(-1));
    const forward = button("forward", "One frame on", () => this.#player.step(1));
    this.time = make("output", { class: "time", "aria-live": "off" });
    this.speed = make("select", { "aria-label": "Speed", onchange: () => this.#player.setRate(Number(this.speed.value)) });
    this.speed.append(...RATES.map((rate) => make("option", { value: rate, selected: rate === 1 }, `${rate}×`)));
    this.loop = button("loop", "Loop", () => this.toggleLoop());
    this.sound = button("sound", "Sound off", () => this.#toggleSound());
    const modes = Object.entries(MODES).map(([mode, label]) =>
      make("button", { type: "button", "data-mode": mode, onclick: () => this.#tiles.setMode(mode) }, label),
    );
    this.modes = make("div", { class: "switch", role: "group", "aria-label": "How videos are compared" }, ...modes);
    this.pair = [0, 1].map((index) =>
      make("select", { "aria-label": index ? "Second of two" : "First of two", onchange: ({ target }) => this.#tiles.setPair(index, target.value) }),
    );
    this.pairBox = make("span", { class: "pair", hidden: true }, this.pair[0], make("span", {}, "against"), this.pair[1]);
    const closeUps = Object.entries(CLOSE_UPS).map(([name, label]) =>
      make("button", { type: "button", "data-close-up": name, onclick: () => this.#tiles.setCloseUp(name) }, label),
    );
    this.closeUps = make("div", { class: "switch", role: "group", "aria-label": "Close-up" }, ...closeUps);
    this.closeUpBox = make("span", { class: "pair close-up" }, make("span", { "aria-hidden": "true" }, "Close-up"), this.closeUps);
    this.worst = new WorstSeconds(this.#player);
    const left = make("div", { class: "group" }, this.play, back, forward, this.time);
    const middle = make("div", { class: "group" }, this.speed, this.loop, this.sound);
    const right = make("div", { class: "group compare" }, this.closeUpBox, this.pairBox, this.modes);
    const keys = make("button", { type: "button", class: "keys", title: KEYS_HELP, "aria-label": `Keys. ${KEYS_HELP}` }, "?");
    right.append(keys);
    this.element = make("div", { class: "controls", role: "toolbar", "aria-label": "Player" }, left, middle, this.worst.element, right);
  }

  /** Everything but the time, which changes too often. */
  update() {
    const { isPlaying, rate, loop } = this.#player;
    relabel(this.play, isPlaying ? "pause" : "play", isPlaying ? "Pause" : "Play");
    this.speed.value = String(rate);
    this.loop.setAttribute("aria-pressed", String(loop !== null));
    relabel(this.sound, this.#audio.muted ? "silent" : "sound", this.#audio.muted ? "Sound on" : "Sound off");
    for (const button of this.modes.children) button.setAttribute("aria-pressed", String(button.dataset.mode === this.#tiles.mode));
    for (const button of this.closeUps.children) {
      button.setAttribute("aria-pressed", String(button.dataset.closeUp === this.#tiles.closeUp));
      button.hidden = !this.#tiles.closeUps.includes(button.dataset.closeUp);
    }
    this.closeUpBox.hidden = this.#tiles.closeUps.length < 2;
    this.#showPair();
    this.#showTime();
  }

  #showPair() {
    const { names, mode, pair } = this.#tiles;
    this.modes.hidden = names.length < 2;
    this.pairBox.hidden = mode === "grid";
    for (const [index, select] of this.pair.entries()) {
      if (select.options.length !== names.length) {
        select.replaceChildren(...names.map((name) => make("option", { value: name }, this.#tiles.labelOf(name))));
      }
      select.value = pair[index] ?? "";
    }
  }

  #showTime() {
    const { time, duration, frame } = this.#player;
    this.time.textContent = `${clockText(time)} / ${clockText(duration)} · frame ${frame}`;
  }

  #toggleSound() {
    this.#audio.muted = !this.#audio.muted;
    this.update();
  }

  /** Loop around the present moment, or no more. */
  toggleLoop() {
    const { loop, time, duration } = this.#player;
    if (loop) return this.#player.setLoop(null);
    const start = Math.max(0, Math.min(time, duration - LOOP_S));
    return this.#player.setLoop([start, Math.min(start + LOOP_S, duration)]);
  }

  /** What a key does; true if it does anything. */
  press(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return false;
    const { time } = this.#player;
    const actions = {
      " ": () => this.#player.toggle(),
      ArrowLeft: () => this.#player.seek(time - HOP_S),
      ArrowRight: () => this.#player.seek(time + HOP_S),
      ",": () => this.#player.step(-1),
      ".": () => this.#player.step(1),
      Home: () => this.#player.seekFrame(0),
      End: () => this.#player.seekFrame(Infinity),
      l: () => this.toggleLoop(),
      x: () => this.#tiles.swap(),
      w: () => this.worst.toggle(),
      c: () => this.#tiles.nextCloseUp(),
      g: () => this.#tiles.names.length > 1 && this.#tiles.setMode(this.#tiles.mode === "ghost" ? "grid" : "ghost"),
    };
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    if (/^[1-9]$/.test(key)) this.#tiles.enlargeNumber(Number(key));
    else if (actions[key]) actions[key]();
    else return false;
    return true;
  }
}
