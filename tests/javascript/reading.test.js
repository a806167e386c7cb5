/** What chips say of a file goes into the form, once, and can be taken back. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { withOverride, wordsOf } from "../../app/page/web/stage/reading.js";

const override = (before, name, what, value, isAlone = false) => withOverride(before, { name, kind: "*.npz", what, value }, isAlone);

test("a file alone speaks for the next ones of its kind, one of several for itself", () => {
  assert.equal(override("", "mine", "up", "z", true), "*.npz:up=z");
  assert.equal(override("units=cm", "mine", "up", "z"), "units=cm,mine:up=z");
});

test("what was said before of the same is replaced, of others kept", () => {
  assert.equal(override("up=y, mine:up=x,theirs:up=x", "mine", "up", "z"), "up=y,theirs:up=x,mine:up=z");
  assert.equal(override("up=y,mine:up=x,*.bvh:up=x", "mine", "up", "z", true), "*.bvh:up=x,*.npz:up=z");
  assert.equal(override("a, b (2):up=x,hands=flat", "a, b (2)", "up", "z"), "hands=flat,a, b (2):up=z");
});

test("what is taken back is said of nothing any more", () => {
  assert.equal(override("up=y,mine:up=x,*.npz:up=y,theirs:up=x,rate=25", "mine", "up", null), "theirs:up=x,rate=25");
});

test("what nobody can read stays for the server to refuse", () => {
  assert.equal(override("sideways", "mine", "up", "z", true), "sideways,*.npz:up=z");
});

test("a chip has a word or two", () => {
  assert.deepEqual(["up z", "hands mean", "units cm", "face none"].map((each) => wordsOf(...each.split(" "))), ["z up", "mean hand", "cm", "no face"]);
});
