/** What each system is, in a sentence when a pointer rests on its chip. */

/** Called by Gradio's component: its value says under which field, and a sentence by label. */
export function mountChips(element, props) {
  const { field, about } = props.value;
  const tell = () => {
    for (const chip of /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll(`#${field} label`))) {
      const sentence = about[chip.textContent.trim()];
      if (sentence) chip.title = sentence;
    }
  };
  tell();
  const box = document.getElementById(field);
  if (box) new MutationObserver(tell).observe(box, { childList: true, subtree: true });
}
