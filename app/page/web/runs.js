/**
 * The link of a run, copied on click and in the address, so that the page loads it again; the times of a visitor's runs by the visitor's clock; and two
 * of them that are ticked, which the form opens beside each other.
 */

const RUN = "run";
const COPIED_MS = 2000;

/** Copy an address by a button, which says so for a moment. */
async function copyBy(button, href) {
  const words = button.textContent;
  try {
    await navigator.clipboard.writeText(href);
    button.textContent = "Copied";
    setTimeout(() => (button.textContent = words), COPIED_MS);
  } catch {
    prompt(words, href); // a page without https may not write there
  }
}

/** Have the page's address lead to these runs. */
function keep(runs) {
  const url = new URL(location.href);
  if (url.searchParams.getAll(RUN).join() === runs.join()) return;
  url.searchParams.delete(RUN);
  for (const run of runs) url.searchParams.append(RUN, run);
  url.hash = "";
  history.replaceState(history.state, "", url);
}

/** Called by Gradio's component; `watch` tells of new values. */
export function mountRuns(element, props, watch) {
  element.addEventListener("click", ({ target }) => {
    const button = target.closest(".link button");
    if (button) copyBy(button, element.querySelector(".link a").href);
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
    const link = element.querySelector(".link a");
    if (link) keep(new URL(link.href).searchParams.getAll(RUN));
    tick();
  };
  watch("value", () => requestAnimationFrame(show)); // after Gradio has put it there
  show();
}
