/** What a plan says of each moment and of each of its events: pure functions of its JSON. */

/** @typedef {import("../messages").GesturePlan & { origin: "planned" | "detected" }} Plan A plan, and whether its system followed it. */
/** @typedef {{ list: "left" | "right" | "nods" | "looks" | "brows" | "smiles" | "blinks" | "stands", index: number }} Chosen One event of a plan. */

export const SIDES = /** @type {const} */ (["left", "right"]);
export const POINT_S = 0.2; // for as long a nod, a blink or a brow is what happens now
const AROUND_WORD_S = [0.25, 0.15]; // before it begins and after it ends: still on it
const TOGETHER_S = 0.15; // strokes of both hands that end so close are one gesture
const AHEAD_DEG = 4;
const SAME_S = 0.01;
const AGAIN_S = 0.3;
const LEAST_S = 0.1; // shorter no phase is drawn while its end is moved
const FOLLOWING = "follow"; // small beats of the hand that takes no part

/** The tiers in the order in which they are drawn, each with the plan's lists that it shows. */
export const TIERS = /** @type {const} */ ([
  { name: "Left hand", lists: ["left"], isHand: true },
  { name: "Right hand", lists: ["right"], isHand: true },
  { name: "Head and gaze", lists: ["looks", "nods"], isHand: false },
  { name: "Face", lists: ["smiles", "brows", "blinks"], isHand: false },
  { name: "Supporting leg", lists: ["stands"], isHand: false },
]);

export const ORIGINS = { planned: "planned", detected: "detected in the motion" };

/** From when to when something happens; a moment lies around its time. */
export function timesOf(event) {
  return event.time_s === undefined ? [event.start_s, event.end_s] : [event.time_s - POINT_S / 2, event.time_s + POINT_S / 2];
}

/**
 * The accents that are known: those that somebody wrote down, else those that were heard.
 *
 * @param {import("../messages").Timeline} data
 */
export function accentsOf({ accents, heard_accents }) {
  return accents.length ? accents : heard_accents;
}

/** Where to look at it. */
export function beginOf(event) {
  return event.time_s ?? event.start_s;
}

/**
 * What lies within some seconds, or happens at a moment (`from` and `to` alike): the numbers of the
 * first such event and of the one after the last. Events are in time.
 */
export function within(events, from, to) {
  const first = lowest(events.length, (i) => timesOf(events[i])[1] > from);
  const stop = lowest(events.length, (i) => timesOf(events[i])[0] > to);
  return [first, Math.max(first, stop)];
}

/** The lowest number below `count` for which it holds, if it holds for all after it. */
function lowest(count, holds) {
  let [low, high] = [0, count];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (holds(middle)) high = middle;
    else low = middle + 1;
  }
  return low;
}

/** Whether the end of an event can be moved: that of a hand's phase, but for the last. */
export function hasEnd(plan, { list, index }) {
  return (list === "left" || list === "right") && plan[list][index]?.end_s < plan.duration_s - SAME_S;
}

/**
 * The phases of a hand with one that ends at another time, as the server will do it unless it has to
 * mend more: the next gives way, and a way back to rest goes on into the rest.
 *
 * @param {import("../messages").HandPhase[]} phases
 * @param {number} index
 * @param {number} seconds
 * @param {number} duration_s
 */
export function stretched(phases, index, seconds, duration_s) {
  const made = phases.map((phase) => ({ ...phase }));
  const [one, next, after] = made.slice(index, index + 3);
  const isNext = next && next.start_s - one.end_s < SAME_S;
  const rest = isNext && next.phase === "retraction" && after?.phase === "rest" ? after : null;
  const latest = rest ? rest.end_s - 2 * LEAST_S : isNext ? next.end_s - LEAST_S : (next?.start_s ?? duration_s);
  const end = Math.max(Math.min(seconds, latest), one.start_s + LEAST_S);
  if (isNext) next.start_s = end;
  if (rest) rest.start_s = next.end_s = Math.min(end + phases[index + 1].end_s - phases[index + 1].start_s, rest.end_s - LEAST_S);
  one.end_s = end;
  return made;
}

/**
 * The number of the phase that another plan has in place of one: of its name, that begins or ends
 * about where it did; -1 where there is none.
 */
export function indexOfMatchingPhase(phases, { phase, start_s, end_s }) {
  const off = (other) => Math.min(Math.abs(other.start_s - start_s), Math.abs(other.end_s - end_s));
  const near = phases.reduce((best, other, i) => (other.phase === phase && (best < 0 || off(other) < off(phases[best])) ? i : best), -1);
  return near >= 0 && off(phases[near]) < AGAIN_S ? near : -1;
}

/** What stands in an event's box; nothing in a rest's. */
export function labelOf(list, event) {
  if (list === "looks") return wayOf(event, "");
  if (list === "stands") return event.leg;
  const ofHand = { preparation: "prep.", stroke: kindName(event.kind ?? "") || "stroke", hold: "hold", beat: "beat", retraction: "retr." };
  return ofHand[event.phase] ?? "";
}

/** How an event is drawn: the name of its class. */
export function classOf(list, event) {
  if (list === "left" || list === "right") return event.phase;
  if (list === "brows") return event.height < 0 ? "frown" : "brow";
  if (list === "stands") return `stand ${event.leg}`;
  return list.slice(0, -1);
}

/** A kind's name as a person would write it. */
export function kindName(kind) {
  return kind === FOLLOWING ? "small beat" : kind.replaceAll("_", " ");
}

