/** What is seen, in the part of the address behind the #: a link shows the same picture. */

const MARK = "stage";

/** What the page was opened with; null where it says nothing of this. */
export function readHash() {
  const params = new URLSearchParams(location.hash.slice(1));
  return params.has(MARK) ? params : null;
}

/** Have it lead to what is seen; nothing is said where all is as usual. */
export function writeHash(params) {
  if (!location.protocol.startsWith("http")) return; // a file by itself has no address to be shared
  const hash = params.size ? `#${MARK}&${params}` : "";
  if (hash === location.hash || (!hash && !location.hash.startsWith(`#${MARK}`))) return;
  history.replaceState(history.state, "", location.pathname + location.search + hash);
}
