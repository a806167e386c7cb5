/** What a click on the page begins. */

import { found, wantsStillness } from "./dom.js";

const SETTLED_MS = 2000; // in which what comes and goes above results moves them

/** Scroll to the results that hold the element of that id, unless their beginning is seen already. */
export async function reveal(id) {
  const element = await found(`#${id}`);
  const results = element?.closest(".results") ?? element;
  const behavior = wantsStillness() ? "auto" : "smooth";
  const look = () => {
    const { top } = results.getBoundingClientRect();
    if (top < 0 || top > innerHeight / 2) results.scrollIntoView({ behavior, block: "start" });
  };
  look();
  const settling = setTimeout(look, SETTLED_MS);
  for (const act of ["wheel", "touchstart", "pointerdown", "keydown"]) addEventListener(act, () => clearTimeout(settling), { once: true, capture: true, passive: true });
}
