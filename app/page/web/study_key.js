/** Nobody leaves the page without the key of their study unless they mean to. */

/** Called by Gradio's component, whose form fetches the key. */
export function mountKey(element) {
  const isWaiting = () => element.isConnected && element.querySelector(".key:not(.fetched)");
  element.addEventListener("submit", () => element.querySelector(".key").classList.add("fetched"));
  window.addEventListener("beforeunload", (event) => {
    if (isWaiting()) event.preventDefault();
  });
}
