/** What a part of the page begins by itself when it is first looked at. */

const LOOK_MS = 100;
const PATIENCE_MS = 10_000;
const pressed = new Set();

/** Press the button of that id, once, as soon as it is there. */
export function pressOnce(id) {
  if (pressed.has(id)) return;
  pressed.add(id);
  const begun = performance.now();
  const look = () => {
    const button = document.getElementById(id);
    if (button) button.click();
    else if (performance.now() - begun < PATIENCE_MS) setTimeout(look, LOOK_MS);
  };
  look();
}
