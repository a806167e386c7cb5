/** Speech, onsets, words, gestures and the fingertip of each motion over time, under one cursor. */

import { allow, drag, make, momentText, nameOf, WHOLE } from "../dom.js";
import { currentFilter, followFilter, wireSwitch } from "../filter_switch.js";
import { goTo } from "./findings.js";
import { FPS } from "../stage/motion.js";
import { accentsOf, beginOf, ORIGINS } from "./plan.js";
import { Tiers } from "./tiers.js";

const CURVES = {
  jerk_m_s3: { label: "Jerk", unit: "m/s³", digits: 0 },
  speed_m_s: { label: "Speed", unit: "m/s", digits: 2 },
};
const WAVE_SHARE = 0.92; // of the lane's height
const FRAME_S = 1 / FPS;
const NUDGE_S = 0.1; // of a loop's end by key
const LEAST_S = 0.5; // of time on the whole width
const ZOOM = 1.6; // of one key or click
const PAGE = 0.8; // of what is shown, by which one key or click goes on
const PHONES_PX = 60; // of a second, from which phones are shown
const FAR_ABOVE = 1.5; // times the 99th percentile
const NARROW = "(max-width: 600px)";
/** Windows too low for all there is: the form makes room, and tiers but of hands wait for a click. */
export const LOW = "(max-height: 860px)";
const NARROW_S = 8; // that a narrow screen shows at first
const WHEEL_ZOOM = 0.004; // of one pixel of the wheel, as an exponent

const WORDS_FROM = { given: "Words", aligned: "Words (aligned)", recognised: "Words (recognised)" };
const IS_REST = /^rest\b/i; // nothing to be shown of it
/** @type {[RegExp, string][]} */
const PHASES = [[/^prep/i, "preparation"], [/^(stroke|beat)/i, "stroke"], [/^hold|hold$/i, "hold"], [/^(retract|recover)/i, "retraction"]];

export class Timeline {
  #player;
  /** @type {import("../messages").Timeline | null} */
  #data = null;
  /** @type {import("../messages").PlayerRow[]} */
  #rows = [];
  #lanes = new Map(); // name -> { canvas, value, curve }
  #marks = []; // findings
  #tiers = []; // each a lane's box, and [start, end, label] of what stands in it
  #accents = []; // each a moment and its mark
  #curve = "jerk_m_s3";
  #body = null; // whose tiers are shown
  #planUrl = ""; // of none
  /** Called with the row whose tiers are shown, and the event that somebody has chosen of them. */
  onchoose = (_body, _chosen, _event) => {};
  /**
   * Called with the row whose tiers are shown and its plan, before they are: what of it is chosen.
   *
   * @type {(body: string, plan: import("./plan.js").Plan) => import("./plan.js").Chosen | null}
   */
  onplan = () => null;
  /** Called when they are. */
  onplanned = () => {};
  onmark = (_finding) => {};
  #view = [0, 0]; // the seconds that are shown
  #observer = new ResizeObserver(() => this.#draw());

