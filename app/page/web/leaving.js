/**
 * Tells the server that this page is closed on purpose, so that its runs end. A page that only loses its connection, as on a phone that locks, tells
 * nothing, and its run goes on.
 */

const ROUTE = "leave";

/** Called by Gradio's component, whose value is Gradio's name of this page. */
export function mountLeaving(element, props) {
  addEventListener("pagehide", ({ persisted }) => {
    if (!persisted && props.value) navigator.sendBeacon(new URL(ROUTE, document.baseURI), props.value);
  });
}
