/** What all parts of a page share, and none fetches twice: the same promise at every call; one that has failed is made anew. */
export function fetchedOnce(get) {
  let fetching = null;
  return (...given) => {
    fetching ??= get(...given).catch((error) => {
      fetching = null;
      throw error;
    });
    return fetching;
  };
}
