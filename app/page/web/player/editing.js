/**
 * Edits of the gestures of a run: what can be done with the one that is chosen on the time line, what
 * can be added, and the sliders of the whole. The server changes the plan and performs it again: a
 * take, that stands beside the one it was made from. Takes are kept, so that undo is the take before.
 */

import { allow, drag, make, popUp, wantsStillness } from "../dom.js";
import { PhaseEnd } from "./ends.js";
import { GesturePalette } from "./gestures.js";
import { capital, indexOfMatchingPhase, kindName, SIDES } from "./plan.js";

const NUDGE_S = 0.1;
const HOLD_S = 0.3;
const LARGER = 1.25;
const HIGHER_M = 0.06;
const FASTER = 1.2;
const DRAG_PX = 6; // less is a click
const EDGE_PX = 6; // at a phase's end, by which a mouse takes hold of it
const EDGE_SHARE = 0.3; // of a narrow phase
const LEAD_S = 1; // played before what has changed
const AFTER_S = 2; // and after it
const MAX_FILE = 2_000_000;
const LOOKS = { "Look left": 20, "Look right": -20 };
/** @type {Record<string, [string, number, number, number, string, number]>} */
const SLIDERS = {
  gestures_per_min: ["Gesture rate", 0, 60, 1, "per minute", 1],
  size_m: ["Gesture size", 0.05, 0.6, 0.01, "cm", 100],
  height_m: ["Gesture height", -0.4, 0.4, 0.01, "cm", 100],
  stroke_s: ["Gesture speed", 0.2, 1, 0.02, "ms per stroke", 1000], // from right to left: short strokes are fast
  both: ["Two-handed gestures", 0, 1, 0.05, "%", 100],
  smile: ["Smile", 0, 1, 0.05, "%", 100],
};
const HINT = "Select a gesture. You can drag a stroke, or the end of any gesture phase.";
const NOTHING = { rows: [], editable: {}, message: "", is_refused: false, is_working: false, suggestions: [] };

export class Editing {
  #player;
  #timeline;
  #send;
  #onShown;
  #onExpected;
  #run = null;
  /** @type {import("../messages").PlanEditorState} */
  #value = NOTHING;
  /** @type {import("../messages").PlayerRow[]} */
  #rows = [];
  #start = null; // the row that edits go on from
  #beside = null;
  #redo = [];
  /** @type {import("../messages").PlanEditorData | null} */
  #editorData = null;
  #editorUrl = null;
  #chosen = null; // a gesture {side, lands}, or {list, at}
  #picked = null; // the phase that was chosen on the time line {list, event}, as it will be
  #queue = [];
  #request = null; // what is being done
  #isBusy = false;
  #coming = null; // the take that is being made
  isOpen = false;

