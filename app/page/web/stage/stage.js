/**
 * The stage: all bodies of a run in one canvas, under one camera, moved by the player's clock.
 *
 * A picture is drawn when time, camera, look or size change; while it plays, as coarsely as it takes
 * to keep up.
 */

import { ORBIT_HELP, Orbit } from "../body/orbit.js";
import { drag, iconButton, make, nameOf, wantsStillness } from "../dom.js";
import { currentFilter, followFilter } from "../filter_switch.js";
import { theFacts } from "../fetched.js";
import { Arrival } from "./arrival.js";
import { Shown } from "./displays.js";
import { filesOf } from "./files.js";
import { derivative } from "./filters.js";
import { Framing, GLIDE_MS, lens, projected } from "./framing.js";
import { theBuilds } from "./builds.js";
import { theBody } from "./mesh.js";
import { FPS, NUM_JOINTS, partlyBack, placed } from "./motion.js";
import { axisCorners, boneCorners, inPanel, line, rigid } from "./bones.js";
import { distance, noisy } from "./noise.js";
import { cells, grid, pairPanels, panels } from "./packing.js";
import { Painter } from "./painter.js";
import { isSoftware, Pace } from "./pace.js";
import { readingOf } from "./reading.js";
import { trailCorners } from "./trail.js";

const FLICKER_MS = 500; // one change in half a second: far below what can do harm to anyone
const BUILDS_LATER_MS = 4000; // after the first body: nothing waits for them
const CAPTION_PX = 8; // between the words and where bodies end
const REST_MS = 180; // after which a picture that stands is drawn in full
const NARROW_PX = 560; // here one body at a time
const BESIDE_PX = 285; // of a window's height, for what must be seen with the stage
const HEIGHTS_PX = [250, 760];
const LOW_PX = 300; // the least of an example and on a phone
const PHONE_SHARE = 0.42; // of a phone's height at most, as the stage stays while one scrolls
const EDITED_PX = 200; // the same beside an editor
const UNDER_PX = 12; // of the window, free under everything
const UNDER_SMALL_PX = 60; // the controls on a phone
const UNDER_LIVE_PX = 116; // displays and the button that keeps it
const SWIPE_PX = 40;
const TAG_PX = 34; // of a body's name, above its picture
/** @type {[number, number, number]} */
const FEET_VIEW = [0, 0.25, 3]; // as Orbit has it
const CLOSE_UP_SIDE = 0.02; // of its width, free at either side: no arm goes over into another's
const NAME_PX = 15; // of the same, under close-ups
const LIST_PX = 400; // less from the left, and a list of files would not be seen whole
const FINGERTIP_M = 0.008; // its radius
/** @type {[number, number[]][]} */
const EXPECTED = [[7, [1, 1, 1]], [5, [0.96, 0.62, 0.04]]]; // half of a mark of where a hand is to be, pixels, and its colour
const SOON_FRAMES = 60; // that are shown next
const VIEW = "front";
const round = (value) => String(Math.round(10 * value) / 10);
const BACKGROUND = [0.894, 0.902, 0.918]; // until the facts have come

export class Stage {
  #player;
  #look;
  #onChange;
  #rows = new Map(); // name -> { row, shown, cell, tips }
  #allRows = new Map(); // the same of all rows of the run, those among them that are not seen now
  #gl;
  #canvas;
  #labels = make("div", { class: "stage-labels" });
  #message = make("p", { class: "said", role: "status", hidden: true });
  #waiting = make("p", { class: "said", role: "status", hidden: true }, "Waiting for the next window of motion.");
  #notice = make("b", { class: "stage-notice", hidden: true });
  #scales = make("span", {});
  #caption = make("p", { class: "stage-caption", hidden: true });
  #ghostLegend = make("span", { class: "ghost-legend", role: "note", hidden: true });
  #handle;
  #mesh = null;
  #builds = null; // by name, once they are there
  /** @type {import("../messages").ViewerConstants} */
  #facts = null;
  #painter = null;
  #framing = null;
  pace; // how coarse they are while it plays
  #frameRequest = 0;
  #rest = 0;
  #fence = null;
  #begun = 0;
  pictures = 0; // drawn so far
  hasCharacter = false; // a visitor's own, whose mesh is shown
  #flicker = null;
  #isSecond = false;
  #wipe = 0.5;
  #large = null;
  #at = 0; // the body that a narrow screen shows
  #words = [];
  #expected = []; // where hands are to be, [side, place from the chest]
  #isRunning = false;
  #noise = 0; // on rotations of bodies that have a space for it, radians
  #glidesUntil = 0; // cameras and bodies, to where they belong now
  orbit = new Orbit();
  mode = "grid";
  pair = [null, null];
  closeUp = "hands";
  closeUps = ["hands", "face", "both", "off"];

