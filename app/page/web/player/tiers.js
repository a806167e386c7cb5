/**
 * Draws what a body does over time: a tier for each hand, for head and gaze, face and weight, from
 * the JSON of a plan. It knows no server and no clock; the time line places and lights it.
 */

import { make, WHOLE } from "../dom.js";
import { classOf, labelOf, sentenceOf, TIERS, timesOf, within } from "./plan.js";

const MOST = 600; // boxes in a tier; of more, strokes alone, and of more of these none
const BEFORE = -0.004; // share of the width by which boxes begin before what is shown
const MARK = { nods: "nod", brows: "brow", blinks: "blink" }; // moments, drawn as marks of one width

export class Tiers {
  #onChoose;
  /** @type {import("../told").Plan | null} */
  #plan = null;
  #said = { words: [], accents: [] };
  #tiers; // of TIERS, each with its lane, its box, and its buttons by "list index"
  #share = (_seconds) => 0;
  #view = [0, 0];
  #time = 0;
  /** @type {import("../told").Chosen | null} */
  #chosen = null;
  #hung = new Map(); // what hangs in tiers beside their events: element -> how it is placed

  /**
   * @param {{ onChoose?: (chosen: import("../told").Chosen, event: object, sentence: string) => void }} told
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
      return { ...tier, lane, box, buttons: new Map() };
    });
  }

  /** What stands among the lanes of the time line, in their order. */
  get lanes() {
    return this.#tiers.map(({ lane }) => lane);
  }

  get plan() {
    return this.#plan;
  }

  get chosen() {
    return this.#chosen;
  }

  /** The element of an event, if it is drawn now. */
  elementOf({ list, index }) {
    return this.#of(list)?.buttons.get(`${list} ${index}`) ?? null;
  }

  /**
   * Show a plan in place of what was shown; null shows none. What is chosen stays chosen if it is
   * given again.
   *
   * @param {import("../told").Plan | null} plan
   * @param {{ words: import("../told").Interval[], accents: [number, number][] }} said
   * @param {import("../told").Chosen | null} chosen
   */
  show(plan, said = { words: [], accents: [] }, chosen = null) {
    this.#plan = plan;
    this.#said = said;
    this.#chosen = chosen && plan?.[chosen.list][chosen.index] ? chosen : null;
    const focused = this.#focused;
    for (const { lane, lists, buttons } of this.#tiers) {
      lane.hidden = !plan || !lists.some((list) => plan[list].length);
      lane.dataset.origin = plan?.origin ?? "";
      for (const button of buttons.values()) button.remove();
      buttons.clear();
    }
    this.#draw();
    if (!focused) return;
    const same = this.#chosen && this.elementOf(this.#chosen);
    const near = eventsIn(focused.box);
    (same ?? (near.length ? nearest(near, focused.left) : null))?.focus({ preventScroll: true });
  }