  /**
   * `send` has the server take up `request`; `onShown` is called when other rows are to be seen, `onExpected` with where
   * hands are to be, [side, place] each.
   */
  constructor(player, timeline, { send, onShown, onExpected }) {
    this.#player = player;
    this.#timeline = timeline;
    this.#send = send;
    this.#onShown = onShown;
    this.#onExpected = onExpected;
    this.end = new PhaseEnd(timeline.tiers, {
      secondsAt: (clientX) => timeline.secondsAt(clientX),
      isBusy: () => this.#isBusy || this.#isShowing,
      onMoved: (chosen, from, to) => this.#moveEnd(chosen, from, to),
      onShown: () => this.#showChosen(),
    });
    this.#build();
    timeline.onchoose = (body, chosen, event) => this.#choose(body, chosen, event);
    timeline.onplan = (body, plan) => this.#pickAgain(body, plan);
    timeline.onplanned = () => this.#planned();
    timeline.lanes.addEventListener("pointerdown", (event) => this.#beginDrag(event), true);
    for (const part of [timeline.lanes, this.element]) part.addEventListener("keydown", (event) => this.#key(event), true);
  }

  #build() {
    const button = (label, onclick, title = label) => make("button", { type: "button", title, onclick }, label);
    this.toggle = make("button", { type: "button", class: "toggle", "aria-expanded": "false", onclick: () => this.#open(!this.isOpen) }, "Edit the gestures");
    this.#timeline.tiersHead.append(this.toggle);
    this.status = make("p", { class: "said-of-edits", role: "status" });
    this.offers = make("span", { class: "row" });
    this.undo = button("Undo", () => this.#undo(), "Undo (Ctrl+Z)");
    this.redo = button("Redo", () => this.#doAgain(), "Redo (Ctrl+Shift+Z)");
    this.takes = make("select", { "aria-label": "Version to edit", onchange: () => this.#goOnFrom(this.takes.value) });
    this.besides = make("select", { "aria-label": "Compare with", onchange: () => this.#putBeside(this.besides.value || null) });
    const file = make("input", { type: "file", accept: ".json,.TextGrid,.eaf", "aria-label": "Import a plan", onclick: () => (file.value = ""), onchange: () => file.files.length && this.#take(file.files[0]) });
    const style = popUp("menu", make("summary", {}, "Style and import"), make("div", {}, ...this.#buildStyle(), make("label", { class: "file" }, "Import a plan (.json, .TextGrid, .eaf)", file)));
    this.element = make("section", { class: "editing", hidden: true, "aria-label": "Edit the gestures" }, this.undo, this.redo, this.#buildAdding(button), style, make("label", {}, this.takes, "compared with", this.besides), this.status, this.offers);
    this.#buildPalette(button);
  }

  /** What is done with the gesture that is chosen, in a lane under that of its hand. */
  #buildPalette(button) {
    this.which = make("b", { class: "which" });
    this.endsAt = make("span", { class: "ends-at" });
    this.deletion = button("Delete", () => this.#delete(), "Delete (Del)");
    this.byWord = make("span", { class: "row" }, button("Previous word", () => this.#toWord(-1)), button("Next word", () => this.#toWord(1)));
    this.handButtons = ["left", "right", "both"].map((hands) => make("button", { type: "button", "aria-label": hands === "both" ? "Both hands" : `${capital(hands)} hand`, onclick: () => this.#hands(hands) }, capital(hands)));
    this.ofGesture = make("span", { class: "row" },
      button("Earlier", () => this.#nudge(-NUDGE_S), "Earlier (Shift+Left)"), button("Later", () => this.#nudge(NUDGE_S), "Later (Shift+Right)"), this.byWord,
      button("Hold shorter", () => this.#hold(-HOLD_S)), button("Hold longer", () => this.#hold(HOLD_S)),
      button("Smaller", () => this.#change("size", { size: 1 / LARGER })), button("Larger", () => this.#change("size", { size: LARGER })),
      make("span", { class: "switch", role: "group", "aria-label": "Hand" }, ...this.handButtons),
      popUp("menu", make("summary", {}, "More"), make("div", {}, make("span", { class: "row" },
        button("Lower", () => this.#change("height", { by: -HIGHER_M })), button("Higher", () => this.#change("height", { by: HIGHER_M })),
        button("Slower", () => this.#change("speed", { speed: 1 / FASTER })), button("Faster", () => this.#change("speed", { speed: FASTER }))))));
    this.palette = make("div", { class: "lane palette", role: "group", "aria-label": "Selected gesture" }, make("div", { class: "name" }, this.which), make("div", { class: "row" }, this.deletion, this.ofGesture, this.endsAt));
  }

  #buildAdding(button) {
    const changed = { onchange: () => this.#foresee() };
    this.kinds = new GesturePalette(() => this.#foresee());
    this.places = make("select", { "aria-label": "Where", ...changed });
    this.hands = make("select", { "aria-label": "Hands", ...changed }, ...[["", "default hand"], ["left", "left hand"], ["right", "right hand"], ["both", "both hands"]].map(([value, label]) => make("option", { value }, label)));
    const now = (does, values = {}) => () => this.#ask({ do: does, at: this.#player.time, ...values });
    const looks = Object.entries(LOOKS).map(([label, yaw]) => button(label, now("look", { yaw, pitch: 0 })));
    const head = make("span", { class: "row", role: "group", "aria-label": "At the current time" }, button("Nod", now("nod")), button("Blink", now("blink")), ...looks);
    this.adding = popUp("menu", make("summary", {}, "Add"), make("div", {}, this.kinds.element, make("span", { class: "row" }, this.places, this.hands, button("Add", () => this.#add(), "Add the gesture")), head));
    this.adding.addEventListener("toggle", () => this.#foresee());
    this.#player.addEventListener("time", () => this.adding.open && this.#foresee());
    this.expected = SIDES.map(() => make("i", { class: "event expected" }));
    return this.adding;
  }

  #buildStyle() {
    this.sliders = new Map();
    const sliders = Object.entries(SLIDERS).map(([name, [label, min, max, step, unit, scale]]) => {
      const output = make("output", {});
      const tell = () => input.setAttribute("aria-valuetext", (output.textContent = `${Math.round(scale * Number(input.value))} ${unit}`));
      const input = make("input", { type: "range", min, max, step, "aria-label": label, oninput: tell, onchange: () => this.#ask({ do: "style", [name]: Number(input.value) }) });
      if (name === "stroke_s") input.dir = "rtl";
      this.sliders.set(name, (value) => (document.activeElement !== input || !this.#isBusy) && (input.value = String(value)) && tell());
      return make("label", {}, make("span", {}, label), input, output);
    });
    const excite = make("input", { type: "range", min: -1, max: 1, step: 0.25, value: 0, "aria-label": "Arousal (calm to excited)", onchange: () => (this.#ask({ do: "style", excite: Number(excite.value) }), (excite.value = "0")) });
    return [...sliders, make("label", {}, make("span", {}, "Arousal (calm to excited)"), excite, make("output", {}))];
  }

  /** What the server is asked for, as app/page/tabs.stage.py reads it. */
  get request() {
    return JSON.stringify(this.#request);
  }

  /**
   * Of all rows those that are to be seen: where gestures can be edited the run's own, and while they
   * are the take, what it stands beside, and the one that is being made.
   *
   * @param {import("../messages").PlayerRow[]} rows
   */
  visibleRows(rows) {
    if (!this.#value.rows.length) return rows;
    const own = rows.filter(({ take_number: take }) => !take);
    if (!this.isOpen) return own;
    const wanted = this.#coming ? [this.#start, this.#coming] : [this.#beside, this.#start];
    const visible = wanted.map((name) => rows.find((row) => row.name === name)).filter(Boolean);
    return visible.length ? visible : own;
  }

  /**
   * @param {string | null} run
   * @param {import("../messages").PlanEditorState | null} value
   * @param {import("../messages").PlayerRow[]} rows
   */
  show(run, value, rows) {
    if (run !== this.#run) this.#clear(run);
    this.toggle.hidden = !value?.rows.length;
    this.#value = value ?? NOTHING;
    this.#rows = rows;
    if (!value?.rows.length) return;
    if (!this.#start) this.#start = value.rows[0];
    if (this.#isBusy) this.#say(value.message, value.is_refused, value.suggestions);
    const coming = rows.find(({ name, take_number: take }) => take && !value.editable[name])?.name ?? null;
    const isNew = coming && coming !== this.#coming;
    const made = this.#coming && !coming && value.editable[this.#coming] ? this.#coming : null;
    this.#coming = coming;
    if (isNew) this.#watch();
    if (made) this.#arrived(made);
    if (this.#isBusy && !value.is_working) this.#ended(value.is_refused);
    this.#load();
    this.#update();
  }

  /** What has become of what was asked for, and what can be done instead. */
  #say(sentence, isRefused = false, offers = []) {
    this.status.textContent = sentence;
    this.status.classList.toggle("refused", isRefused);
    const choose = (edits) => () => {
      this.offers.replaceChildren();
      this.#ask(...edits);
    };
    this.offers.replaceChildren(...offers.map(({ label, edits }) => make("button", { type: "button", onclick: choose(edits) }, label)));
  }

  #clear(run) {
    this.#run = run;
    this.#say("");
    this.#start = this.#beside = this.#editorData = this.#editorUrl = this.#chosen = this.#picked = this.#coming = null;
    this.#isShowing = false;
    this.#queue = [];
    this.#redo = [];
    this.#isBusy = false;
    this.#open(false);
  }

  // ------------------------------------------------------------------ takes

  #open(isOpen) {
    this.isOpen = isOpen;
    this.element.hidden = !isOpen;
    this.toggle.setAttribute("aria-expanded", String(isOpen));
    this.toggle.textContent = isOpen ? "Close the editor" : "Edit the gestures";
    this.element.classList.toggle("open", isOpen);
    if (!isOpen) this.end.show(null);
    if (!isOpen) this.palette.remove();
    this.#foresee();
    if (!this.#start) return;
    if (isOpen && !this.#value.editable[this.#start]) this.#flush(true);
    this.#timeline.showBody(isOpen ? this.#start : this.#value.rows[0]);
    this.#onShown();
    this.#update();
  }

  /** Look at what has changed as soon as it comes, again and again. */
  #watch() {
    const [edit] = this.#request?.edits ?? [];
    const moments = [edit?.lands, edit?.ends, edit?.at, this.#editorData?.words[edit?.word]?.[0]].filter(Number.isFinite);
    const from = moments.length ? Math.max(0, Math.min(...moments) - LEAD_S) : 0;
    this.#player.setLoop(moments.length ? [from, Math.min(this.#player.duration, Math.max(...moments) + AFTER_S)] : null);
    this.#player.seek(from);
    if (!wantsStillness()) this.#player.play();
  }

  #arrived(name) {
    this.#redo = [];
    this.#beside = this.#value.editable[name].from;
    this.#start = name;
    this.#isShowing = true;
    this.#player.setLoop(this.#player.loop); // from its start, where it had to wait for what was to come
    this.#timeline.showBody(name).finally(() => this.#planned());
    this.#onShown();
  }

  #goOnFrom(name) {
    this.#start = name;
    if (this.#beside === name) this.#beside = this.#value.editable[name]?.from || null;
    this.#chosen = null;
    this.#timeline.showBody(name);
    if (!this.#value.editable[name]) this.#flush(true);
    this.#load();
    this.#onShown();
    this.#update();
  }

  #putBeside(name) {
    this.#beside = name;
    this.#onShown();
    this.#update();
  }

  #undo() {
    const before = this.#value.editable[this.#start]?.from;
    if (!before || this.#isBusy) return;
    this.#redo.push(this.#start);
    const now = this.#start;
    this.#goOnFrom(before);
    this.#putBeside(this.#value.editable[before]?.from || now);
    this.#tellStart();
  }

  /** Of takes that were there before nothing new is told by the server. */
  #tellStart() {
    if (this.#value.editable[this.#start]) this.#say(`${capital(this.#labelOf(this.#start))}: restored${this.#beside ? `, compared with ${this.#labelOf(this.#beside)}` : ""}.`);
  }

  #labelOf(name) {
    return this.#rows.find((row) => row.name === name)?.label ?? name;
  }

  #doAgain() {
    if (!this.#redo.length || this.#isBusy) return;
    const now = this.#start;
    this.#goOnFrom(this.#redo.pop());
    this.#putBeside(now);
    this.#tellStart();
  }

  async #load() {
    const url = this.#value.editable[this.#start]?.editor ?? null;
    if (url === this.#editorUrl) return;
    this.#editorUrl = url;
    this.#editorData = null;
    if (!url) return;
    const answer = await fetch(url);
    if (!answer.ok || url !== this.#editorUrl) return;
    this.#editorData = await answer.json();
    this.#chooseAgain();
    this.#update();
  }

  // ------------------------------------------------------------------ asking

  /** Have something done to the plan, after what is being done. */
  #ask(...edits) {
    this.#before = [this.#chosen, this.#picked];
    this.#queue.push(...edits);
    if (!this.#isBusy) this.#flush();
    this.#update();
  }

  #flush(isOpening = false) {
    if (this.#isBusy || (!this.#queue.length && !isOpening)) return;
    this.#request = { run: this.#run, source_row: this.#start, edits: this.#queue };
    this.#queue = [];
    this.#isBusy = true;
    this.#send();
  }

  #ended(isRefused) {
    this.#isBusy = false;
    if (isRefused) this.#queue = []; // of a plan that there is not
    if (isRefused) [this.#chosen, this.#picked] = this.#before;
    this.#flush();
    if (!this.#isShowing) this.end.requestDone();
  }

  #before = [null, null]; // what was chosen when the edit was asked for
  #isShowing = false; // that the plan of a take that is there is on its way to the time line

  /** An edit of the gesture that is chosen. */
  #change(does, values) {
    if (!this.#chosen?.side) return;
    const { side, lands } = this.#chosen;
    this.#ask({ do: does, side, lands, ...values });
  }

  #delete() {
    const chosen = this.#chosen;
    if (!chosen) return;
    if (chosen.side) this.#change("delete", {});
    else this.#ask({ do: "remove", list: chosen.list, at: chosen.at });
    this.#chosen = this.#picked = null;
    this.end.show(null);
    this.#update();
  }

  #moveTo(at) {
    const to = Math.max(0, Math.round(1000 * at) / 1000);
    this.#change("move", { at: to });
    this.#follow(to);
  }

  /** What is chosen lands elsewhere. */
  #follow(lands) {
    const by = lands - this.#chosen.lands;
    this.#chosen = { ...this.#chosen, lands };
    if (this.#picked) {
      const { list, event } = this.#picked;
      this.#picked = { list, event: { ...event, start_s: event.start_s + by, end_s: event.end_s + by } };
    }
    this.#update();
  }

  #moveEnd({ list, index }, from, to) {
    const event = this.#timeline.tiers.plan[list][index];
    const at = Math.round(1000 * to) / 1000;
    this.#ask({ do: "end", side: list, ends: from, at });
    this.#picked = { list, event: { ...event, end_s: at } };
    if (event.phase === "stroke" && this.#chosen?.lands === from) this.#chosen = { ...this.#chosen, lands: at };
    this.#update();
  }

  #nudge(by) {
    if (this.#chosen?.side) this.#moveTo(this.#chosen.lands + by);
  }

  #toWord(way) {
    const words = this.#editorData?.words ?? [];
    if (!this.#chosen?.side || !words.length) return;
    const lands = words.map(landsOn);
    const now = this.#chosen.lands;
    const index = way > 0 ? lands.findIndex((at) => at > now + 0.02) : lands.findLastIndex((at) => at < now - 0.02);
    if (index < 0) return;
    this.#change("move", { word: index });
    this.#follow(lands[index]);
  }

  #hold(by) {
    const gesture = this.#gesture;
    if (gesture) this.#change("hold", { hold: Math.max(0, gesture.hold + by) });
  }

  #hands(hands) {
    if (!this.#chosen?.side) return;
    this.#change("hands", { hands });
    if (hands === "both") return;
    this.#chosen = { ...this.#chosen, side: hands };
    if (this.#picked) this.#picked = { ...this.#picked, list: hands };
  }

  #add() {
    const [what, where] = [this.kinds.value, this.places.value];
    const place = where === "" ? { at: Math.round(1000 * this.#player.time) / 1000 } : { word: Number(where) };
    const hands = this.hands.value ? { hands: this.hands.value } : {};
    this.adding.open = false;
    this.#ask({ do: "add", kind: what, ...place, ...hands });
  }

  /** Where the gesture would be that is to be added, before anything is performed. */
  #foresee() {
    const { kinds = {}, places = {}, around: [before, after] = [0, 0], words = [] } = this.#editorData ?? {};
    const isShown = this.isOpen && this.adding.open && !!this.#editorData;
    const hands = this.hands.value || kinds[this.kinds.value];
    const lands = this.places.value === "" ? this.#player.time : landsOn(words[Number(this.places.value)]);
    const made = SIDES.filter((side) => isShown && [side, "both"].includes(hands));
    this.#onExpected(made.map((side) => [side, places[this.kinds.value]]));
    for (const [i, side] of SIDES.entries()) {
      const element = this.expected[i];
      const isMade = made.includes(side);
      element.textContent = kindName(this.kinds.value);
      this.#timeline.tiers.hang(element, isMade ? side : null, () => this.#timeline.tiers.lay(element, { start_s: lands + before, end_s: lands + after }));
    }
  }

  async #take(file) {
    if (file.size > MAX_FILE) {
      this.#say(`${file.name} is ${(file.size / 1e6).toFixed(1)} MB; the limit for a plan is ${MAX_FILE / 1e6} MB.`, true);
      return;
    }
    this.#ask({ do: "plan", name: file.name.slice(-200), text: await file.text() });
  }

  // ------------------------------------------------------------------ choosing

  #isEditable(name) {
    return !!name && (this.#value.rows.includes(name) || name in this.#value.editable);
  }

  #isDropping = false; // a click follows that chooses nothing

  #choose(body, chosen, event) {
    if (!this.isOpen || this.#isDropping || !this.#isEditable(body)) return;
    if (body !== this.#start) this.#goOnFrom(body);
    const { list } = chosen;
    const isHand = list === "left" || list === "right";
    this.#picked = isHand ? { list, event } : null;
    this.end.show(isHand ? chosen : null);
    if (isHand) this.#chosen = this.#gestureAround(list, event);
    else if (["nods", "looks", "blinks"].includes(list)) this.#chosen = { list, at: event.time_s ?? event.start_s };
    else this.#chosen = null;
    this.#update();
  }

  /** The gesture that a phase is part of; null of rests and ways back. */
  #gestureAround(list, event) {
    const gesture = this.#editorData?.gestures.find(({ side, start, end }) => side === list && start < event.end_s - 1e-3 && end > event.start_s + 1e-3);
    return gesture ? { side: gesture.side, lands: gesture.lands } : null;
  }

  /** What of another plan is chosen: the phase that was, if it is there. */
  #pickAgain(body, plan) {
    if (!this.isOpen || !this.#picked || ![this.#start, this.#coming].includes(body)) return null;
    const candidates = this.#isBusy ? [this.#picked, this.#before[1]] : [this.#picked]; // the plan before may be shown anew
    const matches = candidates.filter(Boolean).map(({ list, event }) => ({ list, index: indexOfMatchingPhase(plan[list], event) }));
    return matches.find(({ index }) => index >= 0) ?? null;
  }

  #planned() {
    const { chosen, plan } = this.#timeline.tiers;
    this.#isShowing = false;
    this.end.show(this.isOpen && this.#picked ? chosen : null, true);
    if (this.#isBusy) return; // more is to come
    this.#picked = chosen && this.#picked && { list: chosen.list, event: plan[chosen.list][chosen.index] };
    if (!this.#picked && this.#chosen?.side) this.#chosen = null; // there is no such any more
    this.end.requestDone();
    this.#chooseAgain();
    this.#showChosen();
  }

  /** The gesture of the phase that is chosen: what was asked for may have been mended. */
  #chooseAgain() {
    if (this.#picked && this.#editorData) this.#chosen = this.#gestureAround(this.#picked.list, this.#picked.event);
  }

  /** Selected gesture, as the server tells of it. */
  get #gesture() {
    const chosen = this.#chosen;
    return this.#editorData?.gestures.find(({ side, lands }) => side === chosen?.side && Math.abs(lands - chosen.lands) < 0.01) ?? null;
  }

  /** A stroke that is dragged goes where it is let go; at the end of a phase a mouse drags that. */
  #beginDrag(event) {
    const button = event.target.closest?.("[data-list]");
    if (!this.isOpen || !button || event.button !== 0) return;
    const { right, width } = button.getBoundingClientRect();
    const isHand = !!button.closest(".of-hand");
    if (isHand && event.pointerType === "mouse" && right - event.clientX <= Math.min(EDGE_PX, EDGE_SHARE * width)) {
      button.click();
      if (this.end.selection) return void this.end.drag(event);
    }
    if (!button.classList.contains("stroke")) return;
    const from = event.clientX;
    const move = ({ clientX }) => {
      if (Math.abs(clientX - from) >= DRAG_PX) button.style.transform = `translateX(${clientX - from}px)`;
    };
    drag(button, event.pointerId, move, (up) => {
      button.style.transform = "";
      if (!up || Math.abs(up.clientX - from) < DRAG_PX) return; // a click chooses it
      button.click();
      this.#isDropping = true;
      setTimeout(() => (this.#isDropping = false));
      if (this.#chosen?.side) this.#moveTo(this.#chosen.lands + this.#timeline.secondsAt(up.clientX) - this.#timeline.secondsAt(from));
    });
  }

  #key(event) {
    if (!this.isOpen || event.target.closest("input, select, textarea")) return;
    const isUndo = (event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "z";
    const isRedo = (isUndo && event.shiftKey) || ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "y");
    const focused = event.target.closest("[data-list]");
    const isPlay = event.key === " " && focused?.getAttribute("aria-pressed") === "true"; // it is chosen already
    const does = isRedo ? () => this.#doAgain() : isUndo ? () => this.#undo() : isPlay ? () => this.#player.toggle() : null;
    const ofChosen = { Delete: () => this.#delete(), Backspace: () => this.#delete() }[event.key];
    const nudge = event.shiftKey && { ArrowLeft: -NUDGE_S, ArrowRight: NUDGE_S }[event.key];
    if (!does && ((!ofChosen && !nudge) || event.target === this.end.element)) return;
    event.preventDefault();
    event.stopPropagation();
    if (does) return void does();
    if (focused && focused.getAttribute("aria-pressed") !== "true") focused.click();
    if (nudge) this.#nudge(nudge);
    else ofChosen();
  }

  // ------------------------------------------------------------------ showing

  #update() {
    if (!this.isOpen) return;
    const options = (select, entries, value) => {
      const content = JSON.stringify(entries);
      if (select.dataset.content !== content) select.replaceChildren(...entries.map(([each, words]) => make("option", { value: each }, words)));
      select.dataset.content = content;
      select.value = value;
    };
    const names = [...new Set([...this.#value.rows, ...Object.keys(this.#value.editable)])];
    options(this.takes, names.map((name) => [name, this.#labelOf(name)]), this.#start);
    options(this.besides, [["", "nothing"], ...this.#rows.filter(({ name }) => name !== this.#start && name !== this.#coming).map((row) => [row.name, row.label ?? row.name])], this.#beside ?? "");
    allow(this.undo, !this.#isBusy && !!this.#value.editable[this.#start]?.from);
    allow(this.redo, !this.#isBusy && !!this.#redo.length);
    this.element.setAttribute("aria-busy", String(this.#isBusy));
    this.#showChosen();
    if (!this.#editorData) return;
    this.kinds.offer(Object.keys(this.#editorData.kinds));
    options(this.places, [["", "at the current time"], ...this.#editorData.words.map(([start, , words], i) => [String(i), `on “${words}” (${start.toFixed(1)} s)`])], this.places.value);
    for (const [name, set] of this.sliders) set(this.#editorData.style[name]);
  }

  #showChosen() {
    if (!this.isOpen) return;
    const chosen = this.#chosen;
    const { selection } = this.end;
    const list = chosen?.side ?? chosen?.list ?? selection?.list ?? "right";
    const lane = this.#timeline.tiers.laneOf(list);
    if (lane.nextElementSibling !== this.palette) lane.after(this.palette);
    this.endsAt.textContent = selection ? `${selection.phase} ends at ${selection.seconds.toFixed(2)} s` : chosen ? "" : HINT;
    this.deletion.hidden = this.ofGesture.hidden = !chosen;
    if (!chosen) this.which.textContent = selection ? `${selection.phase}, ${selection.list} hand` : "";
    if (!chosen) return;
    this.ofGesture.hidden = !chosen.side;
    this.byWord.hidden = !this.#editorData?.words.length;
    const gesture = this.#gesture;
    const kind = gesture ? kindName(gesture.kind) || "gesture" : "Gesture";
    const now = gesture && gesture.partner !== null ? "both" : chosen.side;
    this.which.textContent = chosen.side ? `${chosen.lands.toFixed(2)} s: ${kind}, ${now}` : `${chosen.at.toFixed(2)} s: ${chosen.list.slice(0, -1)}`;
    for (const [i, each] of ["left", "right", "both"].entries()) this.handButtons[i].setAttribute("aria-pressed", String(each === now));
  }
}

/**
 * Where on a word a stroke lands; as model/plan/kinds.py has it.
 *
 * @param {import("../messages").TimeSpan} word
 */
function landsOn([start, end]) {
  return start + 0.3 * (end - start);
}
