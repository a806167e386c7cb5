/** What all parts of a page share is fetched once, and again after a failure. */

import assert from "node:assert/strict";
import test from "node:test";

import { fetchedOnce } from "../../app/page/web/fetched.js";

test("all calls share one answer", async () => {
  let numCalls = 0;
  const get = fetchedOnce(async (by) => (numCalls += by));
  assert.deepEqual(await Promise.all([get(2), get(3)]), [2, 2]);
  assert.equal(await get(5), 2);
});

test("a failure is told to all who wait, and the next call asks again", async () => {
  let numCalls = 0;
  const get = fetchedOnce(async () => {
    numCalls += 1;
    if (numCalls === 1) throw new Error("not there");
    return numCalls;
  });
  const both = await Promise.allSettled([get(), get()]);
  assert.ok(both.every(({ status }) => status === "rejected"));
  assert.equal(await get(), 2);
});
