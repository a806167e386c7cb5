/** Sets of clips: which of them is to be opened on the stage. */

import { mountFigures } from "./figures.js";

/** Called by Gradio's component. */
export function mountSets(element) {
  mountFigures(element);
  element.addEventListener("click", ({ target }) => {
    const button = target.closest("button.open");
    if (!button) return;
    const root = button.closest(".sets");
    const { sets } = root.dataset;
    const clip = button.dataset.clip ?? button.closest(".any").querySelector("select").value;
    root.asked = JSON.stringify({ sets, clip }); // what the hidden button's run asks for
    element.closest("[role=tabpanel]").querySelector(".clip-start").click();
  });
}
