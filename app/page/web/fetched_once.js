/** What all parts of a page share, and none fetches twice. */

/**
 * A function that gives the same promise at every call; one that has failed is made anew.
 *
 * @template T
 * @template {unknown[]} Given
 * @param {(...given: Given) => Promise<T>} get
 * @returns {(...given: Given) => Promise<T>}
 */
export function fetchedOnce(get) {
  /** @type {Promise<T> | null} */
  let fetching = null;
  return (...given) => {
    fetching ??= get(...given).catch((error) => {
      fetching = null;
      throw error;
    });
    return fetching;
  };
}
