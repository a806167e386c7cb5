/**
 * The link of a run, copied on click; the times of a visitor's runs by the visitor's clock; and two
 * of them that are ticked, which the form opens beside each other.
 */

const COPIED_MS = 2000;

/** Called by Gradio's component; `watch` tells of new values. */
export function mountRuns(element, props, watch) {
  element.addEventListener("click", async ({ target }) => {
    const button = target.closest(".link button");
    if (!button) return;
    const { href } = element.querySelector(".link a");
    const words = button.textContent;
    try {
      await navigator.clipboard.writeText(href);
      button.textContent = "Copied";
      setTimeout(() => (button.textContent = words), COPIED_MS);
    } catch {
      prompt(words, href); // a page without https may not write there
    }
  });
  const tick = () => {
    const button = element.querySelector("form button");
    if (button) button.disabled = element.querySelectorAll("input:checked").length !== 2;
  };
  element.addEventListener("change", tick);
  const show = () => {
    for (const time of element.querySelectorAll("time")) {
      const at = new Date(1000 * Number(time.dataset.at));
      time.dateTime = at.toISOString();
      time.textContent = at.toLocaleTimeString([], { hour: "2-digit", minute: "2-digit" });
    }
    tick();
  };
  watch("value", () => requestAnimationFrame(show)); // after Gradio has put it there
  show();
}
