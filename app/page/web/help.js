/** Explained words: what their title says on hover, a click, a finger and Enter say too; and lists that close. */

import { make } from "./dom.js";

const TERMS = "abbr[title], .measures th span[title]";
const ROOM_PX = [340, 110]; // of a bubble

export function mountHelp() {
  const bubble = make("div", { class: "help-bubble", role: "status", popover: "auto" }); // Escape and a click elsewhere close it
  document.body.append(bubble);
  const tell = ({ key = "Enter", target }) => {
    const term = key === "Enter" && target instanceof Element ? target.closest(TERMS) : null;
    if (!term) return;
    bubble.textContent = term.getAttribute("title");
    const { left, bottom } = term.getBoundingClientRect();
    Object.assign(bubble.style, { left: `${Math.max(8, Math.min(left, innerWidth - ROOM_PX[0]))}px`, top: `${Math.min(bottom + 4, innerHeight - ROOM_PX[1])}px` });
    bubble.showPopover();
  };
  for (const name of ["click", "keydown"]) document.addEventListener(name, tell);
  // Gradio's lists open at each key that they hear, even at the Tab that leaves them.
  document.addEventListener("keydown", (event) => {
    if (event.key !== "Tab" || !(event.target instanceof Element && event.target.matches("[role=combobox]"))) return;
    event.stopPropagation();
    for (const list of /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll("ul.options"))) list.tabIndex = -1; // it goes, and the focus with it
  }, true);
}
