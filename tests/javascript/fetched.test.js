/** What all parts of a page share is fetched once, and again after a failure. */

import assert from "node:assert/strict";
import test from "node:test";

import { fetchedOnce } from "../../app/page/web/fetched.js";

test("all calls share one answer", async () => {
  let asked = 0;
  const get = fetchedOnce(async (by) => (asked += by));
  assert.deepEqual(await Promise.all([get(2), get(3)]), [2, 2]);
  assert.equal(await get(5), 2);
});

test("a failure is told to all who wait, and the next call asks again", async () => {
  let asked = 0;
  const get = fetchedOnce(async () => {
    asked += 1;
    if (asked === 1) throw new Error("not there");
    return asked;
  });
  const both = await Promise.allSettled([get(), get()]);
  assert.ok(both.every(({ status }) => status === "rejected"));
  assert.equal(await get(), 2);
});
