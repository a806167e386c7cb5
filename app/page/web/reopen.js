/** A zip that is dropped anywhere on the page, but on a field for files, goes to the tab for motion of one's own: a run opens again. */

import { whenPresent } from "./dom.js";

const FIELD = "#own-motions input[type=file]";

/** Called by Gradio's component, whose value is the name of the tab. */
export function mountReopen(element, props) {
  document.addEventListener("dragover", (event) => isOurs(event) && event.preventDefault());
  document.addEventListener("drop", (event) => {
    if (!isOurs(event)) return;
    event.preventDefault(); // or the browser would leave the page for the file
    const file = [...event.dataTransfer.files].find(({ name }) => /\.zip$/i.test(name));
    if (file) open(file, props.value);
  });
}

/** Whether it is files, and no field wants them. */
function isOurs({ dataTransfer, target }) {
  const field = target instanceof Element ? target.closest(".block")?.querySelector("input[type=file]") : null;
  return !!dataTransfer?.types.includes("Files") && !field;
}

async function open(file, tab) {
  press([...document.querySelectorAll("[role=tab]")].find((each) => each.textContent.trim() === tab));
  await whenPresent("#own-motions");
  press(document.querySelector("#own-motions button[aria-label=Clear]"));
  const input = await whenPresent(FIELD);
  if (!(input instanceof HTMLInputElement)) return;
  const transfer = new DataTransfer();
  transfer.items.add(file);
  input.files = transfer.files;
  input.dispatchEvent(new Event("change", { bubbles: true }));
  if (await whenPresent("#own-motions .file-preview")) press(await whenPresent("#own-start:not([disabled])"));
}

function press(element) {
  if (element instanceof HTMLElement) element.click();
}