  /** The tier in which an event has the focus, and where that stands; null if none has. */
  get #focused() {
    const at = /** @type {HTMLElement | null} */ (document.activeElement);
    const tier = at?.matches("[data-list]") && this.#tiers.find(({ box }) => box === at.parentElement);
    return tier ? { box: tier.box, left: at.offsetLeft } : null;
  }

  /**
   * Have an element hang in the tier of a list, after its events; without a list it is taken away.
   * `place` is called whenever moments stand elsewhere.
   *
   * @param {HTMLElement} element
   * @param {string | null} list
   * @param {() => void} place
   */
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
    for (const [key, button] of this.#of(list).buttons) {
      const [of, index] = key.split(" ");
      if (of === list) this.lay(button, (events ?? this.#plan[list])[Number(index)]);
    }
  }

  /** Lay everything out: `share` says where a moment stands, 0 to 1 within the `view`. */
  place(share, view) {
    this.#share = share;
    this.#view = view;
    this.#draw();
  }

  /** Light what happens at a moment. */
  at(seconds) {
    this.#time = seconds;
    this.#light();
  }

  /** As if somebody had chosen it, but that nobody is told; null chooses nothing. */
  choose(chosen) {
    const before = this.#chosen && this.elementOf(this.#chosen);
    before?.setAttribute("aria-pressed", "false");
    this.#chosen = chosen;
    if (chosen) this.elementOf(chosen)?.setAttribute("aria-pressed", "true");
    this.#letTab();
  }

  /** Why an event is there, in a sentence. */
  sentence(chosen) {
    return this.#plan ? sentenceOf(this.#plan, chosen, this.#said) : "";
  }

  // ------------------------------------------------------------------ drawing

  #draw() {
    if (!this.#plan) return;
    for (const tier of this.#tiers) {
      if (tier.lane.hidden) continue;
      const seen = this.#seenOf(tier);
      for (const [key, button] of tier.buttons) {
        if (seen.has(key)) continue;
        if (button === document.activeElement) tier.box.querySelector("[data-list]")?.focus({ preventScroll: true });
        button.remove();
        tier.buttons.delete(key);
      }
      for (const [key, chosen] of seen) {
        if (!tier.buttons.has(key)) tier.buttons.set(key, this.#button(chosen));
        this.lay(tier.buttons.get(key), this.#plan[chosen.list][chosen.index]);
      }
      const inOrder = [...seen.keys()].map((key) => tier.buttons.get(key));
      if (inOrder.some((button, i) => tier.box.children[i] !== button)) {
        const focused = inOrder.find((button) => button === document.activeElement);
        const first = [...this.#hung.keys()].find(({ parentElement }) => parentElement === tier.box) ?? null;
        for (const button of inOrder) tier.box.insertBefore(button, first);
        focused?.focus({ preventScroll: true });
      }
    }
    for (const place of this.#hung.values()) place();
    this.#letTab();
    this.#light();
  }

  /** By key what of a tier is within the view, list by list; of too much the strokes. */
  #seenOf({ lists, box }) {
    const [from, to] = this.#view;
    const found = lists.flatMap((list) => {
      const [first, stop] = within(this.#plan[list], from, to);
      return Array.from({ length: stop - first }, (_, i) => ({ list, index: first + i }));
    });
    const strokes = () => found.filter(({ list, index }) => this.#plan[list][index].phase === "stroke");
    const seen = found.length <= MOST ? found : strokes();
    const isTooMuch = found.length > MOST && (seen.length > MOST || !seen.length);
    box.dataset.said = isTooMuch ? "Zoom in to see them." : "";
    return new Map((isTooMuch ? [] : seen).map((chosen) => [`${chosen.list} ${chosen.index}`, chosen]));
  }

  #button(chosen) {
    const { list, index } = chosen;
    const event = this.#plan[list][index];
    const sentence = this.sentence(chosen);
    const isChosen = this.#chosen?.list === list && this.#chosen.index === index;
    return make("button", {
      type: "button", tabindex: "-1", class: `event ${list in MARK ? "mark " : ""}${classOf(list, event)}`,
      "data-list": list, "data-index": index, title: sentence, "aria-label": sentence, "aria-pressed": String(isChosen),
    }, WHOLE + labelOf(list, event));
  }

  /** Put an element where an event is. */
  lay({ style }, event) {
    const [start, end] = event.time_s === undefined ? timesOf(event) : [event.time_s, event.time_s];
    const from = end > start ? Math.max(BEFORE, this.#share(start)) : this.#share(start); // its label stays in sight
    style.left = `${100 * from}%`;
    if (end > start) style.width = `${100 * (this.#share(end) - from)}%`;
  }

  #light() {
    if (!this.#plan) return;
    for (const { lists, buttons, lane } of this.#tiers) {
      if (lane.hidden) continue;
      const now = new Set(lists.flatMap((list) => {
        const [first, stop] = within(this.#plan[list], this.#time, this.#time);
        return Array.from({ length: stop - first }, (_, i) => `${list} ${first + i}`);
      }));
      for (const [key, button] of buttons) if (button.classList.contains("now") !== now.has(key)) button.classList.toggle("now", now.has(key));
    }
  }

  // ------------------------------------------------------------------ choosing

  /** One event of each tier can be reached by Tab: the one that is chosen, else the first. */
  #letTab() {
    for (const { buttons, box } of this.#tiers) {
      const all = [...buttons.values()];
      const one = all.find((button) => button === document.activeElement) ?? box.querySelector("[aria-pressed=true]") ?? all[0];
      for (const button of all) button.tabIndex = button === one ? 0 : -1;
    }
  }

  #click(target) {
    const button = target.closest("[data-list]");
    if (!button) return;
    const { list, index } = button.dataset;
    const chosen = /** @type {import("../told").Chosen} */ ({ list, index: Number(index) });
    this.choose(chosen);
    this.#onChoose(chosen, this.#plan[chosen.list][chosen.index], this.sentence(chosen));
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
    const shown = this.#tiers.filter(({ lane, buttons }) => lane.offsetParent && buttons.size);
    const at = shown.findIndex(({ box }) => box === button.parentElement);
    const inTime = (box) => eventsIn(box).sort((a, b) => a.offsetLeft - b.offsetLeft);
    const own = inTime(shown[at].box);
    const i = own.indexOf(button);
    switch (key) {
      case "ArrowLeft":
        return own[Math.max(0, i - 1)];
      case "ArrowRight":
        return own[Math.min(own.length - 1, i + 1)];
      case "Home":
        return own[0];
      case "End":
        return own.at(-1);
      case "ArrowUp":
      case "ArrowDown": {
        const other = shown[at + (key === "ArrowUp" ? -1 : 1)];
        return other ? nearest(inTime(other.box), button.offsetLeft) : button;
      }
      default:
        return null;
    }
  }
}

/** @returns {HTMLElement[]} */
function eventsIn(box) {
  return [...box.querySelectorAll("[data-list]")];
}

function nearest(buttons, left) {
  return buttons.reduce((best, each) => (Math.abs(each.offsetLeft - left) < Math.abs(best.offsetLeft - left) ? each : best));
}
