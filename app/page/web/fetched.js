/** What the page's modules fetch from its server. */

/** An answer of the server; rejects with an Error that holds a sentence. */
export async function answered(url, options = {}) {
  let answer;
  try {
    answer = await fetch(url, options);
  } catch (cause) {
    throw new Error("The server is not responding. Please reload the page.", { cause });
  }
  if (!answer.ok) throw new Error("The server no longer has this data. Please reload the page.");
  return answer;
}

/** What all parts of a page share, and none fetches twice: the same promise at every call; one that has failed is made anew. */
export function fetchedOnce(get) {
  let fetching = null;
  return (...args) => {
    fetching ??= get(...args).catch((error) => {
      fetching = null;
      throw error;
    });
    return fetching;
  };
}

/**
 * By which numbers videos are drawn, and the stage with them.
 *
 * @type {() => Promise<import("./messages").ViewerConstants>}
 */
export const theFacts = fetchedOnce(async () => (await answered("stage/facts.json")).json());
