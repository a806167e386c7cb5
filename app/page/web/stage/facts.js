/** By which numbers videos are drawn, and the stage with them. */

/** @type {Promise<import("../told").Facts> | null} */
let facts = null;

/** The page's one answer; a later call asks again where an earlier one failed. */
export async function theFacts() {
  facts ??= fetch("stage/facts.json").then((answer) => {
    if (!answer.ok) throw new Error("The page is of another version; load it again.");
    return answer.json();
  });
  try {
    return await facts;
  } catch (error) {
    facts = null;
    throw error;
  }
}
