/** The browser's Back button goes back among the tabs of the page and the parts of results. */

const SWITCHES = "[role=tab], .parts-bar button";
const CHOSEN = "[aria-selected=true], [aria-pressed=true]";
const chosen = () => [...document.querySelectorAll(SWITCHES)].map((button) => button.matches(CHOSEN));

export function mountBack() {
  let isGoing = false;
  document.addEventListener("click", ({ target, isTrusted }) => {
    const button = isTrusted && !isGoing && target instanceof Element ? target.closest(SWITCHES) : null;
    if (!button || button.matches(CHOSEN)) return;
    history.replaceState({ ...history.state, chosen: before }, "");
    history.pushState({ chosen: null }, "");
  }, true);
  let before = [];
  const note = () => (before = chosen());
  for (const name of ["pointerdown", "keydown"]) document.addEventListener(name, note, true);
  addEventListener("popstate", ({ state }) => {
    if (!state?.chosen) return;
    isGoing = true;
    const buttons = [...document.querySelectorAll(SWITCHES)];
    for (const [at, button] of buttons.entries()) if (state.chosen[at] && button instanceof HTMLElement) button.click();
    isGoing = false;
  });
}
