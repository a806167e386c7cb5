/**
 * The lock-step player of the page. The server sends everything that is known of a run, again and
 * again as it grows; this makes what is missing and leaves alone what is there.
 */

import { Controls } from "./controls.js";
import { make } from "../dom.js";
import { Lockstep } from "./lockstep.js";
import { Tiles } from "./tiles.js";
import { Timeline } from "./timeline.js";

const KEEPS_ITS_KEYS = "input, textarea, select, [contenteditable], [role=tab], [role=listbox]";
const PRESSES = "button, a"; // what the space bar presses

class Player {
  #root;
  #lockstep = new Lockstep();
  #audio = make("audio", { preload: "auto" });
  #run = null;
  #timelineUrl = null;
  #hasBegun = false;

  constructor(root) {
    this.#root = root;
    this.tiles = new Tiles(this.#lockstep, () => this.controls?.update());
    this.controls = new Controls(this.#lockstep, this.tiles, this.#audio);
    this.timeline = new Timeline(this.#lockstep);
    root.replaceChildren(this.tiles.element, this.controls.element, this.timeline.element, this.#audio);
    root.addEventListener("click", ({ detail, target }) => {
      if (detail > 0) target.closest("button")?.blur(); // after a mouse, the space bar plays again
    });
    root.setAttribute("role", "group");
    root.setAttribute("aria-label", "Videos in lock-step");
    root.lockstep = this.#lockstep; // for whoever wants to look at it from outside
  }

  /** Show a run as far as it has come; nothing where there is none. */
  show({ run = null, rows = [], layout = null, audio = null, timeline = null, plays = false, paired = false }) {
    if (run !== this.#run) this.#clear(run);
    const isWorthIt = rows.some((row) => row.motion || row.video);
    this.#root.hidden = !isWorthIt;
    this.#root.classList.toggle("opening", plays);
    if (!isWorthIt) return;
    if (audio && !this.#audio.hasAttribute("src")) {
      this.#audio.src = audio;
      this.#lockstep.setSound(this.#audio);
    }
    this.tiles.element.classList.toggle("paired", paired);
    this.tiles.setLayout(layout);
    this.tiles.show(rows);
    this.controls.update();
    if (plays && !this.#hasBegun) this.#begin();
    if (timeline && timeline !== this.#timelineUrl) this.#loadTimeline(timeline, rows);
  }

  /** Play at once, again and again, without sound: nobody has asked for any yet. */
  #begin() {
    this.#hasBegun = true;
    this.#audio.muted = true;
    if (matchMedia("(prefers-reduced-motion: reduce)").matches) return;
    const begin = () => {
      this.#lockstep.setLoop([0, this.#lockstep.duration]);
      this.#lockstep.play();
    };
    if (this.#audio.readyState >= HTMLMediaElement.HAVE_METADATA) begin();
    else this.#audio.addEventListener("loadedmetadata", begin, { once: true });
  }

  async #loadTimeline(url, rows) {
    this.#timelineUrl = url;
    const response = await fetch(url);
    if (!response.ok) return; // kept no longer: the videos are gone as well
    const data = await response.json();
    if (url !== this.#timelineUrl) return;
    this.timeline.show(data, rows);
    this.controls.worst.set(data.worst.map((each) => ({ ...each, name: this.tiles.labelOf(each.name) })));
  }

  #clear(run) {
    this.#run = run;
    if (this.#hasBegun) this.#audio.muted = false;
    this.#hasBegun = false;
    this.#timelineUrl = null;
    this.tiles.clear();
    this.#lockstep.clear();
    this.timeline.clear();
    this.controls.worst.set([]);
  }

  dispose() {
    this.#clear(null);
    this.timeline.dispose();
  }

  /** Keys work anywhere on the page where nothing else wants them, while the player is seen. */
  onKey(event) {
    const { target } = event;
    if (this.#root.hidden || event.defaultPrevented || !this.#root.offsetParent) return;
    const isOurs = this.#root.contains(target) || target === document.body;
    if (!isOurs || target.closest(KEEPS_ITS_KEYS)) return;
    if (event.key === " " && target.closest(PRESSES)) return;
    if (this.controls.press(event) || this.timeline.press(event)) event.preventDefault();
  }
}

/** Called by Gradio's component; `watch` tells of new values. */
export function mountPlayer(element, props, watch) {
  const player = new Player(element.querySelector(".lockstep"));
  const onKey = (event) => {
    if (element.isConnected) return player.onKey(event);
    document.removeEventListener("keydown", onKey); // Gradio has put another in its place
    return player.dispose();
  };
  document.addEventListener("keydown", onKey);
  const show = () => player.show(JSON.parse(JSON.stringify(props.value ?? {})));
  watch("value", show);
  show();
}
