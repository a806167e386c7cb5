/** Small helpers for making elements. */

/**
 * Make an element. Attributes named on... with a function become listeners, `false` and `null`
 * leave an attribute out, `true` gives it without a value.
 */
export function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") element.addEventListener(name.slice(2), value);
    else if (value !== false && value !== null) element.setAttribute(name, value === true ? "" : value);
  }
  element.append(...children);
  return element;
}

const ICONS = {
  play: "M6 4.5v11l9-5.5z",
  pause: "M6 4.5h2.8v11H6zM11.2 4.5H14v11h-2.8z",
  back: "M13 5v10l-7-5zM4.6 5h1.6v10H4.6z",
  forward: "M7 5v10l7-5zM13.8 5h1.6v10h-1.6z",
  loop: "M5 9a5 5 0 0 1 8.6-2.6L12 8h4V4l-1.4 1.4A7 7 0 0 0 3 9zm10 2a5 5 0 0 1-8.6 2.6L8 12H4v4l1.4-1.4A7 7 0 0 0 17 11z",
  sound: "M3 8v4h3l4 3.5v-11L6 8zm9.2-2.3 1-1.3a7 7 0 0 1 0 11.2l-1-1.3a5.4 5.4 0 0 0 0-8.6z",
  silent: "M3 8v4h3l4 3.5v-11L6 8zm9 0 1-1 2 2 2-2 1 1-2 2 2 2-1 1-2-2-2 2-1-1 2-2z",
  left: "M12.5 4.5 7 10l5.5 5.5 1.2-1.2L9.4 10l4.3-4.3z",
  right: "M7.5 4.5 13 10l-5.5 5.5-1.2-1.2 4.3-4.3-4.3-4.3z",
  large: "M3 3h6v2H6.4l3 3L8 9.4l-3-3V9H3zM17 17h-6v-2h2.6l-3-3 1.4-1.4 3 3V11h2z",
  more: "M4 8.4a1.6 1.6 0 1 0 0 3.2 1.6 1.6 0 0 0 0-3.2zm6 0a1.6 1.6 0 1 0 0 3.2 1.6 1.6 0 0 0 0-3.2zm6 0a1.6 1.6 0 1 0 0 3.2 1.6 1.6 0 0 0 0-3.2z",
  save: "M9 3h2v7.2l2.5-2.5L15 9.1 10 14 5 9.1l1.5-1.4L9 10.2zM4 15.5h12v2H4z",
};

/** A picture of 20 x 20 from the set above; it says nothing to a screen reader. */
export function icon(name) {
  const box = document.createElement("span");
  box.className = "icon";
  box.innerHTML = `<svg viewBox="0 0 20 20" aria-hidden="true"><path d="${ICONS[name]}"/></svg>`;
  return box;
}

/** Give a button another picture and another name. */
export function relabel(button, iconName, label) {
  if (button.dataset.icon === iconName) return;
  button.dataset.icon = iconName;
  button.replaceChildren(icon(iconName));
  button.setAttribute("aria-label", label);
  button.title = label;
}

/** A button with a picture. */
export function iconButton(name, label, onclick, attributes = {}) {
  const button = make("button", { type: "button", onclick, ...attributes });
  relabel(button, name, label);
  return button;
}

/** Whether this visitor's system asks that nothing moves by itself. */
export function wantsStillness() {
  return matchMedia("(prefers-reduced-motion: reduce)").matches;
}

/** Wait for the first element of a selector; null if there is none after a minute. */
export async function whenPresent(selector) {
  const until = performance.now() + 60_000;
  let element = document.querySelector(selector);
  while (!element && performance.now() < until) {
    await new Promise((resolve) => setTimeout(resolve, 100));
    element = document.querySelector(selector);
  }
  return element;
}

/** Whether a button can do anything now; where not, it keeps the focus of whoever pressed it. */
export function allow(button, isAllowed) {
  button.setAttribute("aria-disabled", String(!isAllowed));
}

/** Seconds as m:ss.cc */
export function clockText(seconds) {
  const whole = Math.max(0, Math.floor(seconds * 100 + 1e-6));
  const [minutes, rest] = [Math.floor(whole / 6000), whole % 6000];
  return `${minutes}:${String(Math.floor(rest / 100)).padStart(2, "0")}.${String(rest % 100).padStart(2, "0")}`;
}

/** The same to a tenth, as findings say it. */
export const momentText = (seconds) => clockText(Math.round(10 * seconds) / 10).slice(0, -1);

/** Before a label in a box of one line: a word that does not fit goes to the next, out of sight, even the first. */
export const WHOLE = "\u200b";

/**
 * A motion's name as it is shown, with its whole name on hover.
 *
 * @param {{ name: string, label?: string }} row
 */
export function nameOf({ name, label }) {
  return make("b", { title: name }, label ?? name);
}

/** Follow a pointer that is down on an element until it is let go; `end` gets null where it was taken away. */
export function drag(element, pointerId, move, end = (_event) => {}) {
  element.setPointerCapture(pointerId);
  const stop = new AbortController();
  const over = (event) => {
    stop.abort();
    end(event.type === "pointerup" ? event : null);
  };
  element.addEventListener("pointermove", move, { signal: stop.signal });
  for (const name of ["pointerup", "pointercancel"]) element.addEventListener(name, over, { signal: stop.signal });
}

/** What `summary` opens, until it is left or Escape is pressed. */
export function popUp(name, summary, content) {
  const leave = ({ target }) => !box.contains(target) && (box.open = false);
  /** @type {HTMLDetailsElement} */
  const box = make("details", {
    class: name,
    ontoggle: () => (box.open ? document.addEventListener("pointerdown", leave) : document.removeEventListener("pointerdown", leave)),
    onfocusout: ({ relatedTarget }) => relatedTarget && !box.contains(relatedTarget) && (box.open = false),
    onkeydown: (event) => {
      if (event.key !== "Escape" || !box.open) return;
      box.open = false;
      summary.focus();
    },
  });
  box.append(summary, content);
  return box;
}
