/** What a click on the page begins. */

import { wantsStillness, whenPresent } from "./dom.js";

const LAYOUT_SHIFT_MS = 2000; // in which what comes and goes above results moves them

/** Scroll to the results that hold the element of that id, unless their beginning is seen already; focus a `pressed` button again. */
export async function reveal(id, pressed) {
  giveFocusBack(pressed);
  const element = await whenPresent(`#${id}`);
  const results = element?.closest(".results") ?? element;
  const behavior = wantsStillness() ? "auto" : "smooth";
  const look = () => {
    const { top } = results.getBoundingClientRect();
    if (top < 0 || top > innerHeight / 2) results.scrollIntoView({ behavior, block: "start" });
  };
  look();
  const settling = setTimeout(look, LAYOUT_SHIFT_MS);
  for (const act of ["wheel", "touchstart", "pointerdown", "keydown"]) addEventListener(act, () => clearTimeout(settling), { once: true, capture: true, passive: true });
}

/** Focus a button pressed by a key whenever it is enabled again, until anything else is used: disabled, it loses the focus. */
function giveFocusBack(button) {
  if (!button) return; // after a click Space plays, it starts no other run
  const observer = new MutationObserver(() => {
    if (!button.disabled && document.activeElement === document.body) button.focus({ preventScroll: true });
  });
  observer.observe(button, { attributeFilter: ["disabled"] });
  const used = new AbortController();
  const end = ({ type, target }) => {
    if (type === "focusin" && target === button) return;
    observer.disconnect();
    used.abort();
  };
  for (const act of ["pointerdown", "focusin"]) addEventListener(act, end, { signal: used.signal });
}
