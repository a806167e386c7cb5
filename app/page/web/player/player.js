/**
 * The lock-step player of the page. The server sends everything that is known of a run, again and
 * again as it grows; this makes what is missing and leaves alone what is there. Bodies move on the
 * stage; where a browser draws none, videos stand in its place.
 */

import { make, wantsStillness, whenPresent } from "../dom.js";
import { FPS } from "../stage/motion.js";
import { DISPLAYS, Look } from "../stage/look.js";
import { withOverride } from "../stage/reading.js";
import { Stage } from "../stage/stage.js";
import { currentFilter, followFilter, setFilter } from "../filter_switch.js";
import { Argument } from "./argument.js";
import { Controls } from "./controls.js";
import { Editing } from "./editing.js";
import { Findings, goTo } from "./findings.js";
import { Lockstep } from "./lockstep.js";
import { Parts } from "./parts.js";
import { LOW, Timeline } from "./timeline.js";
import { Videos } from "./videos.js";

const KEEPS_ITS_KEYS = "input, textarea, select, [contenteditable], [role=tab], [role=listbox]";
const PRESSES = "button, a, summary"; // what the space bar presses
const NO_STAGE = "This browser does not support 3D graphics (WebGL 2). Videos are shown instead, as soon as they are rendered.";

const CROWD = 4; // bodies that need the width of the form
const ARGUED = { hasHeat: true, hasTrail: false, heatScale: 2000 };
const NOTE_MS = 400; // browsers allow few changes of an address in a while
const MARK = "stage"; // of what is seen, behind the # of an address

