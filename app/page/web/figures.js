/** Figures that fill the window on click. */

import { make } from "./dom.js";

export function mountFigures(element) {
  const picture = make("img", { alt: "" });
  const dialog = make(
    "dialog",
    { class: "lightbox", onclick: () => dialog.close() },
    make("button", { type: "button", "aria-label": "Close" }, "×"),
    picture,
  );
  element.after(dialog);
  element.addEventListener("click", ({ target }) => {
    const shown = target.closest("button.zoom")?.querySelector("img");
    if (!shown) return;
    picture.src = shown.src;
    picture.alt = shown.alt;
    dialog.showModal();
  });
}