function wayOf({ yaw_deg, pitch_deg }, ahead) {
  const sideways = Math.abs(yaw_deg) < AHEAD_DEG ? "" : `${Math.round(Math.abs(yaw_deg))}° ${yaw_deg > 0 ? "left" : "right"}`;
  const upright = Math.abs(pitch_deg) < AHEAD_DEG ? "" : `${Math.round(Math.abs(pitch_deg))}° ${pitch_deg > 0 ? "down" : "up"}`;
  return [sideways, upright].filter(Boolean).join(", ") || ahead;
}

/**
 * The word of a moment, and whether it is stressed as far as accents are known.
 *
 * @param {{ words: import("../messages").TimeSpan[], accents: [number, number][] }} said
 * @param {number} seconds
 * @param {string} [text] of the word, where it is known
 */
export function wordAt({ words, accents }, seconds, text) {
  const [before, after] = AROUND_WORD_S;
  const near = words.filter(([start, end, word]) => seconds >= start - before && seconds <= end + after && (text === undefined || word.toLowerCase() === text));
  /** @param {import("../messages").TimeSpan} word */
  const far = ([start, end]) => Math.max(start - seconds, seconds - end, 0);
  const word = near.reduce((best, each) => (best && far(best) <= far(each) ? best : each), null);
  if (!word) return null;
  return { text: word[2], isStressed: accents.some(([at]) => at >= word[0] && at <= word[1]) };
}

/**
 * Why something is there and what it is, in one sentence, as far as it is known.
 *
 * @param {Plan} plan
 * @param {Chosen} chosen
 * @param {{ words: import("../messages").TimeSpan[], accents: [number, number][] }} speech
 */
export function sentenceOf(plan, { list, index }, speech) {
  /** @type {any} */
  const event = plan[list][index];
  const description = list === "left" || list === "right" ? describeHand(plan, list, index, speech) : describeOther(plan, list, event, speech);
  const [start, end] = timesOf(event);
  const when = event.time_s === undefined ? `${start.toFixed(2)} to ${end.toFixed(2)} s` : `at ${event.time_s.toFixed(2)} s`;
  return `${capital(description)}; ${when}, ${ORIGINS[plan.origin]}.`;
}

function describeHand(plan, side, index, speech) {
  const phases = plan[side];
  const { phase } = phases[index];
  if (phase === "rest") return `the ${side} hand rests`;
  const landing = phase === "stroke" ? index : landingOf(phases, index);
  const stroke = phases[landing];
  const what = stroke && describeStroke(plan, side, stroke, speech);
  return {
    stroke: what,
    preparation: `preparation of the ${side} hand${what ? ` for: ${what}` : ""}`,
    hold: `hold of the ${side} hand${what ? ` after: ${what}` : ""}`,
    beat: `a ${kindName(phases[index].kind === FOLLOWING ? FOLLOWING : "beat")} of the ${side} hand${onWord(plan, phases[index], speech)}`,
    retraction: `retraction of the ${side} hand`,
  }[phase];
}

/** The stroke that a phase belongs to: the next one of a preparation, else the last one before. */
function landingOf(phases, index) {
  const step = phases[index].phase === "preparation" ? 1 : -1;
  for (let i = index + step; i >= 0 && i < phases.length; i += step) {
    if (phases[i].phase === "stroke") return i;
    if (phases[i].phase === "rest" || phases[i].phase === "retraction") break;
  }
  return -1;
}

function describeStroke(plan, side, stroke, speech) {
  const other = plan[side === "left" ? "right" : "left"];
  const isBoth = other.some(({ phase, end_s }) => phase === "stroke" && Math.abs(end_s - stroke.end_s) < TOGETHER_S);
  const kind = kindName(stroke.kind);
  return `${kind === "beat" ? kind : kind ? `stroke (${kind})` : "stroke"} of ${isBoth ? "both hands" : `the ${side} hand`}${onWord(plan, stroke, speech)}`;
}

/** A planned stroke says which word it lands on; one that was found ends on the word of its time. */
function onWord(plan, phase, speech) {
  if (plan.origin === "planned" && phase.phase === "stroke" && !phase.word) return "";
  const plannedWord = phase.word && plan.origin === "planned" ? phase.word : undefined;
  const word = wordAt(speech, phase.end_s, plannedWord) ?? (plannedWord ? { text: plannedWord, isStressed: false } : null);
  return word ? ` on the ${word.isStressed ? "stressed " : ""}word “${word.text}”` : "";
}

function describeOther(plan, list, event, speech) {
  const word = event.time_s === undefined ? null : wordAt(speech, event.time_s);
  const on = word ? ` on the ${word.isStressed ? "stressed " : ""}word “${word.text}”` : "";
  const descriptions = {
    nods: () => `nod of ${Math.round(event.depth_deg)}°${on}`,
    looks: () => `looks ${wayOf(event, plan.origin === "planned" ? "at the listener" : "ahead")}`,
    brows: () => `${event.height < 0 ? "frown" : "raised brows"}${on}`,
    smiles: () => `smile of ${Math.round(100 * event.size)} %`,
    blinks: () => "blink",
    stands: () => (event.leg === "both" ? "stands on both legs" : `weight on the ${event.leg} leg`),
  };
  return descriptions[list]();
}

export function capital(words) {
  return words[0].toUpperCase() + words.slice(1);
}
