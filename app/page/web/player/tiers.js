/**
 * Draws what a body does over time: a tier for each hand, for head and gaze, face and weight, from
 * the JSON of a plan. It knows no server and no clock; the time line places and lights it.
 */

import { make, WHOLE } from "../dom.js";
import { classOf, labelOf, sentenceOf, TIERS, timesOf, within } from "./plan.js";

const BEFORE = -0.004; // share of the width by which boxes begin before what is shown
const MARK = { nods: "nod", brows: "brow", blinks: "blink" }; // moments, drawn as marks of one width

export class Tiers {
  #onChoose;
  /** @type {import("./plan.js").Plan | null} */
  plan = null;
  #speech = { words: [], accents: [] };
  #tiers; // of TIERS, each with its lane, its box, and its events, { list, index, button }
  #share = (_seconds) => 0;
  #time = 0;
  /** @type {import("./plan.js").Chosen | null} */
  chosen = null;
  #hung = new Map(); // what hangs in tiers beside their events: element -> how it is placed

  /**
   * @param {{ onChoose?: (chosen: import("./plan.js").Chosen, event: object, sentence: string) => void }} options
   *   `onChoose` is called when somebody chooses an event by mouse, finger or key.
   */
  constructor({ onChoose = () => {} } = {}) {
    this.#onChoose = onChoose;
    this.#tiers = TIERS.map((tier) => {
      const box = make("div", { class: "plot tier", role: "group", "aria-label": tier.name });
      const name = make("div", { class: "name" }, make("b", { title: tier.name }, tier.name));
      const lane = make("div", { class: `lane tier-lane ${tier.isHand ? "of-hand" : "of-rest"}`, hidden: true }, name, box);
      box.addEventListener("click", ({ target }) => this.#click(target));
      box.addEventListener("keydown", (event) => this.#key(event));
      return { ...tier, lane, box, events: [] };
    });
  }

  /** What stands among the lanes of the time line, in their order. */
  get lanes() {
    return this.#tiers.map(({ lane }) => lane);
  }

