/** Filters over time, as model/motion has them: numbers in, numbers out. `(T, C)` is row by row. */

import { FPS } from "./motion.js";

const PADDING = 15; // frames
const SAVGOL_FRAMES = 7;

/**
 * Two sections [b0, b1, b2, a1, a2] of a Butterworth low-pass of order 4.
 *
 * @returns {[number, number, number, number, number][]}
 */
export function butterworth(cutoff, fps = FPS) {
  const k = Math.tan((Math.PI * cutoff) / fps);
  return [0.5411961001461969, 1.3065629648763766].map((quality) => {
    const norm = 1 / (1 + k / quality + k * k);
    const gain = k * k * norm;
    return [gain, 2 * gain, gain, 2 * (k * k - 1) * norm, (1 - k / quality + k * k) * norm];
  });
}

/** What is slower than a cut-off (Hz), without delay; at its ends a clip is mirrored. */
export function belowCutoff(values, channels, cutoff) {
  const length = values.length / channels;
  const padding = Math.min(PADDING, length - 1);
  const sections = butterworth(cutoff);
  const slow = new Float32Array(values.length);
  const line = new Float64Array(length + 2 * padding);
  for (let channel = 0; channel < channels; channel++) {
    const at = (frame) => values[frame * channels + channel];
    for (let i = 0; i < padding; i++) {
      line[i] = 2 * at(0) - at(padding - i);
      line[padding + length + i] = 2 * at(length - 1) - at(length - 2 - i);
    }
    for (let i = 0; i < length; i++) line[padding + i] = at(i);
    for (let way = 0; way < 2; way++) {
      for (const section of sections) run(section, line);
      line.reverse();
    }
    for (let i = 0; i < length; i++) slow[i * channels + channel] = line[padding + i];
  }
  return slow;
}

/** One section along a line in place, as if its first value had stood for ever. */
function run([b0, b1, b2, a1, a2], line) {
  const gain = (b0 + b1 + b2) / (1 + a1 + a2);
  let two = (b2 - a2 * gain) * line[0];
  let one = (b1 - a1 * gain) * line[0] + two;
  for (let i = 0; i < line.length; i++) {
    const x = line[i];
    const y = b0 * x + one;
    one = b1 * x - a1 * y + two;
    two = b2 * x - a2 * y;
    line[i] = y;
  }
}

/** Savitzky and Golay's filter, 7 frames, order 2; the ends follow the last parabola. */
export function savgol(values, channels) {
  const length = values.length / channels;
  const window = Math.min(SAVGOL_FRAMES, length - 1 + (length % 2));
  if (window <= 3) return Float32Array.from(values);
  const half = (window - 1) / 2;
  const rows = Array.from({ length: window }, (_, i) => parabola(half, i - half));
  const smooth = new Float32Array(values.length);
  for (let frame = 0; frame < length; frame++) {
    const start = Math.max(0, Math.min(frame - half, length - window));
    const weights = rows[frame - start];
    for (let channel = 0; channel < channels; channel++) {
      let total = 0;
      for (let i = 0; i < window; i++) total += weights[i] * values[(start + i) * channels + channel];
      smooth[frame * channels + channel] = total;
    }
  }
  return smooth;
}

/** Weights of -half to half by which the parabola of least squares is known at `place`. */
function parabola(half, place) {
  const xs = Array.from({ length: 2 * half + 1 }, (_, i) => i - half);
  const [n, s2, s4] = [xs.length, sum(xs.map((x) => x ** 2)), sum(xs.map((x) => x ** 4))];
  const determinant = n * s4 - s2 * s2;
  return xs.map((x) => {
    const [constant, linear, square] = [(s4 - s2 * x * x) / determinant, x / s2, (n * x * x - s2) / determinant];
    return constant + linear * place + square * place * place;
  });
}

/** Of a Gaussian along time; what lies beyond an end is as the end is. */
export function gaussian(values, channels, sigma) {
  const length = values.length / channels;
  const radius = Math.round(4 * sigma);
  const kernel = Array.from({ length: 2 * radius + 1 }, (_, i) => Math.exp(-0.5 * ((i - radius) / sigma) ** 2));
  const total = sum(kernel);
  const smooth = new Float32Array(values.length);
  for (let frame = 0; frame < length; frame++) {
    for (let i = -radius; i <= radius; i++) {
      const from = channels * Math.max(0, Math.min(length - 1, frame + i));
      const weight = kernel[i + radius] / total;
      for (let channel = 0; channel < channels; channel++) smooth[frame * channels + channel] += weight * values[from + channel];
    }
  }
  return smooth;
}

/**
 * Length of the `order`-th difference of points, per second to that power: of each frame that of
 * the difference that has it in its middle. `places` is (T, P, 3), the result (T, P).
 */
export function derivative(places, points, order) {
  const width = 3 * points;
  const length = places.length / width;
  const magnitudes = new Float32Array(length * points);
  const factors = [[1], [-1, 1], [1, -2, 1], [-1, 3, -3, 1]][order];
  const entries = length - order;
  if (entries <= 0) return magnitudes;
  const before = Math.floor(order / 2);
  for (let frame = 0; frame < length; frame++) {
    const from = width * Math.max(0, Math.min(entries - 1, frame - before));
    for (let point = 0; point < points; point++) {
      let square = 0;
      for (let k = 0; k < 3; k++) {
        let value = 0;
        for (let i = 0; i <= order; i++) value += factors[i] * places[from + width * i + 3 * point + k];
        square += value * value;
      }
      magnitudes[frame * points + point] = Math.sqrt(square) * FPS ** order;
    }
  }
  return magnitudes;
}

function sum(values) {
  return values.reduce((total, value) => total + value, 0);
}
