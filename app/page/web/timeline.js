/** Speech, onsets, words and the fingertip of each motion over time, under one cursor. */

import { make, nameOf } from "./dom.js";
import { currentFilter, followFilter, wireSwitch } from "./filter_switch.js";

const CURVES = {
  jerk_m_s3: { label: "Jerk", unit: "m/s³", digits: 0 },
  speed_m_s: { label: "Speed", unit: "m/s", digits: 2 },
};
const WAVE_SHARE = 0.92; // of the lane's height
const NUDGE_S = 0.1; // of a loop's end by key

export class Timeline {
  #player;
  #data = null;
  #rows = [];
  #lanes = new Map(); // name -> { canvas, value, curve }
  #curve = "jerk_m_s3";
  #unfollow;
  #observer = new ResizeObserver(() => this.#draw());

  constructor(player) {
    this.#player = player;
    this.#build();
    player.addEventListener("time", () => this.#showTime());
    player.addEventListener("state", () => this.#showLoop());
    this.#unfollow = followFilter(() => this.#draw());
  }

  #build() {
    this.select = make("select", { "aria-label": "What the plots show", onchange: () => this.#choose(this.select.value) });
    this.select.append(...Object.entries(CURVES).map(([name, { label }]) => make("option", { value: name }, label)));
    const filter = make(
      "div",
      { class: "switch", role: "group", "aria-label": "Filter of plots and measures, for all systems alike" },
      make("button", { type: "button", "data-filter": "raw" }, "As generated"),
      make("button", { type: "button", "data-filter": "savgol" }, "Filtered"),
    );
    wireSwitch(filter);
    this.scale = make("span", { class: "scale" });
    this.lanes = make("div", { class: "lanes", onpointerdown: (event) => this.#press(event) });
    this.cursor = make("div", { class: "cursor", "aria-hidden": "true" });
    this.range = make("div", { class: "range", hidden: true }, ...["Start", "End"].map((name, end) => this.#handle(name, end)));
    this.element = make("div", { class: "timeline", hidden: true }, make("div", { class: "bar" }, this.select, filter, this.scale), this.lanes);
  }

  /** One end of the loop; can be dragged, and moved by arrow keys. */
  #handle(name, end) {
    return make("i", {
      class: `end-${end}`,
      role: "slider",
      tabindex: "0",
      "aria-label": `${name} of the loop`,
      onpointerdown: (event) => this.#drag(event, ({ clientX }) => this.#moveLoop(end, this.#secondsAt(clientX))),
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
    this.#data = data;
    this.#rows = rows.filter(({ name }) => data.curves[name]);
    this.#lanes.clear();
    this.wave = make("canvas", {});
    this.position = make("div", { class: "plot", role: "slider", tabindex: "0", "aria-label": "Position", "aria-valuemin": "0", "aria-valuemax": data.duration_s.toFixed(2) }, this.wave);
    const parts = [];
    if (data.peaks.length) parts.push(this.#lane({ name: "Speech" }, "", this.position));
    if (data.words.length) parts.push(this.#lane({ name: "Words" }, "", this.#words(data)));
    for (const row of this.#rows) {
      const canvas = make("canvas", { role: "img", "aria-label": `${data.point} of ${row.label ?? row.name} over time` });
      const value = make("small", {});
      const lane = this.#lane(row, value, make("div", { class: "plot" }, canvas));
      lane.dataset.name = row.name;
      lane.style.setProperty("--series", row.is_reference ? "var(--reference-ink)" : row.color);
      this.#lanes.set(row.name, { canvas, value });
      parts.push(lane);
    }
    this.lanes.replaceChildren(...parts, this.range, this.cursor);
    this.element.hidden = false;
    this.#observer.disconnect();
    this.#observer.observe(this.lanes);
    this.#draw();
    this.#showLoop();
  }

  clear() {
    this.#observer.disconnect();
    this.#data = null;
    this.#lanes.clear();
    this.lanes.replaceChildren();
    this.element.hidden = true;
  }

  /** For good: nothing is listened to any more. */
  dispose() {
    this.#unfollow();
    this.clear();
  }

  #lane(row, value, plot) {
    return make("div", { class: "lane" }, make("div", { class: "name", title: row.name }, nameOf(row), value), plot);
  }

  #words({ words, duration_s }) {
    const box = make("div", { class: "plot words" });
    for (const [start, end, word] of words) {
      const piece = make("span", { title: word }, word);
      piece.style.left = `${(100 * start) / duration_s}%`;
      piece.style.width = `${(100 * (end - start)) / duration_s}%`;
      box.append(piece);
    }
    return box;
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
    if (this.#data.peaks.length) drawWave(this.wave, this.#data);
    const known = this.#rows.map(({ name }) => this.#curveOf(name)).filter(Boolean);
    const highest = known.reduce((most, { values }) => values.reduce((a, b) => Math.max(a, b), most), 0);
    const { unit, digits } = CURVES[this.#curve];
    const scale = known.length ? `, 0 to ${highest.toFixed(digits)} ${unit} in each lane` : "";
    this.scale.textContent = this.#data.point + scale;
    for (const row of this.#rows) {
      const curve = this.#curveOf(row.name);
      drawCurve(this.#lanes.get(row.name).canvas, curve, highest, this.#data.duration_s);
    }
    this.#showTime();
  }

  #showTime() {
    if (!this.#data) return;
    const { time, frame } = this.#player;
    const { duration_s } = this.#data;
    this.lanes.style.setProperty("--at", String(Math.min(1, time / duration_s)));
    this.position.setAttribute("aria-valuenow", time.toFixed(2));
    this.position.setAttribute("aria-valuetext", `${time.toFixed(2)} s, frame ${frame}`);
    const { unit, digits } = CURVES[this.#curve];
    for (const [name, { value }] of this.#lanes) {
      const curve = this.#curveOf(name);
      const now = curve?.values[Math.round((time - curve.start_s) / curve.step_s)];
      value.textContent = curve ? `${now === undefined ? "–" : now.toFixed(digits)} ${unit}` : "known filtered only";
    }
  }

  #showLoop() {
    const { loop } = this.#player;
    this.range.hidden = !loop || !this.#data;
    if (this.range.hidden) return;
    const { duration_s } = this.#data;
    for (const [end, seconds] of loop.entries()) {
      this.lanes.style.setProperty(`--loop-${end}`, String(Math.min(1, seconds / duration_s)));
      this.range.children[end].setAttribute("aria-valuenow", seconds.toFixed(2));
    }
  }

  #moveLoop(end, seconds) {
    const loop = [...this.#player.loop];
    const shortest = 0.1;
    loop[end] = end ? Math.max(loop[0] + shortest, Math.min(seconds, this.#player.duration)) : Math.max(0, Math.min(seconds, loop[1] - shortest));
    this.#player.setLoop(loop);
  }

  #secondsAt(clientX) {
    const { left, right } = this.lanes.querySelector(".plot").getBoundingClientRect();
    const share = (clientX - left) / (right - left);
    return Math.max(0, Math.min(1, share)) * this.#data.duration_s;
  }

  #press(event) {
    if (event.button !== 0 || !event.target.closest(".plot")) return;
    const seek = ({ clientX }) => this.#player.seek(this.#secondsAt(clientX));
    seek(event);
    this.#drag(event, seek);
  }

  #drag(event, move) {
    event.preventDefault();
    event.stopPropagation();
    const { currentTarget: target } = event;
    target.setPointerCapture(event.pointerId);
    target.addEventListener("pointermove", move);
    const end = () => target.removeEventListener("pointermove", move);
    target.addEventListener("lostpointercapture", end, { once: true });
  }
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

function drawWave(canvas, { peaks, onsets_s, duration_s }) {
  const { context, width, height, style } = freshContext(canvas);
  context.fillStyle = style.getPropertyValue("--wave");
  const step = width / peaks.length;
  for (const [i, peak] of peaks.entries()) {
    const tall = Math.max(1, (WAVE_SHARE * height * peak) / 100);
    context.fillRect(i * step, (height - tall) / 2, Math.max(step * 0.8, 0.5), tall);
  }
  context.fillStyle = style.getPropertyValue("--onset");
  for (const onset of onsets_s) context.fillRect((onset / duration_s) * width, 0, 1, height);
}

function drawCurve(canvas, curve, highest, duration) {
  const { context, width, height, style } = freshContext(canvas);
  if (!curve || !curve.values.length || highest <= 0) return;
  const x = (i) => ((curve.start_s + i * curve.step_s) / duration) * width;
  const y = (value) => height - 1 - (value / highest) * (height - 3);
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
}
