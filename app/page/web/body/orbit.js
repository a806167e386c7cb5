/**
 * A camera that a person moves around a body. Views that share one show the same side.
 *
 *     const orbit = new Orbit();
 *     orbit.addEventListener("change", () => draw());
 *     orbit.hold(canvas);                 // dragging, wheel, fingers and keys there
 *     const { axes, eye } = orbit.from(camera, pelvis);  // in place of the camera
 */

export const ORBIT_HELP = "Drag or arrow keys: rotate. Plus, minus or wheel: zoom. Shift and drag: pan. Home: front view.";
const TURN = 0.008; // radians of one pixel
const STEEPEST = 1.48; // radians, from level
const KEY_TURN = Math.PI / 12;
const KEY_ZOOM = 1.25;
const WHEEL_ZOOM = 0.0015; // of one pixel of the wheel, as an exponent
const ZOOMS = [0.4, 10];
const FARTHEST = 1.5; // metres to the side

export class Orbit extends EventTarget {
  /** Everything about it, as `place` takes it: two angles, how near, and metres to the right and up. */
  state = [0, 0, 1, 0, 0];

  /** Whether it stands anywhere else than where the file puts it. */
  get isMoved() {
    return String(this.state) !== "0,0,1,0,0";
  }

  place([yaw = 0, pitch = 0, zoom = 1, right = 0, up = 0]) {
    const aside = [right, up].map((part) => within(part, -FARTHEST, FARTHEST));
    this.state = [yaw, within(pitch, -STEEPEST, STEEPEST), within(zoom, ...ZOOMS), ...aside];
    this.dispatchEvent(new Event("change"));
  }

  reset() {
    this.place([]);
  }

  /** Around the body, and above it; radians. */
  turn(yaw, pitch) {
    const [before, level, zoom, right, up] = this.state;
    this.place([before + yaw, level + pitch, zoom, right, up]);
  }

  /** Nearer by a factor. */
  nearer(factor) {
    const [yaw, pitch, zoom, right, up] = this.state;
    this.place([yaw, pitch, zoom * factor, right, up]);
  }

  /** The body in the picture, by shares of the picture's height. */
  shift(right, up) {
    const [yaw, pitch, zoom, x, y] = this.state;
    const metres = 2 / zoom; // about what the height shows
    this.place([yaw, pitch, zoom, x - metres * right, y - metres * up]);
  }

  /** Where a camera, its axes right, up and backward, stands instead when it is moved around a place. */
  from({ axes, eye }, around) {
    const distance = axes[2].reduce((sum, part, k) => sum + part * (eye[k] - around[k]), 0);
    const middle = eye.map((part, k) => part - distance * axes[2][k]);
    const [yaw, tilt, zoom, aside, raised] = this.state;
    const [sin, cos] = [Math.sin(yaw), Math.cos(yaw)];
    const [right, up, back] = axes.map(([x, y, z]) => [cos * x + sin * z, y, cos * z - sin * x]);
    const level = Math.asin(within(back[1], -1, 1));
    const pitch = within(level + tilt, -STEEPEST, STEEPEST) - level;
    const [rise, run] = [Math.sin(pitch), Math.cos(pitch)];
    const above = up.map((part, i) => run * part - rise * back[i]);
    const behind = back.map((part, i) => run * part + rise * up[i]);
    const moved = middle.map((part, i) => part + aside * right[i] + raised * above[i] + (distance / zoom) * behind[i]);
    return { axes: [right, above, behind], eye: moved };
  }

  /**
   * Let a person move it on an element. `isLeft(event)` says of a finger
   * that moves alone whether something else wants it.
   *
   * @param {HTMLElement} element
   * @param {(event: PointerEvent) => boolean} isLeft
   */
  hold(element, isLeft = (_event) => false) {
    const on = (name, listener) => element.addEventListener(name, listener, { passive: false });
    const fingers = new Map(); // pointer -> [x, y]
    const size = () => element.clientHeight || 1;
    on("pointerdown", (event) => {
      if (event.button > 2) return;
      event.preventDefault();
      element.focus({ preventScroll: true });
      element.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, [event.clientX, event.clientY]);
    });
    on("pointermove", (event) => {
      const before = fingers.get(event.pointerId);
      if (!before) return;
      const [dx, dy] = [event.clientX - before[0], event.clientY - before[1]];
      const spread = spreadOf(fingers);
      fingers.set(event.pointerId, [event.clientX, event.clientY]);
      if (fingers.size > 1) {
        this.shift(dx / size() / fingers.size, -dy / size() / fingers.size);
        this.nearer(Math.max(spreadOf(fingers), 1) / Math.max(spread, 1));
      } else if (isLeft(event)) return;
      else if (event.shiftKey || event.buttons & 6) this.shift(dx / size(), -dy / size());
      else this.turn(-TURN * dx, TURN * dy);
    });
    for (const name of ["pointerup", "pointercancel", "lostpointercapture"]) on(name, ({ pointerId }) => fingers.delete(pointerId));
    on("contextmenu", (event) => event.preventDefault()); // the right button moves
    on("wheel", (event) => {
      if (document.activeElement !== element && !event.ctrlKey) return; // the page scrolls
      event.preventDefault();
      this.nearer(Math.exp(-WHEEL_ZOOM * event.deltaY));
    });
    on("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      const does = {
        ArrowLeft: () => this.turn(KEY_TURN, 0),
        ArrowRight: () => this.turn(-KEY_TURN, 0),
        ArrowUp: () => this.turn(0, KEY_TURN),
        ArrowDown: () => this.turn(0, -KEY_TURN),
        "+": () => this.nearer(KEY_ZOOM),
        "=": () => this.nearer(KEY_ZOOM),
        "-": () => this.nearer(1 / KEY_ZOOM),
        Home: () => this.reset(),
      }[event.key];
      if (!does) return;
      event.preventDefault();
      does();
    });
  }
}

/** Pixels between two fingers; 0 for one. */
function spreadOf(fingers) {
  const [first, second] = fingers.values();
  return second ? Math.hypot(first[0] - second[0], first[1] - second[1]) : 0;
}

function within(value, least, most) {
  return Math.max(least, Math.min(most, value));
}
