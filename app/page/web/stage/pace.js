/** How coarsely to draw so that pictures come fast enough, found out by drawing. */

/**
 * From fine to coarse: meshes as of Mesh.level, of bodies, their close-ups and shadows; canvas
 * pixels for each of the page's; and whether those of a dense screen are drawn.
 */
const LEVELS = [
  { mesh: 0, close: 0, shadow: 2, pixels: 1, isDense: true },
  { mesh: 1, close: 1, shadow: 4, pixels: 1, isDense: false },
  { mesh: 2, close: 2, shadow: 4, pixels: 1, isDense: false },
  { mesh: 3, close: 2, shadow: 4, pixels: 1, isDense: false },
  { mesh: 3, close: 3, shadow: 4, pixels: 0.8, isDense: false },
  { mesh: 3, close: 3, shadow: 4, pixels: 0.6, isDense: false },
];
const SLOW_START = 3;
const SLOW_FULL = { mesh: 0, close: 0, shadow: 2, pixels: 1.5, isDense: false }; // of a picture that stands: no edge is smoothed otherwise
const GPU_MS = [8, 22]; // finer below, coarser above
const SLOW_MS = [28, 60];
const PATIENCE = 6; // pictures in a row
const SOFTWARE = /swiftshader|llvmpipe|softpipe|software|basic render/i; // names of drivers

/** Whether the processor has to draw, as there is no GPU. */
export function isSoftware(gl) {
  const { UNMASKED_RENDERER_WEBGL } = gl.getExtension("WEBGL_debug_renderer_info") ?? {};
  return SOFTWARE.test(gl.getParameter(UNMASKED_RENDERER_WEBGL ?? gl.RENDERER));
}

export class Pace {
  #at;
  isSlow;
  #run = 0; // pictures in a row that were too slow (above 0) or fast enough for more

  constructor(isSlow) {
    this.isSlow = isSlow;
    this.#at = isSlow ? SLOW_START : 0;
  }

  get level() {
    return LEVELS[this.#at];
  }

  /** Of a picture that stands. */
  get fullLevel() {
    return this.isSlow ? SLOW_FULL : LEVELS[0];
  }

  /** Note that a picture took so long. */
  took(milliseconds) {
    const [fine, coarse] = this.isSlow ? SLOW_MS : GPU_MS;
    const way = milliseconds > coarse ? 1 : milliseconds < fine ? -1 : 0;
    this.#run = way && Math.sign(this.#run) === way ? this.#run + way : way;
    const isMuch = way > 0 ? PATIENCE : 10 * PATIENCE; // slow to be bold
    if (Math.abs(this.#run) < isMuch) return;
    this.#at = Math.max(0, Math.min(LEVELS.length - 1, this.#at + way));
    this.#run = 0;
  }
}
