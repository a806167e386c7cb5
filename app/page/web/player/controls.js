/** The bar under the stage: time, what is shown, and how bodies are compared. */

import { clockText, iconButton, make, popUp, relabel } from "../dom.js";
import { Displays } from "./displays.js";
import { WorstSeconds } from "./worst.js";

const RATES = [0.25, 0.5, 1, 2];
const MODES = { grid: "All", wipe: "Wipe", flicker: "Flicker", ghost: "Ghost" };
const LOOP_S = 2; // what a loop holds at first
const HOP_S = 1; // of the arrow keys
const KEYS = {
  "Space": "play or pause", "← →": "one second", ", .": "one frame", "L": "loop", "W": "highest-jerk second", "C": "close-up", "E": "exaggerate", "J": "jerk colours", "T": "trail",
  "X": "switch between two bodies", "G": "overlay two bodies (ghost)", "1 to 9": "enlarge body 1 to 9", "+ − 0": "zoom the timeline", "When the viewer has focus": "arrows turn the camera, + and − zoom, Home resets",
};

export class Controls {
  #player;
  #view;
  #audio;
  #look;

  /** `view` is the Stage; of none the bar is hidden. `views` are as Displays has them. */
  constructor(player, view, audio, look, views) {
    this.#player = player;
    this.#view = view;
    this.#audio = audio;
    this.#look = look;
    this.#build(views);
    player.addEventListener("time", () => this.#showTime());
    player.addEventListener("state", () => this.update());
    look.addEventListener("change", () => this.update());
    this.update();
  }

  #build(views) {
    this.play = iconButton("play", "Play", () => this.#player.toggle(), { class: "play" });
    const back = iconButton("back", "One frame back", () => this.#player.step(-1));
    const forward = iconButton("forward", "One frame forward", () => this.#player.step(1));
    this.time = make("output", { class: "time", "aria-live": "off" });
    this.speed = make("select", { "aria-label": "Speed", onchange: () => this.#player.setRate(Number(this.speed.value)) });
    this.speed.append(...RATES.map((rate) => make("option", { value: rate, selected: rate === 1 }, `${rate}×`)));
    this.loop = iconButton("loop", "Loop", () => this.toggleLoop());
    this.sound = iconButton("sound", "Sound off", () => this.#toggleSound(), { class: "sound" });
    this.worst = new WorstSeconds(this.#player);
    const modes = Object.entries(MODES).map(([mode, label]) =>
      make("button", { type: "button", "data-mode": mode, onclick: () => this.#view.setMode(this.#view.mode === mode ? "grid" : mode) }, label),
    );
    this.modes = make("div", { class: "switch", role: "group", "aria-label": "Comparison mode" }, ...modes);
    this.pair = [0, 1].map((index) =>
      make("select", { "aria-label": index ? "Second motion" : "First motion", onchange: ({ target }) => this.#view.setPair(index, target.value) }),
    );
    this.pairBox = make("span", { class: "pair", hidden: true }, ...this.pair);
    this.displays = new Displays(this.#look, this.#view, views);
    const left = make("div", { class: "group going" }, this.play, back, forward, this.time);
    const middle = make("div", { class: "group pace" }, this.speed, this.loop, this.sound);
    const rows = Object.entries(KEYS).map(([key, does]) => make("li", {}, make("kbd", {}, key), make("span", {}, does)));
    const keys = popUp("keys", make("summary", { "aria-label": "Keys" }, "?"), make("ul", {}, ...rows));
    const right = make("div", { class: "group compare" }, this.displays.closeUp, this.modes, this.displays.more, keys);
    this.element = make("div", { class: "controls", role: "toolbar", "aria-label": "Player" }, left, middle, this.worst.element, this.displays.element, right);
    this.#view?.view.append(this.pairBox); // over the picture, each on the side of its close-ups
  }

  /** Everything but the time, which changes too often. */
  update() {
    if (!this.#view) return;
    const { isPlaying, rate, loop } = this.#player;
    relabel(this.play, isPlaying ? "pause" : "play", isPlaying ? "Pause" : "Play");
    this.speed.value = String(rate);
    this.loop.setAttribute("aria-pressed", String(loop !== null));
    relabel(this.sound, this.#audio.muted ? "silent" : "sound", this.#audio.muted ? "Sound on" : "Sound off");
    for (const button of this.modes.children) button.setAttribute("aria-pressed", String(button.dataset.mode === this.#view.mode));
    this.displays.update();
    this.#showPair();
    this.#showTime();
  }

  #showPair() {
    const { names, mode, pair } = this.#view;
    this.modes.hidden = names.length < 2;
    this.pairBox.hidden = mode === "grid";
    if (mode === "grid") return;
    for (const [index, select] of this.pair.entries()) {
      if (select.options.length !== names.length) {
        select.replaceChildren(...names.map((name) => make("option", { value: name }, this.#view.labelOf(name))));
      }
      select.value = pair[index] ?? "";
      select.style.setProperty("--series", this.#view.colorOf(pair[index]));
    }
  }

  #showTime() {
    const { time, duration, frame } = this.#player;
    this.time.textContent = `${clockText(time)} / ${clockText(duration)}`;
    this.time.title = `Frame ${frame}`;
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
      x: () => this.#view.swap(),
      w: () => this.worst.toggle(),
      g: () => this.#view.names.length > 1 && this.#view.setMode(this.#view.mode === "ghost" ? "grid" : "ghost"),
    };
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    if (/^[1-9]$/.test(key)) this.#view.enlargeNumber(Number(key));
    else if (actions[key]) actions[key]();
    else return this.displays.press(key);
    return true;
  }
}