  /** Throws an Error that holds a sentence if the browser has no WebGL 2. */
  constructor(player, look, onChange) {
    this.#player = player;
    this.#look = look;
    this.#onChange = onChange;
    const probe = document.createElement("canvas").getContext("webgl2");
    if (!probe) throw new Error("This browser does not support 3D graphics (WebGL 2).");
    const isSlow = isSoftware(probe);
    probe.getExtension("WEBGL_lose_context")?.loseContext();
    this.#canvas = make("canvas", { role: "application", tabindex: "0", "aria-label": `The bodies of this run. ${ORBIT_HELP}`, title: ORBIT_HELP });
    this.#gl = this.#canvas.getContext("webgl2", { alpha: false, antialias: !isSlow });
    this.pace = new Pace(isSlow);
    this.#gl.clearColor(...BACKGROUND, 1);
    this.#gl.clear(this.#gl.COLOR_BUFFER_BIT); // not black until the first picture
    this.#handle = make("div", {
      class: "stage-wipe", role: "slider", tabindex: "0", hidden: true,
      "aria-label": "Position of the wipe", "aria-valuemin": "0", "aria-valuemax": "100",
      onpointerdown: (event) => this.#dragWipe(event),
      onkeydown: (event) => this.#keyWipe(event),
    });
    this.back = make("button", { type: "button", class: "stage-back", hidden: true, onclick: () => this.orbit.reset() }, "Front view");
    this.view = make("div", { class: "stage-view" }, this.#canvas, this.#labels, this.#handle, this.#caption);
    this.under = make("div", { class: "stage-legend" }, this.#message, this.#waiting, this.#notice, this.#scales, this.#ghostLegend, this.back);
    this.element = make("div", { class: "stage" }, this.view, this.under);
    this.orbit.hold(this.#canvas, (event) => event.pointerType === "touch" && this.#isNarrow);
    this.orbit.addEventListener("change", () => {
      this.back.hidden = !this.orbit.isMoved;
      this.#ask();
    });
    look.addEventListener("change", () => this.fit());
    player.addEventListener("time", () => this.#ask());
    player.addEventListener("state", () => this.#showWaiting());
    followFilter(() => this.#ask());
    this.#canvas.addEventListener("pointerdown", (event) => this.#beginSwipe(event));
    new ResizeObserver(() => this.fit()).observe(this.view);
    window.addEventListener("resize", () => this.fit());
    new MutationObserver(() => this.#ask()).observe(document.body, { attributes: true, attributeFilter: ["class"] });
  }

  // -------------------------------------------------------------- what there is

  get names() {
    return [...this.#rows.keys()];
  }

  labelOf(name) {
    return this.#rows.get(name)?.row.label ?? name;
  }

  colorOf(name) {
    return this.#rows.get(name)?.row.color ?? "";
  }

  /** Whether what stands has been drawn in full, and nothing has changed since. */
  get isAtRest() {
    return this.#begun === null && !this.#frameRequest;
  }

  /**
   * Make or complete the bodies of `rows`, and no others; those whose motion is not there yet are
   * named as coming.
   *
   * @param {import("../messages").PlayerRow[]} rows
   * @param {boolean} isRunning Whether more of them is being made.
   */
  show(rows, isRunning = false) {
    for (const row of rows) {
      const entry = this.#allRows.get(row.name);
      if (entry) entry.row = row;
      else this.#allRows.set(row.name, { row, shown: null, clean: null, error: 0, place: null, moved: null, tips: new Map(), arrival: null, isFollowed: false });
    }
    const isOther = rows.length !== this.#rows.size || this.names.some((name, i) => rows[i].name !== name);
    if (isOther) this.#replace(rows.map(({ name }) => name));
    for (const entry of this.#rows.values()) {
      if (!entry.row.frames) continue;
      entry.arrival ??= new Arrival(entry.row.frames);
      this.#follow(entry);
    }
    this.#isRunning = isRunning;
    this.#tellLimit();
    this.fit();
  }

  /** Have these rows on the stage in place of those that are there. */
  #replace(names) {
    const hadBodies = this.hasBodies;
    const isNew = names.findIndex((name) => !this.#rows.has(name));
    if (hadBodies) this.#at = isNew < 0 ? Math.min(this.#at, names.length - 1) : isNew; // of a narrow screen
    this.#rows = new Map(names.map((name) => [name, this.#allRows.get(name)]));
    if (!this.pair.every((name) => name === null || this.#rows.has(name))) {
      this.pair = [null, null];
      this.setMode("grid");
    }
    if (!this.#rows.has(this.#large)) this.#large = null;
    if (!hadBodies || !this.hasBodies) return;
    this.#frame(true);
    this.fit();
  }

  /** Cameras for the bodies there are. */
  #frame(mayGlide) {
    const isGliding = mayGlide && !wantsStillness();
    const places = this.#present.map(({ shown }) => shown.version(false).places);
    this.#framing = new Framing(this.#mesh, this.#facts, places, isGliding ? this.#framing : null);
    if (isGliding) this.#glidesUntil = performance.now() + GLIDE_MS;
    this.#painter.setBodies(this.#present.length);
    this.element.dataset.bodies = String(this.#present.length);
    this.element.dispatchEvent(new Event("bodies"));
  }

  /** Words of the speech, [start, end, text] in seconds, as captions. */
  setWords(words) {
    this.#words = words;
    this.#ask();
  }

  /** Mark where hands are to be, [side, place] each: metres out, up and forward of the chest. */
  expect(places) {
    if (String(places) === String(this.#expected)) return;
    this.#expected = places;
    this.#ask();
  }

  /** What is in the picture and where, as a video of it is asked for; pixels are those of the page. */
  get picture() {
    const present = this.#present;
    const [width, height] = this.#size;
    const panelOf = ({ view, rect }) => ({ view, rect });
    const isPair = this.mode !== "grid";
    const visible = (isPair ? this.pair.map((name) => this.#rows.get(name)) : this.#visible).filter((entry) => entry?.shown);
    const [, , ...size] = this.#inside(isPair ? [0, 0, width, height] : this.#cells[0].cell);
    const pictures = () => {
      if (!isPair) return [panels([0, 0, size[0], size[1]], this.closeUp, this.#facts.close_ups)];
      const { body, sides } = pairPanels([0, 0, size[0], size[1]], this.closeUp, this.#facts.close_ups);
      return sides.map((side) => [{ view: null, rect: body.rect }, ...side]);
    };
    return {
      bodies: present.map(({ row }) => ({ label: row.label ?? row.name, motionUrl: row.motion ?? "", color: row.color })),
      shown: visible.map((entry) => present.indexOf(entry)),
      columns: grid(this.#visible.length, width, height).columns,
      mode: this.mode,
      wipe: this.#wipe,
      isSmoothed: this.#motionLook.isSmoothed,
      hasCharacter: this.hasCharacter,
      pictureSize: size,
      panels: this.#facts ? pictures().map((picture) => picture.map(panelOf)) : [],
    };
  }

  /** Take in what has come of a motion, again and again until no more is there. */
  async #follow(entry) {
    if (entry.isFollowed) return;
    entry.isFollowed = true;
    try {
      for (let there = null; this.#rows.get(entry.row.name) === entry && there !== entry.row.frames_available; ) {
        ({ frames_available: there } = entry.row);
        const [motion, body, facts] = await Promise.all([entry.arrival.next(there, this.#player.frame + SOON_FRAMES), theBody(), theFacts()]);
        if (this.#rows.get(entry.row.name) !== entry) return; // another run is shown
        if (motion) this.#take(entry, motion, there, this.hasCharacter ? this.#mesh : body, facts);
      }
      this.#say("");
    } catch (error) {
      this.#say(error.message);
    } finally {
      entry.isFollowed = false;
      this.#tellLimit();
    }
  }

  #take(entry, motion, there, mesh, facts) {
    this.#prepare(mesh, facts);
    const isFirst = !entry.shown;
    const isMoved = entry.place && String(entry.place) !== String(there.root_transform);
    entry.moved = isMoved && !wantsStillness() ? { from: entry.place, to: there.root_transform, at: performance.now() } : null;
    entry.place = there.root_transform;
    entry.clean = placed(motion, there.root_transform, mesh.rest.subarray(0, 3));
    this.#disturb(entry);
    this.#frame(!isFirst || this.#coming.length > 0);
    this.fit();
    this.#tellLimit();
  }

  /** Have the noise of the stage on a motion, if it takes any. */
  #disturb(entry) {
    const { row, clean } = entry;
    const motion = row.noise_space && this.#noise ? noisy(clean, row.noise_space, this.#noise, this.#mesh) : clean;
    entry.shown = new Shown(motion, this.#mesh, this.#facts.exaggeration.max_turn);
    entry.tips.clear();
    if (row.noise_space) entry.error = distance(motion, clean, this.#mesh, this.#pointOf("right_middle"));
  }

  /** Pose all bodies that take noise anew, under the cameras that there are. */
  setNoise(rad) {
    this.#noise = rad;
    for (const entry of this.#present) if (entry.row.noise_space) this.#disturb(entry);
    this.element.dispatchEvent(new Event("bodies"));
    this.#ask();
  }

  /** By the space of its noise, how far a body's fingertip is from where it is without noise (root mean square, m). */
  get noiseErrors() {
    return Object.fromEntries(this.#present.map(({ row, error }) => [row.noise_space, error]));
  }

  /**
   * Show a motion that is made as one looks, as far as it goes by now, from cameras of its own. The
   * row is among those of `show`.
   *
   * @param {string} name
   * @param {Shown} shown
   * @param {import("../live/rolling.js").Following} framing
   * @param {import("./mesh.js").Mesh} mesh
   * @param {import("../messages").ViewerConstants} facts
   */
  feed(name, shown, framing, mesh, facts) {
    const entry = this.#rows.get(name);
    const isFirst = !entry.shown;
    this.#prepare(mesh, facts);
    this.#framing = framing;
    entry.shown = shown;
    entry.tips.clear();
    if (!isFirst) return this.#ask();
    this.#painter.setBodies(this.#present.length);
    this.element.dataset.bodies = String(this.#present.length);
    this.fit();
  }

  /**
   * Have all motions move another body from now on; one that `feed` shows is fed anew.
   *
   * @param {import("./mesh.js").Mesh} mesh
   * @param {boolean} hasCharacter Whether it is the visitor's own.
   */
  wear(mesh, hasCharacter) {
    this.hasCharacter = hasCharacter;
    this.#mesh = mesh;
    this.element.dataset.character = hasCharacter ? "own" : "";
    if (!this.#facts) return; // no motion has come yet
    this.#painter = new Painter(this.#gl, mesh, this.#facts, this.pace.isSlow);
    this.#painter.setBodies(this.#present.length);
    const whole = this.#present.filter(({ clean }) => clean);
    for (const entry of whole) {
      this.#disturb(entry);
      entry.tagKey = null; // what can be saved of it
    }
    if (whole.length) this.#frame(false);
    this.fit();
    this.#ask();
  }

  #prepare(mesh, facts) {
    this.#mesh = mesh;
    this.#facts = facts;
    if (this.#painter) return;
    this.#painter = new Painter(this.#gl, mesh, facts, this.pace.isSlow);
    this.#fetchBuilds(this.#look.get("build") === facts.builds.names[0] ? BUILDS_LATER_MS : 0);
  }

  /** Bodies have the mesh's own build until the others are there. */
  async #fetchBuilds(after) {
    await new Promise((done) => setTimeout(done, after));
    try {
      this.#builds = await theBuilds(await theBody(), this.#facts.builds);
      this.element.dataset.builds = String(this.#builds.size);
      this.#ask();
    } catch (error) {
      if (this.#look.get("build") !== this.#facts.builds.names[0]) this.#say(error.message);
    }
  }

  /** Those of which more is to come. */
  get #coming() {
    return [...this.#rows.values()].filter(({ row, shown }) => shown && row.frames_available && shown.length < row.frames_available.num_frames);
  }

  /** The sound waits for bodies that are still being made, and for the first to come from the server. */
  #tellLimit() {
    const coming = this.#coming;
    const isAwaited = !this.hasBodies && (this.#isRunning || [...this.#rows.values()].some(({ isFollowed }) => isFollowed));
    this.#player.setLimit(isAwaited ? 0 : coming.length ? Math.min(...coming.map(({ shown }) => shown.length)) : null);
  }

  /** Those with a motion, in their order. */
  get #present() {
    return [...this.#rows.values()].filter(({ shown }) => shown);
  }

  get hasBodies() {
    return this.#present.length > 0;
  }

  clear() {
    this.setMode("grid");
    this.#rows.clear();
    this.#allRows.clear();
    this.#framing = null;
    this.#large = null;
    this.#at = 0;
    this.#words = [];
    this.pair = [null, null];
    this.#labels.replaceChildren();
    this.#say("");
    delete this.element.dataset.bodies;
  }

  #say(sentence) {
    this.#message.textContent = sentence;
    this.#message.hidden = !sentence;
  }

  // -------------------------------------------------------------- how it is compared

  setCloseUp(name) {
    this.closeUp = name;
    this.fit();
    this.#onChange();
  }

  nextCloseUp() {
    this.setCloseUp(this.closeUps[(this.closeUps.indexOf(this.closeUp) + 1) % this.closeUps.length]);
  }

  setMode(mode) {
    if (mode !== "grid" && this.#rows.size < 2) return;
    this.mode = mode;
    this.element.dataset.mode = mode;
    clearInterval(this.#flicker);
    if (mode !== "grid") {
      const [first, second] = this.#alike();
      this.pair = [this.pair[0] ?? first, this.pair[1] ?? second];
    }
    if (mode === "flicker") this.#flicker = setInterval(() => this.swap(), FLICKER_MS);
    this.fit();
    this.#onChange();
  }

  /** The first two that were made from the same noise, else the first two. */
  #alike() {
    const rows = [...this.#rows.values()].map(({ row }) => row);
    for (const { name, noise_key: key } of rows) {
      const other = rows.find((each) => key && each.noise_key === key && each.name !== name);
      if (other) return [name, other.name];
    }
    return this.names;
  }

  setPair(index, name) {
    const other = 1 - index;
    if (this.pair[other] === name) this.pair[other] = this.pair[index];
    this.pair[index] = name;
    this.fit();
    this.#onChange();
  }

  swap() {
    this.#isSecond = !this.#isSecond;
    this.element.classList.toggle("second", this.#isSecond);
    this.#ask();
  }

  /** Show one body alone, or all again. */
  enlarge(name) {
    if (this.mode !== "grid") this.setMode("grid");
    this.#large = this.#large === name ? null : name;
    this.fit();
    this.#onChange();
  }

  enlargeNumber(number) {
    const name = this.names[number - 1];
    if (name) this.enlarge(name);
  }

  /** What of a body a finding is about, in its close-ups, or by the camera: feet have none. */
  lookAt(name, part) {
    const entry = this.#rows.get(name);
    if (!entry?.shown) return;
    this.#at = this.names.indexOf(name); // on a narrow screen
    this.orbit.reset();
    if (part === "feet") this.#lookAtFeet(entry);
    else if (part && ![part, "both"].includes(this.closeUp)) this.setCloseUp(part);
    this.fit();
  }

  /** From near and a little above, so that the floor is seen. */
  #lookAtFeet(entry) {
    this.#look.set("isWhole", true);
    const [{ rect, view }] = panels(this.#inside(this.#cells[0].cell), this.closeUp, this.#facts.close_ups);
    this.orbit.place(FEET_VIEW);
    const { axes, eye } = this.#cameraOf({ view }, entry, this.#moment, rect[2] / rect[3]);
    const world = entry.shown.world(this.#moment, this.#motionLook);
    const [left, other] = ["left_foot", "right_foot"].map((name) => rigid(world, this.#mesh.names.indexOf(name), [0, 0, 0]));
    const middle = left.map((part, k) => (part + other[k]) / 2);
    middle[1] = Math.max(middle[1], this.#framing.floor);
    const [right, up] = axes.slice(0, 2).map((axis) => axis.reduce((sum, part, k) => sum + part * (middle[k] - eye[k]), 0));
    this.orbit.place([...FEET_VIEW, right, up]);
  }

  // -------------------------------------------------------------- room

  get #isNarrow() {
    return this.view.clientWidth < NARROW_PX && this.#rows.size > 1 && !this.element.closest(".opening"); // which shows two
  }

  /** Bodies of the grid that are visible. */
  get #visible() {
    const all = [...this.#rows.values()];
    const large = this.#rows.get(this.#large);
    if (large) return [large];
    if (this.#isNarrow) return [all[Math.min(this.#at, all.length - 1)]];
    return all;
  }

  /** In CSS pixels. */
  get #size() {
    return [this.view.clientWidth, this.view.clientHeight];
  }

  get #cells() {
    const visible = this.#visible;
    const [width, height] = this.#size;
    const { columns } = grid(visible.length, width, height);
    return cells(visible.length, width, height, columns).map((cell, i) => ({ cell, entry: visible[i] }));
  }

  /**
   * What of a cell bodies may take: nothing stands behind their names, or those under close-ups.
   *
   * @param {import("./packing.js").Rect} cell
   * @returns {import("./packing.js").Rect}
   */
  #inside([left, top, width, height], density = 1) {
    const [above, below] = [TAG_PX, this.#isNamedBelow ? NAME_PX : 0].map((px) => Math.round(px * density));
    return [left, top + above, width, height - above - below];
  }

  /** Whose close-ups of two in one place they are, is said under them. */
  get #isNamedBelow() {
    return this.closeUp !== "off" && this.mode !== "grid";
  }

  /** The room of two in one place. */
  #pairPanels([width, height] = this.#size, density = 1) {
    return pairPanels(this.#inside([0, 0, width, height], density), this.closeUp, this.#facts.close_ups);
  }

  /** As high as the window allows. An example, or who speaks, is seen as the page opens; so is the time line with
   * a run whose form makes room, and else a run may be scrolled to. */
  fit() {
    const width = this.view.clientWidth;
    if (!width || !this.#rows.size) return;
    this.#showNotices();
    this.#showGhostLegend();
    const isOpening = !!this.element.closest(".opening");
    const isLive = !!this.element.closest(".live");
    const isSmall = width < NARROW_PX;
    const timeline = isSmall ? null : this.element.closest(".columns.folded")?.querySelector(".timeline");
    const { top, bottom } = this.view.getBoundingClientRect();
    const above = top + window.scrollY + UNDER_PX;
    const [usual, most] = HEIGHTS_PX;
    const player = this.element.closest(".lockstep");
    const least = isSmall || isOpening ? LOW_PX : player?.querySelector(".editing.open") ? EDITED_PX : usual;
    const beside = isLive ? above + UNDER_LIVE_PX : isSmall ? above + UNDER_SMALL_PX : isOpening ? above + UNDER_PX + player.querySelector(".controls").offsetHeight : timeline ? above + timeline.getBoundingClientRect().bottom - bottom : 0;
    const tall = Math.max(Math.min(least, isSmall && !isOpening ? window.innerHeight * PHONE_SHARE : Infinity), Math.min(isSmall && !isOpening && !isLive ? window.innerHeight * PHONE_SHARE : most, window.innerHeight - Math.max(BESIDE_PX, beside)));
    const rows = this.mode === "grid" ? grid(this.#visible.length, width, tall).rows : 1;
    const under = timeline ? 0 : this.element.offsetHeight - this.view.offsetHeight; // what comes there moves no control
    const height = Math.max(tall, rows > 1 ? Math.min(rows * 300, window.innerHeight - 140) : 0) - under;
    this.view.style.height = `${Math.round(height)}px`;
    this.#label();
    this.#ask();
  }

  /** Names over the bodies, and what can be done with each. */
  #label() {
    const [width, height] = this.#size;
    const isPair = this.mode !== "grid";
    const shown = isPair ? [] : this.#cells;
    const below = this.#isNamedBelow ? this.pair.map((name, i) => ({ cell: [(i * width) / 2, 0, width / 2, height], entry: this.#rows.get(name) })) : [];
    const put = (element, { row }, left, top, wide) => {
      Object.assign(element.style, { left: `${(100 * left) / width}%`, top: `${(100 * top) / height}%`, width: `${(100 * wide) / width}%` });
      element.style.setProperty("--series", row.is_reference ? "#1b2733" : row.color);
      element.classList.toggle("opens-right", left < width / 2 && left + wide < LIST_PX);
      return element;
    };
    const named = ({ row }) => make("small", { class: "stage-name", "aria-hidden": "true" }, row.label ?? row.name);
    const focused = /** @type {HTMLElement} */ (this.#labels.contains(document.activeElement) ? document.activeElement : null);
    const name = focused?.closest("[data-name]")?.getAttribute("data-name");
    this.#labels.replaceChildren(
      ...shown.map(({ cell: [left, top, wide], entry }) => put(this.#tag(entry), entry, left, top, wide)),
      ...below.map(({ cell: [left, top, wide, tall], entry }) => put(named(entry), entry, left, top + tall - NAME_PX, wide)),
    );
    const same = focused?.isConnected ? focused : this.#labels.querySelector(`[data-name="${CSS.escape(name ?? "")}"] .enlarge`);
    if (focused) /** @type {HTMLElement} */ (same)?.focus({ preventScroll: true });
    this.#handle.hidden = this.mode !== "wipe" || !this.#facts;
  }

  /** Anew where something about it is other than before: a list of it that is open stays so. */
  #tag(entry) {
    const { row, shown } = entry;
    const key = [row.label, row.motion, row.frames, row.video, row.plan, !shown, this.#large === row.name, this.#rows.size, this.#isNarrow && this.#at].join();
    if (entry.tagKey === key) return entry.tag;
    entry.tagKey = key;
    if (!entry.reading && row.interpretation) entry.reading = readingOf(row);
    const swatch = make("i", { "aria-hidden": "true" });
    const tools = make("span", { class: "tools" }, filesOf(row, this.hasCharacter) ?? "");
    if (this.#rows.size > 1 && !row.noise_space) {
      const isLarge = this.#large === row.name;
      const label = isLarge ? "Show all again" : `Enlarge ${row.label ?? row.name}`;
      tools.append(iconButton("large", label, () => this.enlarge(row.name), { class: "enlarge", "aria-pressed": String(isLarge) }));
    }
    const tag = make("div", { class: "stage-tag", "data-name": row.name }, make("header", {}, swatch, nameOf(row), tools), entry.reading ?? "");
    if (this.#isNarrow && !this.#large) tag.querySelector("header").append(make("small", {}, `${this.#at + 1} of ${this.#rows.size}: swipe`));
    entry.tag = tag;
    if (!shown) tag.append(make("p", { class: "coming" }, row.motion && !row.frames ? "no motion available" : row.frames ? "loading" : "being generated"));
    return tag;
  }

  #showGhostLegend() {
    this.#ghostLegend.hidden = this.mode === "grid";
    if (this.mode === "grid") return;
    const [first, second] = this.pair.map((name) => this.#rows.get(name)?.row);
    if (!first || !second) return;
    const isOther = first.noise_key !== second.noise_key;
    const ofNoise = isOther ? " The motions were generated from different noise, so the gestures differ." : "";
    const how = {
      ghost: `Each body in its own colour; dark where they overlap.${this.#look.get("isAligned") ? " Aligned at the pelvis." : ""}`,
      wipe: "Drag the line.",
      flicker: "Alternating.",
    }[this.mode];
    this.#ghostLegend.textContent = how + ofNoise;
  }

  #showNotices() {
    const factor = this.#look.get("factor");
    this.#notice.hidden = factor === 1;
    this.#notice.textContent = factor === 1 ? "" : `EXAGGERATED x${round(factor)} above ${round(this.#look.get("cutoff"))} Hz`;
    if (!this.#facts) return;
    const { speed } = this.#facts.scales;
    const scale = (colors, words) => {
      const stops = colors.map((color) => `rgb(${color.map((part) => Math.round(255 * part)).join(" ")})`);
      const bar = make("i", { "aria-hidden": "true" });
      bar.style.background = `linear-gradient(90deg, ${stops.join(", ")})`;
      return make("span", {}, bar, words);
    };
    const parts = [];
    if (this.#look.get("hasHeat")) parts.push(scale(this.#facts.marks.heat, `jerk: 0 to ${round(this.#look.get("heatScale"))} m/s³`));
    if (this.#look.get("hasTrail")) parts.push(scale(this.#facts.marks.speed, `speed 0 to ${speed} m/s; dots: jerk over ${round(this.#look.get("heatScale"))} m/s³`));
    this.#scales.replaceChildren(...parts);
  }

  // -------------------------------------------------------------- pictures

  /** A picture as soon as the one before is drawn. */
  #ask() {
    if (this.#frameRequest) return;
    this.#frameRequest = requestAnimationFrame((now) => {
      this.#frameRequest = 0;
      if (!this.view.clientWidth || !this.#framing || this.#gl.isContextLost()) return;
      if (this.#isDrawing(now)) return void this.#ask();
      this.#draw(now, this.pace.level);
      clearTimeout(this.#rest);
      this.#rest = setTimeout(() => this.#drawFully(), REST_MS);
    });
  }

  #drawFully() {
    const isMoving = this.#player.isPlaying && !this.#player.isWaiting;
    if (isMoving || !this.view.clientWidth || !this.#framing || this.#gl.isContextLost()) return;
    this.#draw(null, this.pace.fullLevel);
  }

  /** Whether the last picture is still being drawn; notes how long it took. */
  #isDrawing(now) {
    const gl = this.#gl;
    if (!this.#fence) return false;
    if (gl.getSyncParameter(this.#fence, gl.SYNC_STATUS) !== gl.SIGNALED) return true;
    gl.deleteSync(this.#fence);
    this.#fence = null;
    if (this.#begun === null || !this.#player.isPlaying) return false;
    this.pace.took(now - this.#begun);
    this.element.dispatchEvent(new CustomEvent("drawn", { detail: now - this.#begun })); // ms that it took
    return false;
  }

  /** `begun` is when, or null of a picture whose time says nothing. */
  #draw(begun, level) {
    const gl = this.#gl;
    this.#begun = begun;
    this.pictures += 1;
    const density = level.pixels * (level.isDense ? devicePixelRatio : 1);
    const [width, height] = this.#size.map((size) => Math.max(1, Math.round(size * density)));
    if (this.#canvas.width !== width || this.#canvas.height !== height) [this.#canvas.width, this.#canvas.height] = [width, height];
    const moment = this.#moment;
    this.#painter.setTone(this.#look.get("tone"));
    this.#painter.setBuild((this.hasCharacter ? null : this.#builds?.get(this.#look.get("build"))) ?? this.#mesh);
    this.#pose(moment, level);
    this.element.dataset.backdrop = this.#isDark ? "dark" : "light";
    this.#painter.clear(this.#isDark);
    const size = { width, height, density };
    if (this.mode === "grid") this.#drawGrid(moment, level, size);
    else this.#drawPair(moment, level, size);
    this.#showCaption();
    gl.deleteSync(this.#fence);
    this.#fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    if (performance.now() < this.#glidesUntil) this.#ask();
  }

  get #isDark() {
    return this.mode !== "ghost" && !!this.element.closest(".dark");
  }

  /** What is waited for; all that has come is taken in. */
  #showWaiting() {
    const isWaiting = this.#player.isWaiting && this.hasBodies;
    if (this.#waiting.hidden === isWaiting) {
      this.#waiting.hidden = !isWaiting;
      this.fit(); // it takes or leaves room
    }
    if (!isWaiting) return;
    for (const entry of this.#coming) this.#follow(entry);
    this.#ask();
  }

  /** In frames: between two while it plays, exactly one while it stands. */
  get #moment() {
    return this.#player.isPlaying ? this.#player.time * FPS : this.#player.frame;
  }

  get #motionLook() {
    const get = (name) => this.#look.get(name);
    return { isSmoothed: currentFilter() === "savgol", factor: get("factor"), cutoff: get("cutoff") };
  }

  /** Move what is seen; where the processor draws, faces at every second picture. */
  #pose(moment, { mesh, close, shadow }) {
    const look = this.#motionLook;
    const levels = new Set(this.closeUp === "off" ? [mesh, shadow] : [mesh, close, shadow]);
    const visible = new Set(this.mode === "grid" ? this.#visible : this.pair.map((name) => this.#rows.get(name)));
    for (const [number, entry] of this.#present.entries()) {
      entry.number = number;
      if (!visible.has(entry)) continue;
      const world = glide(entry, entry.shown.world(moment, look));
      if (this.#look.get("hasBones") || this.#look.get("hasAxes") || this.#expected.length) entry.stands = Float32Array.from(world);
      entry.pelvis = [world[3], world[7], world[11]];
      const frame = Math.min(Math.floor(moment), entry.shown.length - 1);
      const jerk = this.#look.get("hasHeat") ? entry.shown.jerk(look.isSmoothed).subarray(NUM_JOINTS * frame, NUM_JOINTS * (frame + 1)) : null;
      const isFaceDue = !this.#player.isPlaying || !this.pace.isSlow || (this.pictures + number) % 2 === 0;
      const faces = isFaceDue ? entry.shown.faces(moment) : null;
      this.#painter.pose(number, world, jerk, faces, levels);
    }
    this.#painter.upload();
  }

  #drawGrid(moment, level, { width, height, density }) {
    for (const { cell, entry } of this.#cells) {
      if (!entry.shown) continue;
      const [left, top, w, h] = cell.map((part) => Math.round(part * density));
      this.#painter.castShadow(entry.number, level.shadow, this.#groundOf(entry, moment));
      for (const panel of panels(this.#inside([left, top, Math.min(w, width - left), Math.min(h, height - top)], density), this.closeUp, this.#facts.close_ups)) this.#drawPanel(panel, entry, moment, level);
    }
  }

  /** Both in the middle, the close-ups of each on its own side. */
  #drawPair(moment, level, { width, height, density }) {
    const [first, second] = this.pair.map((name) => this.#rows.get(name));
    if (!first?.shown || !second?.shown) return;
    const layout = this.#pairPanels([width, height], density);
    const { rect } = layout.body;
    const shift = this.#look.get("isAligned") ? first.pelvis.map((part, k) => (k === 1 ? 0 : part - second.pelvis[k])) : [0, 0, 0];
    const edge = Math.round(rect[0] + this.#wipe * rect[2]);
    const bodies = {
      ghost: [[first, { ink: inkOf(first.row) }], [second, { ink: inkOf(second.row), isOver: true, shift, like: first }]],
      wipe: [[first, { clip: [rect[0], rect[1], edge - rect[0], rect[3]] }], [second, { clip: [edge, rect[1], rect[0] + rect[2] - edge, rect[3]], shift, like: first }]],
      flicker: this.#isSecond ? [[second, { shift, like: first }]] : [[first, {}]],
    }[this.mode];
    for (const [entry, options] of bodies) {
      this.#painter.castShadow(entry.number, level.shadow, this.#groundOf(entry, moment));
      this.#drawPanel({ view: null, rect }, entry, moment, level, options);
    }
    for (const [i, entry] of [first, second].entries()) for (const panel of layout.sides[i]) this.#drawPanel(panel, entry, moment, level);
    Object.assign(this.#handle.style, { left: `${edge / density}px`, top: `${rect[1] / density}px`, height: `${rect[3] / density}px` });
    this.#handle.setAttribute("aria-valuenow", String(Math.round(100 * this.#wipe)));
  }

  /**
   * `like` is whose way the camera goes along with; the rest of `panelOptions` is as Painter.panel has it.
   *
   * @param {{ like?: object, clip?: number[], shift?: number[], ink?: number[], isOver?: boolean }} panelOptions
   */
  #drawPanel(panel, entry, moment, level, panelOptions = {}) {
    const { like = entry, ...options } = panelOptions;
    const [left, top, wide, tall] = panel.rect;
    const side = panel.view ? Math.round(CLOSE_UP_SIDE * wide) : 0;
    const rect = [left + side, top, wide - 2 * side, tall];
    const aspect = rect[2] / tall;
    const camera = this.#cameraOf(panel, like, moment, aspect);
    const matrix = lens(camera, aspect, this.#facts.camera);
    const mesh = panel.view ? level.close : level.mesh;
    const faces = panel.view ? this.#mesh.part(mesh, panel.drawn) : this.#mesh.level(mesh);
    const heat = this.#look.get("hasHeat") ? this.#look.get("heatScale") : 0;
    this.#painter.panel(rect, { matrix, eye: camera.eye, number: entry.number, faces, isWhole: mesh === 0, ground: this.#groundOf(entry, moment), heat, ...options });
    this.#drawBones({ ...panel, rect }, entry, matrix, options);
    const isTrailIn = !panel.view || panel.view === `${this.#look.get("point").split("_")[0]}_hand`;
    if (this.#look.get("hasTrail") && !options.ink && isTrailIn) this.#drawTrail({ rect }, entry, moment, matrix, options);
  }

  /** Skeleton, axes and where hands are to be over the body; `clip` and `shift` as of Painter.panel. */
  #drawBones({ rect, view, drawn }, entry, matrix, { clip = undefined, shift = [0, 0, 0] }) {
    const ink = (corners) => this.#painter.ink(rect, corners, clip);
    /** @type {import("./bones.js").PanelBody} */
    const body = { world: entry.stands, shift, matrix, size: [rect[2], rect[3]], drawn: view && drawn };
    if (this.#look.get("hasBones")) ink(boneCorners(body, this.#mesh.parents));
    if (this.#look.get("hasAxes")) ink(axisCorners(body, this.#fine));
    if (view) return;
    const corners = [];
    for (const [side, [out, up, forward]] of this.#expected) {
      const place = inPanel(body, this.#mesh.names.indexOf("spine3"), [side === "left" ? out : -out, up, forward]);
      for (const [half, color] of EXPECTED) line(corners, place && [place[0] - half, place[1]], place && [place[0] + half, place[1]], 2 * half, color, body.size);
    }
    ink(corners);
  }

  /** Of each joint, whether it is one of many close to each other. */
  get #fine() {
    return this.#mesh.names.map((name) => /index|middle|pinky|ring|thumb|jaw|eye/.test(name));
  }

  #groundOf(entry, moment) {
    return this.#framing.ground(entry.number, frameAt(entry, moment));
  }

  #cameraOf(panel, entry, moment, aspect) {
    const frame = frameAt(entry, moment);
    const at = (track) => [0, 1, 2].map((k) => track[3 * frame + k]);
    if (panel.view) {
      const { axes, eye } = this.#framing.closeUp(panel, aspect);
      const middle = at(this.#framing.track(entry.number, panel));
      return { axes, eye: eye.map((part, k) => part + middle[k]) };
    }
    const { axes, eye } = this.#framing.body(VIEW, aspect, this.#look.get("isWhole"));
    const along = this.#framing.isFollowing ? at(this.#framing.track(entry.number)) : [0, 0, 0];
    const place = eye.map((part, k) => part + along[k]);
    if (!this.orbit.isMoved) return { axes, eye: place };
    const height = this.#framing.floor + this.#facts.framing.middle + along[1];
    const pelvis = this.#framing.isFollowing ? [along[0], height, along[2]] : [this.#framing.centre[0], height, this.#framing.centre[1]];
    return this.orbit.from({ axes, eye: place }, pelvis);
  }

  // -------------------------------------------------------------- the trail

  /** `options` are `clip` and `shift` of Painter.panel. */
  #drawTrail({ rect }, entry, moment, matrix, options) {
    const { clip, shift = [0, 0, 0] } = options;
    const last = Math.min(Math.floor(moment), entry.shown.length - 1);
    const first = Math.max(0, last - this.#look.get("trailFrames"));
    const [, , width, height] = rect;
    const { isSmoothed } = this.#motionLook;
    const plain = { isSmoothed, factor: 1, cutoff: 0 };
    const from = Math.max(0, Math.min(first - 1, entry.shown.length - 4));
    const to = Math.min(entry.shown.length - 1, last + 3);
    const around = new Float32Array(3 * (to - from + 1));
    for (let frame = from; frame <= to; frame++) around.set(this.#tip(entry, frame, plain), 3 * (frame - from));
    const [speed, jerk] = [derivative(around, 1, 1), derivative(around, 1, 3)];
    const [places, speeds, spikes] = [[], [], []];
    for (let frame = first; frame <= last; frame++) {
      const place = projected(matrix, this.#tip(entry, frame, this.#motionLook).map((part, k) => part + shift[k]));
      places.push(place && [place[0] * width, place[1] * height]);
      speeds.push(speed[frame - from] / this.#facts.scales.speed);
      spikes.push(jerk[frame - from] > this.#look.get("heatScale"));
    }
    const { speed: colors, spike } = this.#facts.marks;
    const [x, y, z] = this.#tip(entry, last, this.#motionLook);
    const depth = matrix[12] * x + matrix[13] * y + matrix[14] * z + matrix[15];
    const tip = (FINGERTIP_M * height) / (2 * Math.tan(this.#facts.camera.yfov / 2) * Math.max(depth, 1e-3));
    this.#painter.ink(rect, trailCorners({ places, speeds, spikes, width, height, tip, colors, spike }), clip);
  }

  /** Where the followed point is in a frame; a fingertip is rigid with its last joint. */
  #tip(entry, frame, look) {
    const point = this.#look.get("point");
    const key = `${point} ${look.isSmoothed} ${look.factor} ${look.factor === 1 ? 0 : look.cutoff}`;
    if (!entry.tips.has(key)) {
      if (entry.tips.size > 4) entry.tips.clear(); // of looks that somebody slid through
      entry.tips.set(key, new Map());
    }
    const byFrame = entry.tips.get(key);
    if (!byFrame.has(frame)) {
      const world = entry.shown.world(frame, look);
      const { joint, offset } = this.#pointOf(point);
      byFrame.set(frame, rigid(world, joint, offset));
    }
    return byFrame.get(frame);
  }

  /** The joint of a followed point, and where from it the point is. */
  #pointOf(point) {
    const tip = this.#facts.marks.tips[point];
    const joint = tip ? tip.joint : this.#mesh.names.indexOf(point);
    return { joint, offset: [0, 1, 2].map((k) => (tip && !this.hasCharacter ? this.#mesh.positions[3 * this.#mesh.place[tip.vertex] + k] - this.#mesh.rest[3 * joint + k] : 0)) };
  }

  // -------------------------------------------------------------- words, hands, fingers

  #showCaption() {
    const { time } = this.#player;
    const index = this.#look.get("hasWords") ? this.#words.findIndex(([start, end]) => time >= start && time < end) : -1;
    this.#caption.hidden = index < 0;
    if (index < 0) return;
    this.#caption.style.bottom = `${this.#size[1] - this.#captionEnds}px`;
    if (this.#caption.dataset.at === String(index)) return;
    this.#caption.dataset.at = String(index);
    const near = this.#words.slice(Math.max(0, index - 2), index + 3);
    this.#caption.replaceChildren(...near.flatMap((word) => [make(word === this.#words[index] ? "b" : "span", {}, word[2]), " "]));
  }

  /** Over legs rather than heads: the lower end of the first row's bodies. */
  get #captionEnds() {
    const { body } = this.mode === "grid" ? { body: panels(this.#inside(this.#cells[0].cell), this.closeUp, this.#facts.close_ups)[0] } : this.#pairPanels();
    const [, top, , tall] = body.rect;
    return Math.min(top + tall, this.#size[1]) - CAPTION_PX;
  }

  #dragWipe(event) {
    event.preventDefault();
    this.#handle.focus();
    drag(this.#handle, event.pointerId, ({ clientX }) => {
      const [left, , wide] = this.#pairPanels().body.rect;
      this.#wipeTo((clientX - this.view.getBoundingClientRect().left - left) / wide);
    });
  }

  #keyWipe(event) {
    const step = { ArrowLeft: -0.02, ArrowRight: 0.02 }[event.key];
    if (!step) return;
    event.preventDefault();
    event.stopPropagation();
    this.#wipeTo(this.#wipe + step);
  }

  #wipeTo(share) {
    this.#wipe = Math.max(0, Math.min(1, share));
    this.#ask();
  }

  /** On a narrow screen a finger goes from body to body. */
  #beginSwipe({ pointerId, pointerType, clientX }) {
    if (pointerType !== "touch" || !this.#isNarrow || this.mode !== "grid") return;
    const end = (event) => {
      if (event.pointerId !== pointerId) return;
      this.#canvas.removeEventListener("pointerup", end);
      const way = event.clientX - clientX;
      if (Math.abs(way) < SWIPE_PX) return;
      this.showNext(way < 0 ? 1 : -1);
    };
    this.#canvas.addEventListener("pointerup", end);
  }

  /** The next body of a narrow screen. */
  showNext(by) {
    const count = this.#rows.size;
    this.#at = (this.#at + by + count) % count;
    this.fit();
    this.element.dispatchEvent(new CustomEvent("body", { detail: this.names[this.#at] })); // that somebody looks at
  }
}

/** A body that was laid elsewhere a moment ago goes over to its new place. */
function glide(entry, world) {
  if (!entry.moved) return world;
  const left = 1 - Math.min(1, (performance.now() - entry.moved.at) / GLIDE_MS);
  if (!left) entry.moved = null;
  return entry.moved ? partlyBack(world, entry.moved.from, entry.moved.to, left * left * (3 - 2 * left)) : world;
}

function frameAt({ shown }, moment) {
  return Math.max(0, Math.min(Math.floor(moment), shown.length - 1));
}

/** The colour of a motion, 0 to 1. */
function inkOf({ color }) {
  return [1, 3, 5].map((at) => Number.parseInt(color.slice(at, at + 2), 16) / 255);
}
