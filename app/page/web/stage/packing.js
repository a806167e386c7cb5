/** How bodies and their close-ups share the stage. Rectangles are [left, top, width, height]. */

/** @typedef {[number, number, number, number]} Rect */

const BODY_ASPECT = 0.6; // of somebody who gestures
const WIDE_ASPECT = 1.8; // from which close-ups stand beside bodies
const SIDE_SHARE = 0.28; // of the width, of close-ups beside it
const BUST_ASPECT = 1.2; // height to width of a face's close-up at most, or the end of its bust is seen
const CLOSE_UP_SHARE = 0.34; // of a cell's height at most, of each row of close-ups

/** Whether close-ups stand at the sides of a body, or of two in one place, rather than above or under. */
const isWide = (width, height) => width > WIDE_ASPECT * height;

/** Columns and rows in which so many bodies are as large as they can be. */
export function grid(count, width, height) {
  let best = { columns: 1, rows: count, size: 0 };
  for (let columns = 1; columns <= count; columns++) {
    const rows = Math.ceil(count / columns);
    const size = Math.min(width / columns / BODY_ASPECT, height / rows);
    if (size > best.size * 1.001) best = { columns, rows, size };
  }
  return best;
}

/**
 * The cell of each body, row by row.
 *
 * @returns {Rect[]}
 */
export function cells(count, width, height, columns) {
  const rows = Math.ceil(count / columns);
  const edge = (whole, parts, i) => Math.round((whole * i) / parts);
  return Array.from({ length: count }, (_, i) => {
    const [column, row] = [i % columns, Math.floor(i / columns)];
    const [left, top] = [edge(width, columns, column), edge(height, rows, row)];
    return [left, top, edge(width, columns, column + 1) - left, edge(height, rows, row + 1) - top];
  });
}

/**
 * Where in a cell the body stands, and its close-ups: the face above, the hands below, or a row of
 * all three below; in a wide cell all of them at its sides.
 *
 * @param {Rect} cell
 * @param {string} closeUp
 * @param {import("../messages").ViewerConstants["close_ups"]} closeUps
 */
export function panels([left, top, width, height], closeUp, closeUps) {
  if (isWide(width, height) && closeUp !== "off") return widePanels([left, top, width, height], closeUp, closeUps);
  const { face, hands } = closeUps;
  const shots = { hands, face, both: [...hands.slice(0, 1), ...face, ...hands.slice(1)], off: [] }[closeUp];
  const tall = shots.length ? Math.round(Math.min(width / Math.max(2, shots.length), CLOSE_UP_SHARE * height)) : 0;
  const above = closeUp === "face" ? tall : 0;
  const row = cells(shots.length, width, tall, shots.length);
  return [
    { view: null, rect: [left, top + above, width, height - tall] },
    ...shots.map((shot, i) => ({ ...shot, rect: [left + row[i][0], above ? top : top + height - tall, row[i][2], tall] })),
  ];
}

/** The face at one side and the hands at the other, or the hands on either side. */
function widePanels([left, top, width, height], closeUp, closeUps) {
  const [before, after] = { hands: [closeUps.hands.slice(0, 1), closeUps.hands.slice(1)], face: [closeUps.face, []], both: [closeUps.face, closeUps.hands] }[closeUp];
  const wide = Math.round(SIDE_SHARE * width);
  const column = (shots, x) => cells(shots.length, wide, height, 1).map(([, y, w, h], i) => {
    const tall = shots[i].view === "face" ? Math.min(h, Math.round(BUST_ASPECT * w)) : h;
    return { ...shots[i], rect: [x, top + y + h - tall, w, tall] };
  });
  const from = before.length ? left + wide : left;
  const to = left + width - (after.length ? wide : 0);
  return [{ view: null, rect: [from, top, to - from, height] }, ...column(before, left), ...column(after, to)];
}

/** Two bodies in one place in the middle, the close-ups of each on its own side. */
export function pairPanels([left, top, width, height], closeUp, closeUps) {
  const shots = [...(closeUp === "face" || closeUp === "both" ? closeUps.face : []), ...(closeUp === "hands" || closeUp === "both" ? closeUps.hands : [])];
  if (!shots.length) return { body: { rect: [left, top, width, height] }, sides: [[], []] };
  if (!isWide(width, height)) {
    // Below: those of the first on the left half.
    const tall = Math.round(Math.min(width / 2 / shots.length, CLOSE_UP_SHARE * height));
    const row = cells(2 * shots.length, width, tall, 2 * shots.length);
    const side = (first) => shots.map((shot, i) => ({ ...shot, rect: [left + row[first + i][0], top + height - tall, row[first + i][2], tall] }));
    return { body: { rect: [left, top, width, height - tall] }, sides: [side(0), side(shots.length)] };
  }
  const wide = Math.round(Math.min(height / shots.length, SIDE_SHARE * width));
  const column = cells(shots.length, wide, height, 1);
  const side = (x) => shots.map((shot, i) => ({ ...shot, rect: [x, top + column[i][1], wide, column[i][3]] }));
  return { body: { rect: [left + wide, top, width - 2 * wide, height] }, sides: [side(left), side(left + width - wide)] };
}
