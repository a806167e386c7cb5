/** Whether plots and measures show motion as generated or filtered: one switch for all of them. */

const NAMES = ["raw", "savgol"];
const listeners = new Set();
let current = "raw";

export function currentFilter() {
  return current;
}

export function setFilter(name) {
  if (!NAMES.includes(name) || name === current) return;
  current = name;
  for (const listener of listeners) listener(name);
}

/** Call `listener(name)` now and at each change. */
export function followFilter(listener) {
  listeners.add(listener);
  listener(current);
}

/** Make all buttons inside of an element that have a data-filter a switch; returns what marks those that come later. */
export function wireSwitch(root) {
  const mark = () => {
    for (const button of root.querySelectorAll("button[data-filter]")) button.setAttribute("aria-pressed", String(button.dataset.filter === current));
  };
  root.addEventListener("click", ({ target }) => setFilter(target.closest("button[data-filter]")?.dataset.filter));
  followFilter(mark);
  return mark;
}
