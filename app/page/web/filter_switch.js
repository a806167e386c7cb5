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

/** Call `listener(name)` now and at each change; returns a function that ends that. */
export function followFilter(listener) {
  listeners.add(listener);
  listener(current);
  return () => listeners.delete(listener);
}

/** Make the buttons inside `group`, which have a data-filter each, a switch. */
export function wireSwitch(group) {
  const buttons = [...group.querySelectorAll("button[data-filter]")];
  for (const button of buttons) button.addEventListener("click", () => setFilter(button.dataset.filter));
  return followFilter((name) => {
    for (const button of buttons) button.setAttribute("aria-pressed", String(button.dataset.filter === name));
  });
}
