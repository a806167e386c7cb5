/** Brings what a click has begun into sight. */

/** Scroll to the results that hold the element of that id, unless their beginning is seen already. */
export function reveal(id) {
  const element = document.getElementById(id);
  const results = element?.closest(".results") ?? element;
  if (!results) return;
  const isSeen = () => {
    const { top } = results.getBoundingClientRect();
    return top >= 0 && top < innerHeight / 2;
  };
  if (isSeen()) return;
  const isStill = matchMedia("(prefers-reduced-motion: reduce)").matches;
  results.scrollIntoView({ behavior: isStill ? "auto" : "smooth", block: "start" });
  // What comes and goes on the way may have moved it.
  const settle = () => isSeen() || results.scrollIntoView({ block: "start" });
  addEventListener("scrollend", settle, { once: true });
}
