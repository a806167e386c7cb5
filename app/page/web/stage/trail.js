/** The way of one point through the last moments, as flat triangles over a panel. */

import { line } from "./bones.js";

const WHITE = [1, 1, 1];
const DOT_CORNERS = 10;
const DOT = 1.25; // radius of a dot with its edge, of the line's width
const LEAST_PX = 0.7;

/**
 * Corners for `Painter.ink`: a line that grows thicker and has a colour for each speed, on a white
 * edge, with a dot where it jerks.
 *
 * `places` are pixels in a panel of `width` by `height`, null behind the camera; `speeds` 0 to 1;
 * `tip` are the pixels of a fingertip's radius, and no dot has more.
 */
export function trailCorners({ places, speeds, spikes, width, height, tip, colors, spike }) {
  const corners = [];
  const thick = Math.max(LEAST_PX, Math.min(Math.max(1.2, Math.min(width, height) / 150), tip / DOT));
  const push = (x, y, color) => corners.push((2 * x) / width - 1, 1 - (2 * y) / height, ...color);
  const dot = ([x, y], radius, color) => {
    for (let i = 0; i < DOT_CORNERS; i++) {
      push(x, y, color);
      for (const step of [i, i + 1]) {
        const angle = (2 * Math.PI * step) / DOT_CORNERS;
        push(x + radius * Math.cos(angle), y + radius * Math.sin(angle), color);
      }
    }
  };
  for (const isEdge of [true, false]) {
    const wide = isEdge ? 1.8 * thick : thick;
    for (let i = 1; i < places.length; i++) {
      if (!places[i - 1] || !places[i]) continue;
      const across = wide * (0.45 + (0.55 * i) / places.length);
      const color = isEdge ? WHITE : along(colors, speeds[i]);
      line(corners, places[i - 1], places[i], across, color, [width, height]);
      dot(places[i], across / 2, color);
    }
  }
  for (const [i, place] of places.entries()) {
    if (!place || !spikes[i]) continue;
    dot(place, DOT * thick, WHITE);
    dot(place, 0.9 * thick, spike);
  }
  return corners;
}

/** A colour at a share of a scale. */
export function along(colors, share) {
  const at = Math.max(0, Math.min(1, share)) * (colors.length - 1);
  const stop = Math.min(Math.floor(at), colors.length - 2);
  return colors[stop].map((part, k) => part + (at - stop) * (colors[stop + 1][k] - part));
}