  constructor(player) {
    this.#player = player;
    this.#build();
    player.addEventListener("time", () => this.#follow());
    player.addEventListener("state", () => this.#showLoop());
    followFilter(() => this.#draw());
  }

  #build() {
    this.select = make("select", { "aria-label": "Plotted quantity", onchange: () => this.#choose(this.select.value) });
    this.select.append(...Object.entries(CURVES).map(([name, { label }]) => make("option", { value: name }, label)));
    const filter = make(
      "div",
      { class: "switch", role: "group", "aria-label": "Filter for plots and metrics (all systems)" },
      make("button", { type: "button", "data-filter": "raw" }, "As generated"),
      make("button", { type: "button", "data-filter": "savgol" }, "Filtered"),
    );
    wireSwitch(filter);
    this.scale = make("span", { class: "scale" });
    const button = (label, sign, onclick) => make("button", { type: "button", "aria-label": label, title: label, onclick }, sign);
    this.zooming = make(
      "div",
      { class: "switch zooming", role: "group", "aria-label": "Timeline zoom" },
      button("Zoom in", "+", () => this.zoom(ZOOM)),
      button("Zoom out", "\u2212", () => this.zoom(1 / ZOOM)),
      (this.whole = button("Show the whole clip", "All", () => this.zoom(0))),
      (this.earlier = button("Earlier", "\u2039", () => this.pan(-PAGE))),
      (this.later = button("Later", "\u203a", () => this.pan(PAGE))),
    );
    this.lanes = make("div", { class: "lanes", onpointerdown: (event) => this.#press(event) });
    this.lanes.addEventListener("wheel", (event) => this.#wheel(event), { passive: false });
    this.tiers = new Tiers({ onChoose: (chosen, event, sentence) => this.#explain(chosen, event, sentence) });
    this.bodies = make("select", { "aria-label": "Motion whose tiers are shown", onchange: () => this.showBody(this.bodies.value) });
    this.why = make("p", { class: "why", role: "status" });
    this.more = make("button", { type: "button", title: "Also show head, gaze, face and supporting leg", onclick: () => this.#showRest(this.element.classList.contains("hands-only")) }, "All tiers");
    this.origin = make("span", {});
    this.legend = make("span", { class: "tier-legend", hidden: true }, make("i", { class: "swatch" }), this.origin);
    this.tiersHead = make("div", { class: "tiers-head", hidden: true }, this.bodies, this.legend, this.more, this.why);
    this.more.hidden = true; // of no gestures
    this.cursor = make("div", { class: "cursor", "aria-hidden": "true" });
    this.range = make("div", { class: "range", hidden: true }, ...["Start", "End"].map((name, end) => this.#handle(name, end)));
    this.element = make("div", { class: "timeline", hidden: true }, (this.bar = make("div", { class: "bar" }, this.select, filter, this.zooming, this.scale)), this.tiersHead, this.lanes);
    this.#showRest(!matchMedia(NARROW).matches && !matchMedia(LOW).matches);
  }

  /** One end of the loop; can be dragged, and moved by arrow keys. */
  #handle(name, end) {
    return make("i", {
      class: `end-${end}`,
      role: "slider",
      tabindex: "0",
      "aria-label": `${name} of the loop`,
      onpointerdown: (event) => this.#drag(event, ({ clientX }) => this.#moveLoop(end, this.secondsAt(clientX))),
      onkeydown: (event) => {
        const step = { ArrowLeft: -NUDGE_S, ArrowRight: NUDGE_S }[event.key];
        if (!step) return;
        event.preventDefault();
        event.stopPropagation();
        this.#moveLoop(end, this.#player.loop[end] + step);
      },
    });
  }

  /** Show what the server has worked out; `rows` say how each motion looks. */
  show(data, rows) {
    const isSame = this.#data?.duration_s === data.duration_s; // with another take's curves
    this.#data = data;
    if (!isSame) this.#view = [0, matchMedia(NARROW).matches ? Math.min(data.duration_s, NARROW_S) : data.duration_s];
    const withCurves = rows.filter(({ name }) => data.curves[name]);
    this.#rows = withCurves.filter(({ take_number: take }) => !take).flatMap((row) => [row, ...withCurves.filter(({ take_number: take, original_row: of }) => take && of === row.name)]);
    this.#lanes.clear();
    this.wave = make("canvas", {});
    this.position = make("div", { class: "plot", role: "slider", tabindex: "0", "aria-label": "Position", "aria-valuemin": "0", "aria-valuemax": data.duration_s.toFixed(2) }, this.wave);
    const parts = [];
    if (data.peaks.length) parts.push(this.#lane({ name: "Speech" }, "", this.position));
    this.#tiers = [];
    this.#accents = [];
    const accents = accentsOf(data).map(([at, strength]) => [at, strength, data.accents.length ? "accent" : "accent (detected by the speech encoder)"]);
    if (data.words.length || accents.length) parts.push(this.#spoken(data, accents));
    this.phones = data.phones.length ? this.#tier("Phones", data.phones) : null;
    if (this.phones) parts.push(this.phones);
    for (const [name, phases] of Object.entries(data.gestures)) parts.push(this.#tier(spoken(name), phases.filter(([, , label]) => !IS_REST.test(label)), phaseOf));
    parts.push(...this.tiers.lanes);
    for (const row of this.#rows) {
      const canvas = make("canvas", { role: "img", "aria-label": `${data.point} of ${row.label ?? row.name} over time` });
      const value = make("small", {});
      const lane = this.#lane(row, value, make("div", { class: "plot" }, canvas));
      lane.dataset.name = row.name;
      lane.firstElementChild.addEventListener("click", () => this.showBody(row.name));
      lane.style.setProperty("--series", row.is_reference ? "var(--reference-ink)" : row.color);
      this.#lanes.set(row.name, { canvas, value });
      lane.dataset.take = String(!!row.take_number);
      parts.push(lane);
    }
    const focused = /** @type {HTMLElement | null} */ (document.activeElement);
    this.lanes.replaceChildren(...parts, this.range, this.cursor);
    this.element.hidden = false;
    if (this.lanes.contains(focused)) focused?.focus({ preventScroll: true }); // the lanes of gestures have only moved
    this.know(rows);
    this.tiers.show(this.tiers.plan, this.#speech, this.tiers.chosen);
    this.#observer.disconnect();
    this.#observer.observe(this.lanes);
    this.showTakes(this.#takes);
    this.#draw();
    this.#showLoop();
    this.onplanned(); // what an editor has between the lanes
  }

  #takes = [];

  /** Of edited motions only the lanes of those that are seen. */
  showTakes(visible) {
    this.#takes = visible;
    for (const lane of this.lanes.querySelectorAll("[data-take=true]")) lane.hidden = !visible.includes(lane.dataset.name);
  }

  // ------------------------------------------------------------------ what the bodies do

  /** Whose plans there are; the first that a system performed is shown, none that was found before somebody asks. */
  know(rows) {
    const withPlans = rows.filter(({ plan }) => plan);
    this.plans = new Map([["", ""], ...withPlans.map(({ name, plan }) => [name, plan])]);
    this.planned = new Set(withPlans.filter((row) => row.is_planned).map(({ name }) => name));
    if ([...this.plans.keys()].join() !== [...this.bodies.options].map(({ value }) => value).join()) {
      this.bodies.replaceChildren(make("option", { value: "" }, "No gestures"), ...withPlans.map((row) => make("option", { value: row.name }, row.label ?? row.name)));
    }
    this.tiersHead.hidden = !withPlans.length;
    const name = this.plans.has(this.#body) ? this.#body : withPlans.find((row) => row.is_planned)?.name;
    if (name !== undefined) this.showBody(name);
  }

  /** Show the tiers of one body, if they are known. */
  async showBody(name) {
    const url = this.plans?.get(name);
    if (url === undefined) return;
    this.#body = this.bodies.value = name;
    if (url === this.#planUrl) return;
    this.#planUrl = url;
    if (!url) return void this.#showPlan(null, null);
    const response = await fetch(url);
    if (!response.ok) return; // kept no longer
    /** @type {import("./plan.js").Plan} */
    const plan = { ...(await response.json()), origin: this.planned.has(name) ? "planned" : "detected" };
    if (url === this.#planUrl) this.#showPlan(plan, this.onplan(name, plan));
  }

  #showPlan(plan, chosen) {
    this.legend.hidden = this.more.hidden = !plan;
    this.legend.dataset.origin = plan?.origin ?? "";
    this.origin.textContent = ORIGINS[plan?.origin] ?? "";
    this.tiers.show(plan, this.#speech, chosen);
    this.why.textContent = chosen ? this.tiers.sentence(chosen) : "";
    this.#draw();
    this.onplanned();
  }

  /** What is known of the speech. */
  get #speech() {
    return this.#data ? { words: this.#data.words, accents: accentsOf(this.#data) } : undefined;
  }

  #explain(chosen, event, sentence) {
    this.why.textContent = sentence;
    this.onchoose(this.#body, chosen, event);
    goTo(this.#player, beginOf(event));
  }

  #showRest(isShown) {
    this.element.classList.toggle("hands-only", !isShown);
    this.more.setAttribute("aria-expanded", String(isShown));
    this.#draw();
  }

  /** Flags where findings are worst, on the lane of their motion. */
  mark(findings) {
    this.#marks = findings.filter(({ worst_time_s: at }) => at !== null);
    this.#placeMarks();
  }

  #placeMarks() {
    for (const flag of this.lanes.querySelectorAll(".flag")) flag.remove();
    if (!this.#data) return;
    for (const finding of this.#marks) {
      const { motion_name: name, sentence, worst_time_s: at } = finding;
      const share = this.#share(at);
      const plot = this.#lanes.get(name)?.canvas.parentElement;
      if (!plot || share < 0 || share > 1) continue;
      const label = `${momentText(at)}: ${sentence}`;
      const flag = make("button", { type: "button", class: "flag", title: label, "aria-label": label, onclick: () => this.onmark(finding), onpointerdown: (event) => event.stopPropagation() });
      flag.style.left = `${100 * share}%`;
      plot.append(flag);
    }
  }

  clear() {
    this.#marks = [];
    this.#body = null;
    this.#planUrl = "";
    this.know([]);
    this.#showPlan(null, null);
    this.#observer.disconnect();
    this.#data = null;
    this.#lanes.clear();
    this.lanes.replaceChildren();
    this.element.hidden = true;
  }

  #lane(row, value, plot) {
    return make("div", { class: "lane" }, make("div", { class: "name", title: row.name }, nameOf(row), value), plot);
  }

  /** A lane of labels; `kindOf` says how one of them looks. */
  #tier(name, intervals, kindOf = (_label) => "") {
    const labels = intervals.map(([start, end, label]) => make("span", { class: kindOf(label), title: `${label}, ${start.toFixed(2)} to ${end.toFixed(2)} s` }, WHOLE + label));
    const box = make("div", { class: "plot words" }, ...labels);
    this.#tiers.push([box, intervals]);
    return this.#lane({ name }, "", box);
  }

  /** The words with their accents, either of which may not be known. */
  #spoken({ words, words_origin }, accents) {
    const lane = this.#tier(words.length ? (WORDS_FROM[words_origin] ?? "Words") : "Accents", words);
    const marks = accents.map(([at, strength, what]) => {
      const mark = make("i", { class: "accent", title: `${what}, ${at.toFixed(2)} s, strength ${strength.toFixed(2)}` });
      mark.style.opacity = String(0.4 + 0.6 * inside(strength));
      return mark;
    });
    lane.querySelector(".plot").append(...marks);
    this.#accents = accents.map(([at], i) => [at, marks[i]]);
    return lane;
  }

  #placeTiers() {
    const [from, to] = this.#view;
    for (const [at, mark] of this.#accents) mark.style.left = `${100 * this.#share(at)}%`;
    if (this.phones) this.phones.hidden = this.#plot.clientWidth / (to - from) < PHONES_PX;
    for (const [box, intervals] of this.#tiers) {
      if (box.parentElement.hidden) continue;
      for (const [i, [start, end]] of intervals.entries()) {
        const { style } = box.children[i];
        style.left = `${100 * this.#share(start)}%`;
        style.width = `${100 * (this.#share(end) - this.#share(start))}%`;
      }
    }
  }

  /** Where a moment stands on the width: 0 to 1 if it is shown. */
  #share(seconds) {
    const [start, end] = this.#view;
    return (seconds - start) / (end - start);
  }

  /** Show less time (`factor` above 1) or more around a moment, by itself the present one; 0: all. */
  zoom(factor, around = this.#player.time) {
    if (!this.#data) return;
    const { duration_s } = this.#data;
    const share = inside(this.#share(around));
    const [start, end] = this.#view;
    const length = factor ? Math.max(Math.min(LEAST_S, duration_s), Math.min(duration_s, (end - start) / factor)) : duration_s;
    const moment = start + share * (end - start);
    this.#show(moment - share * length, length);
  }

  /** Go on by so many times what is shown. */
  pan(by) {
    if (!this.#data) return;
    const [start, end] = this.#view;
    this.#show(start + by * (end - start), end - start);
  }

  #show(start, length) {
    const from = Math.max(0, Math.min(start, this.#data.duration_s - length));
    this.#view = [from, from + length];
    this.#draw();
    this.#showLoop();
  }

  get #isWhole() {
    return this.#view[1] - this.#view[0] >= this.#data.duration_s - 1e-6;
  }

  /** With Ctrl, as browsers tell of a pinch on a touchpad too, it zooms; sideways it moves on. */
  #wheel(event) {
    if (!this.#data) return;
    const [start, end] = this.#view;
    const sideways = event.shiftKey ? event.deltaY || event.deltaX : event.deltaX;
    if (event.ctrlKey || event.metaKey) this.zoom(Math.exp(-WHEEL_ZOOM * event.deltaY), this.secondsAt(event.clientX));
    else if (!this.#isWhole && Math.abs(sideways) > Math.abs(event.shiftKey ? 0 : event.deltaY)) {
      this.#show(start + (sideways / this.#plot.clientWidth) * (end - start), end - start);
    } else return; // the page scrolls
    event.preventDefault();
  }

  #choose(curve) {
    this.#curve = curve;
    this.#draw();
  }

  #curveOf(name) {
    return this.#data.curves[name]?.[currentFilter()]?.[this.#curve] ?? null;
  }

  #draw() {
    if (!this.#data || !this.lanes.clientWidth) return;
    allow(this.whole, !this.#isWhole);
    allow(this.earlier, this.#view[0] > 0);
    allow(this.later, this.#view[1] < this.#data.duration_s - 1e-6);
    if (this.#data.peaks.length) drawWave(this.wave, this.#data, (seconds) => this.#share(seconds));
    this.#placeTiers();
    this.tiers.place((seconds) => this.#share(seconds));
    this.#placeMarks();
    const curves = this.#rows.map(({ name }) => this.#curveOf(name)).filter(Boolean);
    const highest = topOf(curves.flatMap(({ values }) => values));
    const { unit, digits } = CURVES[this.#curve];
    const isCut = curves.some(({ values }) => values.some((value) => value > highest));
    const scale = curves.length ? `, to ${highest.toFixed(digits)} ${unit}${isCut ? "; higher peaks are marked" : ""}` : "";
    this.scale.textContent = this.#data.point + scale;
    for (const row of this.#rows) {
      const curve = this.#curveOf(row.name);
      drawCurve(this.#lanes.get(row.name).canvas, curve, highest, (seconds) => this.#share(seconds));
    }
    this.#showTime();
  }

  /** The present moment; where it is not within a frame of what is shown, `isLost`. */
  get #now() {
    const [start, end] = this.#view;
    const seconds = Math.min(this.#player.time, this.#data.duration_s);
    return { seconds, isLost: seconds < start - FRAME_S || seconds > end + FRAME_S };
  }

  /** Turn the page when the present moment leaves it. */
  #follow() {
    if (!this.#data) return;
    const { seconds, isLost } = this.#now;
    if (isLost) this.#show(seconds, this.#view[1] - this.#view[0]);
    else this.#showTime();
  }

  #showTime() {
    if (!this.#data) return;
    const { time, frame } = this.#player;
    const { seconds, isLost } = this.#now;
    this.cursor.hidden = isLost;
    this.lanes.style.setProperty("--at", String(inside(this.#share(seconds))));
    this.tiers.at(seconds);
    this.position.setAttribute("aria-valuenow", time.toFixed(2));
    this.position.setAttribute("aria-valuetext", `${time.toFixed(2)} s, frame ${frame}`);
    const { unit, digits } = CURVES[this.#curve];
    for (const [name, { value }] of this.#lanes) {
      const curve = this.#curveOf(name);
      const now = curve?.values[Math.round((time - curve.start_s) / curve.step_s)];
      value.textContent = curve ? `${now === undefined ? "–" : now.toFixed(digits)} ${unit}` : "filtered motion only";
    }
  }

  #showLoop() {
    const { loop } = this.#player;
    this.range.hidden = !loop || !this.#data || loop[1] < this.#view[0] || loop[0] > this.#view[1];
    if (this.range.hidden) return;
    for (const [end, seconds] of loop.entries()) {
      this.lanes.style.setProperty(`--loop-${end}`, String(inside(this.#share(seconds))));
      this.range.children[end].setAttribute("aria-valuenow", seconds.toFixed(2));
    }
  }

  #moveLoop(end, seconds) {
    const loop = [...this.#player.loop];
    const shortest = 0.1;
    loop[end] = end ? Math.max(loop[0] + shortest, Math.min(seconds, this.#player.duration)) : Math.max(0, Math.min(seconds, loop[1] - shortest));
    this.#player.setLoop(loop);
  }

  /** Any lane's box: all are as wide. */
  get #plot() {
    return /** @type {HTMLElement} */ (this.lanes.querySelector(".lane:not([hidden]) .plot"));
  }

  secondsAt(clientX) {
    const { left, right } = this.#plot.getBoundingClientRect();
    const share = inside((clientX - left) / (right - left));
    const [start, end] = this.#view;
    return start + share * (end - start);
  }

  #press(event) {
    if (event.button !== 0 || !event.target.closest(".plot") || event.target.closest("[data-list]")) return; // something to choose
    const seek = ({ clientX }) => {
      const [seconds, { loop }] = [this.secondsAt(clientX), this.#player];
      if (loop && (seconds < loop[0] || seconds >= loop[1])) this.#player.setLoop(null);
      this.#player.seek(seconds);
    };
    seek(event);
    this.#drag(event, seek);
  }

  /** What a key does; true if it does anything. */
  press(event) {
    const page = { "[": -PAGE, "]": PAGE }[event.key];
    if (page && this.#data && !this.#isWhole) this.pan(page);
    if (page) return true;
    const factor = { "+": ZOOM, "=": ZOOM, "-": 1 / ZOOM, 0: 0 }[event.key];
    if (factor === undefined || event.ctrlKey || event.metaKey || event.altKey || !this.#data) return false;
    this.zoom(factor);
    return true;
  }

  #drag(event, move) {
    event.preventDefault();
    event.stopPropagation();
    drag(event.currentTarget, event.pointerId, move);
  }
}

/** Of a gesture, as Kendon calls it; nothing where its label says nothing of that. */
function phaseOf(label) {
  return PHASES.find(([pattern]) => pattern.test(label))?.[1] ?? "";
}

/** The name of a tier as a person would write it. */
function spoken(name) {
  const words = name.replaceAll("_", " ");
  return words[0].toUpperCase() + words.slice(1);
}

/** A share, 0 to 1. */
function inside(share) {
  return Math.max(0, Math.min(1, share));
}

/** A context as large as its canvas is on this screen, cleared; coordinates are CSS pixels. */
function freshContext(canvas) {
  const { clientWidth: width, clientHeight: height } = canvas;
  const density = window.devicePixelRatio || 1;
  canvas.width = Math.round(width * density);
  canvas.height = Math.round(height * density);
  const context = canvas.getContext("2d");
  context.scale(density, density);
  return { context, width, height, style: getComputedStyle(canvas) };
}

function drawWave(canvas, { peaks, onsets_s, duration_s }, share) {
  const { context, width, height, style } = freshContext(canvas);
  context.fillStyle = style.getPropertyValue("--wave");
  const x = (seconds) => share(seconds) * width;
  const step = x(duration_s / peaks.length) - x(0);
  for (const [i, peak] of peaks.entries()) {
    const tall = Math.max(1, (WAVE_SHARE * height * peak) / 100);
    context.fillRect(x((i * duration_s) / peaks.length), (height - tall) / 2, Math.max(step * 0.8, 0.5), tall);
  }
  context.fillStyle = style.getPropertyValue("--onset");
  for (const onset of onsets_s) context.fillRect(x(onset), 0, 1, height);
}

/** The top of the lanes: the highest value, or the 99th percentile where some peaks are far above it. */
function topOf(values) {
  const ordered = Float64Array.from(values).sort();
  const [most, usual] = [ordered.at(-1) ?? 0, ordered[Math.floor(0.99 * (ordered.length - 1))] ?? 0];
  return usual > 0 && most > FAR_ABOVE * usual ? usual : most;
}

function drawCurve(canvas, curve, highest, share) {
  const { context, width, height, style } = freshContext(canvas);
  if (!curve || !curve.values.length || highest <= 0) return;
  const x = (i) => share(curve.start_s + i * curve.step_s) * width;
  const y = (value) => height - 1 - Math.min(1, value / highest) * (height - 3);
  context.beginPath();
  for (const [i, value] of curve.values.entries()) context.lineTo(x(i), y(value));
  context.strokeStyle = style.getPropertyValue("--series");
  context.lineWidth = 1.2;
  context.lineJoin = "round";
  context.stroke();
  context.lineTo(x(curve.values.length - 1), height);
  context.lineTo(x(0), height);
  context.globalAlpha = 0.13;
  context.fillStyle = context.strokeStyle;
  context.fill();
  context.globalAlpha = 1;
  for (const [i, value] of curve.values.entries()) if (value > highest) context.fillRect(x(i) - 1.5, 0, 3, 5); // a peak that is cut
}