class Player {
  #root;
  #lockstep = new Lockstep();
  #audio = make("audio", { preload: "auto" });
  #look = new Look();
  #run = null;
  #timelineUrl = null;
  #isExample = false;
  #hasBegun = false; // what the address says has been shown
  /** @type {import("../messages").PlayerValue} */
  #value = {};
  #stage = null;
  #videos = new Videos(this.#lockstep);
  #noting = 0;
  sounds = make("select", { class: "sounds", "aria-label": "Audio track", hidden: true, onchange: () => this.#playOther() });
  #why = make("p", { class: "no-stage", role: "note", hidden: true }, NO_STAGE);

  constructor(root) {
    this.#root = root;
    try {
      this.#stage = new Stage(this.#lockstep, this.#look, () => this.#changed());
    } catch {
      this.#why.hidden = false; // no WebGL here
    }
    const orbit = this.#stage?.orbit;
    this.controls = new Controls(this.#lockstep, this.#stage, this.#audio, this.#look, { "Make a video of this view": () => this.#makeVideo() });
    this.timeline = new Timeline(this.#lockstep);
    this.editing = new Editing(this.#lockstep, this.timeline, { send: () => this.#press(".take-start"), onShown: () => this.#showStage(), onExpected: (places) => this.#stage?.expect(places) });
    this.editing.toggle.addEventListener("click", () => this.editing.isOpen && this.#foldForm(true));
    this.#stage?.element.addEventListener("body", ({ detail }) => this.timeline.bodies.value && this.timeline.showBody(detail));
    this.argument = new Argument(this.#stage);
    this.controls.element.append(this.argument.slider);
    this.timeline.bar.append(this.sounds, this.controls.worst.line);
    this.fold = make("button", { type: "button", class: "fold", hidden: true, onclick: () => this.#foldForm(!this.#isFolded) });
    root.showFinding = this.timeline.onmark = ({ motion_name: name, worst_time_s: at, part }) => {
      if (at !== null) goTo(this.#lockstep, at);
      this.#stage?.lookAt(name, part);
    };
    this.findings = new Findings(root.showFinding);
    const stageAndFindings = make("div", { class: "seen" }, this.#stage?.element ?? "", this.findings.element);
    this.parts = new Parts(root);
    const parts = [this.fold, this.parts.element, this.#why, this.argument.head, stageAndFindings, this.#videos.element, this.controls.element, this.controls.displays.box, this.editing.element, this.timeline.element, this.#audio];
    root.replaceChildren(...parts);
    new ResizeObserver(() => this.#stage?.fit()).observe(this.timeline.element);
    root.classList.toggle("staged", this.#stage !== null);
    root.addEventListener("click", ({ detail, target }) => {
      const isEdited = target.closest(".editing.open ~ .timeline .event"); // and keys go on with it
      if (detail > 0 && !isEdited) target.closest("button")?.blur(); // after a mouse, the space bar plays again
    });
    root.setAttribute("role", "group");
    root.setAttribute("aria-label", "Synchronised playback of all bodies");
    root.lockstep = this.#lockstep; // for whoever wants to look at it from outside
    root.stage = this.#stage;
    root.setNoise = (rad) => this.argument.set(rad);
    root.viewState = () => JSON.stringify(this.#viewState);
    root.edits = () => this.editing.request;
    root.addEventListener("override", ({ detail }) => {
      root.addOverride = (before) => withOverride(before, detail, this.#value.rows?.length === 1);
      this.#press(".override-start");
    });
    root.look = this.#look;
    const note = () => this.#noteAddress();
    followFilter(note);
    this.#look.addEventListener("change", note);
    orbit?.addEventListener("change", note);
    this.#lockstep.addEventListener("time", () => this.#lockstep.isPlaying || note());
    this.#lockstep.addEventListener("state", note);
  }

  /** What is seen, for an address that shows the same again. */
  get #picture() {
    const { mode, pair, closeUp, orbit } = this.#stage;
    const { frame, isPlaying } = this.#lockstep;
    const rounded = (value) => String(Math.round(1000 * value) / 1000);
    const fields = {
      camera: orbit.isMoved && orbit.state.map(rounded).join(" "),
      t: frame > 0 && !isPlaying && rounded(frame / FPS),
      close: closeUp !== "hands" && closeUp,
      ...(mode !== "grid" && { mode, a: pair[0], b: pair[1] }),
      sound: this.sounds.selectedIndex > 0 && this.sounds.selectedIndex,
      filter: currentFilter() !== "raw" && currentFilter(),
    };
    const address = new URLSearchParams();
    this.#look.write(address);
    for (const [name, value] of Object.entries(fields)) if (value) address.set(name, value);
    return address;
  }

  /** Show what an address says, but for the time: once there is a sound. */
  #showPicture(address) {
    const { camera, close, mode, sound, filter = "raw", ...pair } = Object.fromEntries(address);
    this.#look.read(address);
    if (camera) this.#stage.orbit.place(camera.split(" ").map(Number));
    if (close) this.#stage.setCloseUp(close);
    for (const [index, name] of ["a", "b"].entries()) if (this.#stage.names.includes(pair[name])) this.#stage.setPair(index, pair[name]);
    if (mode) this.#stage.setMode(mode);
    if (sound && this.#value.sounds?.[sound]) {
      this.sounds.selectedIndex = sound;
      this.#playOther();
    }
    setFilter(filter);
  }

  /** What the stage shows, as app/page/tabs/stage.py reads it. */
  get #viewState() {
    return { ...this.#stage.picture, settings: this.#look.values, camera: this.#stage.orbit.state, soundUrl: this.#sound?.audio_url ?? this.#value.audio ?? null };
  }

  /** The server draws what is seen now, and tells of it under the stage. */
  #makeVideo() {
    this.#press(".seen-start");
    this.controls.displays.fold();
  }

  /** A hidden button of the tab. */
  #press(name) {
    this.#root.closest("[role=tabpanel]")?.querySelector(name)?.click();
  }

  /** The bodies that are to be seen. */
  #showStage() {
    const { rows = [], running = false } = this.#value;
    const visible = this.editing.visibleRows(rows);
    this.#stage?.show(visible, running);
    this.timeline.showTakes(visible.map(({ name }) => name));
    this.controls?.update();
  }

  /** How bodies are compared has changed. */
  #changed() {
    this.controls?.update();
    this.#noteAddress();
  }

  #noteAddress() {
    clearTimeout(this.#noting);
    if (this.#stage && this.#hasBegun && !this.#isExample) this.#noting = setTimeout(() => writeHash(this.#picture), NOTE_MS);
  }

  /**
   * Show a run as far as it has come; nothing where there is none.
   *
   * @param {import("../messages").PlayerValue} value
   */
  show(value) {
    const { run = null, rows = [], audio = null, sounds = [], is_example: plays = false, plays_when_ready: begins = false, findings = [] } = value;
    if (run !== this.#run) {
      this.#clear(run);
    }
    this.#showArgument(value.noise ?? null);
    this.#value = value;
    const isDrawn = this.#stage || !plays; // an example has no videos
    const isWorthIt = rows.some((row) => row.video || (isDrawn && (row.frames || row.motion)));
    this.#root.hidden = !isWorthIt;
    this.#root.classList.toggle("opening", plays);
    this.parts.show(isWorthIt && !plays);
    this.#makeRoom();
    if (!isWorthIt) return;
    const hasSound = !!audio && !this.#audio.hasAttribute("src");
    if (hasSound) {
      this.#audio.src = audio;
      this.#lockstep.setSound(this.#audio);
    }
    if (this.sounds.options.length !== sounds.length) this.sounds.replaceChildren(...sounds.map(({ label }) => make("option", {}, label)));
    this.sounds.hidden = sounds.length < 2;
    const timeline = this.#sound?.timeline_url ?? value.timeline;
    const isFirst = this.fold.hidden;
    this.fold.hidden = plays || !this.#stage;
    if (!this.fold.hidden && isFirst) this.#foldForm(rows.length >= CROWD || matchMedia(LOW).matches);
    this.editing.show(run, value.editing ?? null, rows);
    this.#showStage();
    this.#showRows();
    this.findings.show(findings, rows);
    this.timeline.mark(findings);
    this.timeline.know(rows);
    this.controls.update();
    if (hasSound) this.#begin(plays, begins);
    if (timeline && timeline !== this.#timelineUrl) this.#loadTimeline(timeline, rows);
  }

  /** Whose plays, where motions of other speech stand beside each other. */
  get #sound() {
    return this.#value.sounds?.[this.sounds.selectedIndex] ?? null;
  }

  /** Another sound under the same bodies, from the same moment on. */
  #playOther() {
    const { audio_url: audio, timeline_url: timeline } = this.#sound;
    const { time, isPlaying } = this.#lockstep;
    if (isPlaying) this.#lockstep.pause();
    this.#lockstep.setLoop(null);
    this.#audio.src = audio;
    const goOn = () => {
      this.#lockstep.seek(time);
      if (isPlaying) this.#lockstep.play();
    };
    this.#audio.addEventListener("loadedmetadata", goOn, { once: true });
    this.#loadTimeline(timeline, this.#value.rows);
    this.#noteAddress();
  }

  get #isFolded() {
    return !!this.#root.closest(".columns.folded");
  }

  /** The form makes room for the bodies, but for its buttons, and comes back on a click. */
  #foldForm(isFolded) {
    this.#root.closest(".columns")?.classList.toggle("folded", isFolded);
    for (let at = this.#root; at && !at.matches(".results"); at = at.parentElement) at.classList.add("around-fold");
    this.fold.textContent = isFolded ? "Show the form" : "Hide the form";
    this.fold.setAttribute("aria-expanded", String(!isFolded));
  }

  /**
   * The page's head makes room for a run on the stage. By classes: a style that asks for what is inside of most of the
   * page is found anew, for all of it, at every change there.
   */
  #makeRoom() {
    if (!this.#root.closest("#player, #own-player")) return;
    const isOn = this.#root.matches(".staged:not(.opening, [hidden])");
    for (const place of [".results", ".columns", ".tabitem"]) this.#root.closest(place)?.classList.toggle("with-run", isOn);
    const tabs = this.#root.closest(".tabs");
    for (const place of [tabs, tabs?.parentElement]) place?.classList.toggle("with-run", !!tabs?.querySelector(".columns.with-run"));
  }

  /** Videos where they are what is shown. */
  #showRows() {
    const { rows = [] } = this.#value;
    const isVideo = !this.#stage || !rows.some(({ frames }) => frames);
    if (this.#stage) this.#stage.element.hidden = isVideo;
    this.#videos.element.hidden = !isVideo;
    this.#root.classList.toggle("staged", !isVideo);
    this.#makeRoom();
    this.controls.element.hidden = isVideo; // each video has the browser's own
    if (isVideo) this.#videos.show(rows);
  }

  /**
   * What happens when there is a sound: an example plays at once, again and again, without it, as
   * nobody has asked for any yet; a run that somebody waits for plays at once; and an address that
   * says so shows its moment.
   */
  #begin(plays, begins) {
    this.#isExample = plays;
    if (plays) this.#audio.muted = true;
    const begin = () => {
      this.#hasBegun = true;
      const address = plays || !this.#stage ? null : readHash();
      if (address) this.#showPicture(address);
      if (address && !begins) {
        const seek = () => this.#lockstep.seekFrame(Math.round(FPS * (Number(address.get("t")) || 0)));
        if (this.sounds.selectedIndex > 0) return this.#audio.addEventListener("loadedmetadata", seek, { once: true });
        return seek();
      }
      if (wantsStillness()) return undefined;
      if (plays) this.#lockstep.setLoop([0, this.#lockstep.duration]);
      return plays || (begins && this.#stage) ? this.#lockstep.play() : undefined;
    };
    if (this.#audio.readyState >= HTMLMediaElement.HAVE_METADATA) begin();
    else this.#audio.addEventListener("loadedmetadata", begin, { once: true });
  }

  /**
   * @param {string} url
   * @param {import("../messages").PlayerRow[]} rows
   */
  async #loadTimeline(url, rows) {
    this.#timelineUrl = url;
    const response = await fetch(url);
    if (!response.ok) return; // kept no longer: the videos are gone as well
    /** @type {import("../messages").Timeline} */
    const data = await response.json();
    if (url !== this.#timelineUrl) return;
    this.timeline.show(data, rows);
    this.#stage?.setWords(data.words ?? []);
    const labelOf = (name) => rows.find((row) => row.name === name)?.label ?? name;
    this.controls.worst.set(data.worst.map((each) => ({ ...each, name: labelOf(each.name) })));
  }

  /** Nothing but the bodies, in the colours of their jerk, and how far noise moves them. */
  #showArgument(noise) {
    if (!noise === !this.#value.noise && noise?.initial_rad === this.#value.noise?.initial_rad) return;
    this.#root.classList.toggle("argument", !!noise);
    for (const [name, value] of Object.entries(ARGUED)) this.#look.set(name, noise ? value : DISPLAYS[name].usual);
    this.argument.show(noise);
  }

  #clear(run) {
    this.#run = run;
    if (this.#isExample) this.#audio.muted = false;
    this.#isExample = this.#hasBegun = false;
    this.fold.hidden = true;
    this.#foldForm(false);
    this.#timelineUrl = null;
    this.sounds.replaceChildren();
    clearTimeout(this.#noting);
    this.#videos.clear();
    this.#stage?.clear();
    this.#lockstep.clear();
    this.timeline.clear();
    this.editing.show(run, null, []);
    this.findings.clear();
    this.controls.worst.set([]);
  }

  /** Keys work anywhere on the page where nothing else wants them, while the player is seen. */
  onKey(event) {
    const { target } = event;
    if (event.defaultPrevented || !this.controls.element.offsetParent) return;
    const isOurs = this.#root.contains(target) || target === document.body;
    if (!isOurs || target.closest(KEEPS_ITS_KEYS)) return;
    if (event.key === " " && target.closest(PRESSES)) return;
    if (this.controls.press(event) || this.timeline.press(event)) event.preventDefault();
  }
}

/** What of the stage the page's address says; null where it says nothing of it. */
function readHash() {
  const params = new URLSearchParams(location.hash.slice(1));
  return params.has(MARK) ? params : null;
}

/** Have it lead to what is seen; nothing is said where all is as usual. */
function writeHash(params) {
  if (!location.protocol.startsWith("http")) return; // a file by itself has no address to be shared
  const hash = params.size ? `#${MARK}&${params}` : "";
  if (hash === location.hash || (!hash && !location.hash.startsWith(`#${MARK}`))) return;
  history.replaceState(history.state, "", location.pathname + location.search + hash);
}

/** Called by Gradio's component; `watch` tells of new values. */
export function mountPlayer(element, props, watch) {
  const player = new Player(element.querySelector(".lockstep"));
  document.addEventListener("keydown", (event) => player.onKey(event));
  let hasShown = false;
  const show = () => {
    hasShown = true;
    player.show(JSON.parse(JSON.stringify(props.value ?? {})));
  };
  watch("value", show);
  if (!new URLSearchParams(location.search).has("run")) show();
  else whenPresent("html[data-ready]").then(() => hasShown || show()); // a link leads to a run, not to the page's example
}
