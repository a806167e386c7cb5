/** An address copied by a button, which says so for a moment. */

const COPIED_MS = 2000;

export async function copyBy(button, href) {
  const words = button.textContent;
  try {
    await navigator.clipboard.writeText(href);
    button.textContent = "Copied";
    setTimeout(() => (button.textContent = words), COPIED_MS);
  } catch {
    prompt(words, href); // a page without https may not write there
  }
}
