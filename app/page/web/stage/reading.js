/** How a file was understood, as chips on its row: each says why, and what it may be instead. */

import { make, popUp } from "../dom.js";

const WORDS = { up: "{} up", facing: "faces {}", units: "{}", rate: "{} fps", hands: "{} hand", rotations: "{}", joints: "{} joints", lag: "{} s late" };

/** A thing and its value in a word or two. */
export function wordsOf(what, value) {
  return value === "none" ? `no ${what}` : (WORDS[what] ?? `${what} {}`).replace("{}", value);
}

/**
 * Chips of a row, those of guesses and of what the user said for themselves; null where nothing was assumed. A choice
 * is told by an event `override`, whose value is null where the user takes back what they said.
 *
 * @param {import("../messages").PlayerRow} row
 */
export function readingOf({ name, label, interpretation }) {
  if (!interpretation?.assumptions.length) return null;
  const isOpen = ({ confidence }) => confidence === "unsure" || confidence === "user";
  const file = { name, kind: interpretation.file_pattern };
  const chips = interpretation.assumptions.filter(isOpen).map((each) => chip(file, wordsOf(each.kind, each.value) + (each.confidence === "unsure" ? "?" : ""), [each]));
  const rest = interpretation.assumptions.filter((each) => !isOpen(each)).sort((one, other) => Number(!one.alternatives.length) - Number(!other.alternatives.length));
  if (rest.length) chips.push(chip(file, "import details", rest));
  return make("div", { class: "reading", role: "group", "aria-label": `How ${label ?? name} was read` }, ...chips);
}

/** @type {(file: { name: string, kind: string }, words: string, read: import("../messages").AssumptionRecord[]) => HTMLElement} */
function chip(file, words, read) {
  const choice = (what, value, text) => {
    const detail = { ...file, what, value };
    const choose = ({ currentTarget }) => currentTarget.dispatchEvent(new CustomEvent("override", { bubbles: true, detail }));
    return make("button", { type: "button", onclick: choose }, text);
  };
  const parts = read.map(({ kind: what, value, reason, confidence, alternatives }) => {
    const choices = alternatives.map((other) => choice(what, other, wordsOf(what, other)));
    if (confidence === "user") choices.push(choice(what, null, "as detected"));
    return make("li", {}, make("p", {}, make("b", {}, wordsOf(what, value)), reason ? `: ${reason}.` : ""), ...choices);
  });
  return popUp("chip", make("summary", {}, words), make("ul", {}, ...parts));
}

/** Things said of files, `NAME:WHAT=VALUE` or `WHAT=VALUE`, apart; a name may have commas. */
function apart(text) {
  const parts = (text.match(/[^=]+=[^,]*|[^=]+$/g) ?? []).map((part) => part.replace(/^[ ,]+|[ ,]+$/g, ""));
  return parts.filter(Boolean).map((part) => {
    const [, name = "", what] = /^(?:(.+):)?([a-z]+)=.+$/.exec(part) ?? [];
    return { name, what, part };
  });
}

/**
 * The form's text of import overrides with one override added or replaced: for all files of the kind, or where others stand beside it
 * of one file alone.
 *
 * @param {string} before
 * @param {{ name: string, kind: string, what: string, value: string | null }} override
 * @param {boolean} isAlone
 */
export function withOverride(before, { name, kind, what, value }, isAlone) {
  const replaced = isAlone || value === null ? [name, kind, ""] : [name];
  const others = apart(before).filter((each) => each.what !== what || !replaced.includes(each.name));
  const parts = others.map(({ part }) => part);
  if (value !== null) parts.push(`${isAlone ? kind : name}:${what}=${value}`);
  return parts.join(",");
}