  #elementOf(chosen) {
    return chosen && this.#of(chosen.list).events.find(({ list, index }) => list === chosen.list && index === chosen.index)?.button;
  }

  /**
   * Show a plan in place of what was shown; null shows none. What is chosen stays chosen if it is
   * given again.
   *
   * @param {import("./plan.js").Plan | null} plan
   * @param {{ words: import("../messages").TimeSpan[], accents: [number, number][] }} speech
   * @param {import("./plan.js").Chosen | null} chosen
   */
  show(plan, speech = { words: [], accents: [] }, chosen = null) {
    this.plan = plan;
    this.#speech = speech;
    this.chosen = chosen && plan?.[chosen.list][chosen.index] ? chosen : null;
    const focused = this.#focused;
    for (const tier of this.#tiers) {
      for (const { button } of tier.events) button.remove();
      tier.events = plan ? tier.lists.flatMap((list) => Array.from(plan[list], (_, index) => ({ list, index, button: this.#button({ list, index }) }))) : [];
      tier.box.prepend(...tier.events.map(({ button }) => button));
      tier.lane.hidden = !tier.events.length;
      tier.lane.dataset.origin = plan?.origin ?? "";
    }
    this.#draw();
    if (!focused) return;
    const near = eventsIn(focused.box);
    (this.#elementOf(this.chosen) ?? (near.length ? nearest(near, focused.left) : null))?.focus({ preventScroll: true });
  }

  /** The tier in which an event has the focus, and where that stands; null if none has. */
  get #focused() {
    const at = /** @type {HTMLElement | null} */ (document.activeElement);
    const tier = at?.matches("[data-list]") && this.#tiers.find(({ box }) => box === at.parentElement);
    return tier ? { box: tier.box, left: at.offsetLeft } : null;
  }

  /** Have an element hang in the tier of a list, after its events, and `place` be called whenever moments stand elsewhere; without a list it is taken away. */
  hang(element, list, place = () => {}) {
    this.#hung.delete(element);
    if (!list) return void element.remove();
    this.#hung.set(element, place);
    const { box } = this.#of(list);
    if (element.parentElement !== box) box.append(element);
    place();
  }

  #of(list) {
    return this.#tiers.find(({ lists }) => lists.includes(list));
  }

  /** The lane of a list. */
  laneOf(list) {
    return this.#of(list).lane;
  }

  /** Where a moment stands, 0 to 1 within what is shown. */
  shareOf(seconds) {
    return this.#share(seconds);
  }

  /** Lay the events of a list as if they were at other times; null as they are. */
  preview(list, events) {
    for (const each of this.#of(list).events) if (each.list === list) this.lay(each.button, (events ?? this.plan[list])[each.index]);
  }

  /** Lay everything out: `share` says where a moment stands, 0 to 1 within what is shown. */
  place(share) {
    this.#share = share;
    this.#draw();
  }

  /** Light what happens at a moment. */
  at(seconds) {
    this.#time = seconds;
    this.#light();
  }

  /** As if somebody had chosen it, but that nobody is told; null chooses nothing. */
  choose(chosen) {
    this.#elementOf(this.chosen)?.setAttribute("aria-pressed", "false");
    this.chosen = chosen;
    this.#elementOf(chosen)?.setAttribute("aria-pressed", "true");
    this.#letTab();
  }

  /** Why an event is there, in a sentence. */
  sentence(chosen) {
    return this.plan ? sentenceOf(this.plan, chosen, this.#speech) : "";
  }

  // ------------------------------------------------------------------ drawing

  #draw() {
    if (!this.plan) return;
    for (const { lists } of this.#tiers) for (const list of lists) this.preview(list, null);
    const focused = /** @type {HTMLElement | null} */ (document.activeElement);
    if (focused?.matches("[data-list][hidden]")) eventsIn(focused.parentElement)[0]?.focus({ preventScroll: true });
    for (const place of this.#hung.values()) place();
    this.#letTab();
    this.#light();
  }

  #button(chosen) {
    const { list, index } = chosen;
    const event = this.plan[list][index];
    const sentence = this.sentence(chosen);
    const isChosen = this.chosen?.list === list && this.chosen.index === index;
    return make("button", {
      type: "button", tabindex: "-1", class: `event ${list in MARK ? "mark " : ""}${classOf(list, event)}`,
      "data-list": list, "data-index": index, title: sentence, "aria-label": sentence, "aria-pressed": String(isChosen),
    }, WHOLE + labelOf(list, event));
  }

  /** Put an element where an event is, if that is shown. */
  lay(element, event) {
    const { style } = element;
    const [start, end] = event.time_s === undefined ? timesOf(event) : [event.time_s, event.time_s];
    const from = end > start ? Math.max(BEFORE, this.#share(start)) : this.#share(start); // its label stays in sight
    element.hidden = this.#share(end) < 0 || from > 1;
    style.left = `${100 * from}%`;
    if (end > start) style.width = `${100 * (this.#share(end) - from)}%`;
  }

  #light() {
    if (!this.plan) return;
    for (const { lists, events } of this.#tiers) {
      const now = Object.fromEntries(lists.map((list) => [list, within(this.plan[list], this.#time, this.#time)]));
      for (const { list, index, button } of events) {
        const isNow = index >= now[list][0] && index < now[list][1];
        if (button.classList.contains("now") !== isNow) button.classList.toggle("now", isNow);
      }
    }
  }

  // ------------------------------------------------------------------ choosing

  /** One event of each tier can be reached by Tab: the one that is chosen, else the first. */
  #letTab() {
    for (const { box } of this.#tiers) {
      const all = eventsIn(box);
      const one = all.find((button) => button === document.activeElement) ?? all.find((button) => button.ariaPressed === "true") ?? all[0];
      for (const button of all) button.tabIndex = button === one ? 0 : -1;
    }
  }

  #click(target) {
    const button = target.closest("[data-list]");
    if (!button) return;
    const { list, index } = button.dataset;
    const chosen = /** @type {import("./plan.js").Chosen} */ ({ list, index: Number(index) });
    this.choose(chosen);
    this.#onChoose(chosen, this.plan[chosen.list][chosen.index], this.sentence(chosen));
  }

  /** Arrows go from event to event and from tier to tier; Enter and the space bar choose. */
  #key(event) {
    const button = event.target.closest("[data-list]");
    if (!button || event.ctrlKey || event.metaKey || event.altKey) return;
    const next = this.#beside(button, event.key);
    if (!next) return;
    event.preventDefault();
    event.stopPropagation();
    for (const other of eventsIn(button.parentElement)) other.tabIndex = -1;
    next.tabIndex = 0;
    next.focus();
  }

  #beside(button, key) {
    const shown = this.#tiers.filter(({ lane, box }) => lane.offsetParent && eventsIn(box).length);
    const at = shown.findIndex(({ box }) => box === button.parentElement);
    const inTime = (box) => eventsIn(box).sort((a, b) => a.offsetLeft - b.offsetLeft);
    const own = inTime(shown[at].box);
    const i = own.indexOf(button);
    if (key === "ArrowUp" || key === "ArrowDown") {
      const other = shown[at + (key === "ArrowUp" ? -1 : 1)];
      return other ? nearest(inTime(other.box), button.offsetLeft) : button;
    }
    const to = { ArrowLeft: Math.max(0, i - 1), ArrowRight: Math.min(own.length - 1, i + 1), Home: 0, End: own.length - 1 }[key];
    return to === undefined ? null : own[to];
  }
}

/**
 * That are shown.
 *
 * @returns {HTMLElement[]}
 */
function eventsIn(box) {
  return [...box.querySelectorAll("[data-list]:not([hidden])")];
}

function nearest(buttons, left) {
  return buttons.reduce((best, each) => (Math.abs(each.offsetLeft - left) < Math.abs(best.offsetLeft - left) ? each : best));
}
