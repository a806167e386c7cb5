/** By which numbers videos are drawn, and the stage with them. */

import { fetchedOnce } from "../fetched_once.js";

/**
 * The page's one answer; a later call asks again where an earlier one failed.
 *
 * @type {() => Promise<import("../told").Facts>}
 */
export const theFacts = fetchedOnce(async () => {
  const answer = await fetch("stage/facts.json");
  if (!answer.ok) throw new Error("The page is of another version; load it again.");
  return answer.json();
});
