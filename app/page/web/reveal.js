/** Brings what a click has begun into sight, and keeps it there while the page settles. */

const LOOK_MS = 200;
const SETTLED_MS = 10_000;

/**
 * Scroll to the results that hold the element of that id, unless their beginning is seen already.
 * What comes and goes above them may move them for some seconds, until the visitor does something.
 */
export function reveal(id) {
  const place = () => {
    const element = document.getElementById(id);
    return /** @type {HTMLElement} */ (element?.closest(".results")) ?? element;
  };
  const isSeen = (top) => top >= 0 && top < innerHeight / 2;
  const isStill = matchMedia("(prefers-reduced-motion: reduce)").matches;
  let before = null;
  /** @type {ScrollBehavior} */
  let behavior = isStill ? "auto" : "smooth";
  const look = () => {
    const results = place();
    if (!results?.offsetParent) return; // not shown yet
    const { top } = results.getBoundingClientRect();
    const isMoving = before !== null && top !== before;
    before = top;
    if (isMoving || isSeen(top)) return;
    results.scrollIntoView({ behavior, block: "start" });
    behavior = "auto";
  };
  const acted = new AbortController();
  const timer = setInterval(look, LOOK_MS);
  const stop = () => {
    clearInterval(timer);
    acted.abort();
  };
  for (const act of ["wheel", "touchstart", "pointerdown", "keydown"]) {
    addEventListener(act, stop, { signal: acted.signal, capture: true, passive: true });
  }
  setTimeout(stop, SETTLED_MS);
  look();
}
