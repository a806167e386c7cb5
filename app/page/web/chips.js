/** Chips of systems in groups, each ticked as a whole by its name, and what each is when a pointer rests on it. */

import { make, whenPresent } from "./dom.js";

/** Called by Gradio's component: its value says under which field, a sentence by label, and the labels of each group. */
export async function mountChips(element, props) {
  const { field, about, groups } = props.value;
  const box = await whenPresent(`#${field}`); // it may come later
  const chipsOf = (labels) => /** @type {HTMLElement[]} */ ([...box.querySelectorAll("label")]).filter((chip) => labels.includes(chip.textContent.trim()));
  const tick = (labels) => {
    const isTicked = (chip) => chip.querySelector("input").checked;
    const isAll = chipsOf(labels).every(isTicked);
    for (const chip of chipsOf(labels)) if (isTicked(chip) === isAll) chip.click();
  };
  const arrange = () => {
    for (const [label, sentence] of Object.entries(about)) for (const chip of chipsOf([label])) chip.title = sentence;
    for (const [title, labels] of Object.entries(groups)) {
      const [first] = chipsOf(labels);
      if (!first || first.previousElementSibling?.matches("button")) continue;
      first.before(make("button", { type: "button", title: "Select all or none of these systems", onclick: () => tick(labels) }, title));
    }
  };
  arrange();
  new MutationObserver(arrange).observe(box, { childList: true, subtree: true });
}
