/** What is said of a plan, and when. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { accentsOf, indexOfMatchingPhase, hasEnd, labelOf, sentenceOf, stretched, within, wordAt } from "../../app/page/web/player/plan.js";

const phase = (start_s, end_s, name, kind = "", word = "") => ({ start_s, end_s, phase: name, goal: [0.2, -0.1, 0.3], kind, word });
const SPEECH = {
  words: [[0.4, 0.7, "I"], [0.9, 1.4, "never"], [1.5, 1.9, "did"]],
  accents: [[1.1, 0.8]],
};
const PLAN = {
  origin: "planned", format: 1, duration_s: 4,
  left: [phase(0, 4, "rest")],
  right: [phase(0, 0.6, "rest"), phase(0.6, 1, "preparation", "offer_low"), phase(1, 1.3, "stroke", "offer_low", "never"), phase(1.3, 2, "hold", "offer_low"), phase(2, 2.2, "beat", "follow"), phase(2.2, 3, "retraction"), phase(3, 4, "rest")],
  nods: [{ time_s: 1.1, depth_deg: 6.4 }, { time_s: 3.5, depth_deg: 2 }],
  looks: [{ start_s: 0, end_s: 2, yaw_deg: 1, pitch_deg: -2 }, { start_s: 2, end_s: 4, yaw_deg: -20.4, pitch_deg: 9 }],
  brows: [{ time_s: 1.6, height: -0.4 }],
  smiles: [{ start_s: 0.5, end_s: 2.5, size: 0.42 }],
  blinks: [{ time_s: 3 }],
  stands: [{ start_s: 0, end_s: 4, leg: "left" }],
  planted: [],
};
const say = (list, index, plan = PLAN, speech = SPEECH) => sentenceOf(plan, { list, index }, speech);

test("a stroke says its gesture, its hand, the word that it lands on and whether that is stressed", () => {
  assert.equal(say("right", 2), "Stroke (offer low) of the right hand on the stressed word “never”; 1.00 to 1.30 s, planned.");
  const unstressed = { ...SPEECH, accents: [[1.7, 1]] };
  assert.match(say("right", 2, PLAN, unstressed), / on the word “never”;/);
  const wordless = { ...PLAN, right: [phase(1, 1.3, "stroke", "beat")] };
  assert.equal(say("right", 0, wordless), "Beat of the right hand; 1.00 to 1.30 s, planned.", "a plan that names no word is given none");
});

test("strokes that end together are of both hands", () => {
  const both = { ...PLAN, left: [phase(0.9, 1.4, "stroke", "offer_low", "never")] };
  assert.match(say("right", 2, both), /^Stroke \(offer low\) of both hands on/);
  const apart = { ...PLAN, left: [phase(0.9, 1.5, "stroke", "offer_low", "never")] };
  assert.match(say("right", 2, apart), /^Stroke \(offer low\) of the right hand on/);
});

test("what leads to a stroke and follows it says so", () => {
  assert.match(say("right", 1), /^Preparation of the right hand for: stroke \(offer low\) of the right hand on the stressed word “never”;/);
  assert.match(say("right", 3), /^Hold of the right hand after: stroke \(offer low\)/);
  assert.match(say("right", 4), /^A small beat of the right hand; 2.00 to 2.20 s/);
  assert.match(say("right", 5), /^Retraction of the right hand; 2.20 to 3.00 s/);
  assert.match(say("left", 0), /^The left hand rests;/);
});

test("what was found says so and takes the word of its time", () => {
  const detected = { ...PLAN, origin: "detected", right: [phase(1.3, 1.8, "stroke")] };
  assert.equal(say("right", 0, detected), "Stroke of the right hand on the word “did”; 1.30 to 1.80 s, detected in the motion.");
  assert.equal(say("right", 0, detected, { words: [], accents: [] }), "Stroke of the right hand; 1.30 to 1.80 s, detected in the motion.");
});

test("head, face and legs are told in words", () => {
  assert.equal(say("nods", 0), "Nod of 6° on the stressed word “never”; at 1.10 s, planned.");
  assert.equal(say("nods", 1), "Nod of 2°; at 3.50 s, planned.");
  assert.match(say("looks", 0), /^Looks at the listener;/);
  assert.match(say("looks", 0, { ...PLAN, origin: "detected" }), /^Looks ahead;/);
  assert.match(say("looks", 1), /^Looks 20° right, 9° down;/);
  assert.match(say("brows", 0), /^Frown on the word “did”;/);
  assert.match(say("smiles", 0), /^Smile of 42 %;/);
  assert.match(say("stands", 0), /^Weight on the left leg;/);
  assert.equal(labelOf("looks", PLAN.looks[1]), "20° right, 9° down");
});

test("a word is that of the moment, the nearest of several", () => {
  assert.equal(wordAt(SPEECH, 1.44).text, "never", "its end is nearer than where the next begins");
  assert.equal(wordAt(SPEECH, 1.48).text, "did");
  assert.equal(wordAt(SPEECH, 2.5), null);
  assert.equal(wordAt(SPEECH, 1.0, "did"), null);
});

test("what lies within some seconds is found among many", () => {
  const phases = Array.from({ length: 5000 }, (_, i) => phase(i, i + 1, "hold"));
  assert.deepEqual(within(phases, 100.5, 102.5), [100, 103]);
  assert.deepEqual(within(phases, 7.5, 7.5), [7, 8], "a moment");
  assert.deepEqual(within([{ time_s: 3 }], 3.05, 3.05), [0, 1], "just after a moment");
  assert.deepEqual(within([{ time_s: 3 }], 3.3, 3.3), [1, 1]);
  assert.deepEqual(within([], 0, 9), [0, 0]);
});

test("accents that somebody wrote down stand before those that were heard", () => {
  const [written, detected] = [[[1, 0.5]], [[2, 0.5]]];
  assert.equal(accentsOf({ accents: written, heard_accents: detected }), written);
  assert.equal(accentsOf({ accents: [], heard_accents: detected }), detected);
});

test("an end that is moved takes from what follows; a way back goes on into the rest", () => {
  const times = (phases) => phases.map(({ start_s, end_s }) => [start_s, end_s].map((at) => Number(at.toFixed(3))));
  const hold = times(stretched(PLAN.right, 3, 2.1, 4));
  assert.deepEqual(hold.slice(3, 5), [[1.3, 2.1], [2.1, 2.2]], "a beat after a hold gives way");
  assert.deepEqual(times(stretched(PLAN.right, 3, 3.5, 4))[3], [1.3, 2.1], "but stays");
  const beat = times(stretched(PLAN.right, 4, 2.6, 4));
  assert.deepEqual(beat.slice(4), [[2, 2.6], [2.6, 3.4], [3.4, 4]], "the way back is as long as before");
  assert.deepEqual(times(stretched(PLAN.right, 4, 3.9, 4)).slice(4), [[2, 3.8], [3.8, 3.9], [3.9, 4]]);
  assert.deepEqual(times(stretched(PLAN.right, 2, 0, 4)).slice(2, 4), [[1, 1.1], [1.1, 2]]);
  assert.equal(PLAN.right[4].end_s, 2.2, "the plan stays as it was");
  const alone = [phase(0, 1, "stroke"), phase(2, 3, "stroke")];
  assert.deepEqual(times(stretched(alone, 0, 2.5, 4)), [[0, 2], [2, 3]], "up to what follows a gap");
  assert.deepEqual(times(stretched(alone, 1, 9, 4)), [[0, 1], [2, 4]], "up to the end of the speech");
});

test("the ends of hands' phases can be moved, but for the last", () => {
  assert.equal(hasEnd(PLAN, { list: "right", index: 3 }), true);
  assert.equal(hasEnd(PLAN, { list: "right", index: 6 }), false);
  assert.equal(hasEnd(PLAN, { list: "looks", index: 0 }), false);
  assert.equal(hasEnd(PLAN, { list: "right", index: 9 }), false);
});

test("a phase is found again in another plan by where it begins or ends", () => {
  const longer = stretched(PLAN.right, 4, 2.6, 4);
  assert.equal(indexOfMatchingPhase(longer, PLAN.right[4]), 4);
  assert.equal(indexOfMatchingPhase(longer.slice(2), PLAN.right[4]), 2);
  assert.equal(indexOfMatchingPhase(longer, phase(3.2, 3.6, "stroke")), -1, "none is near");
  assert.equal(indexOfMatchingPhase(longer, phase(1.2, 1.5, "beat")), -1, "another phase is not it");
  assert.equal(indexOfMatchingPhase([], PLAN.right[4]), -1);
});
