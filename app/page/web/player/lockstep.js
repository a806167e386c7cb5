/**
 * The clock of all bodies: the sound under them.
 *
 * Moments are frames: before it plays, and after it pauses, it stands in the middle of one. Where
 * more is still to come it waits short of the last frame there is.
 */

import { FPS } from "../stage/motion.js";

const FRAME_S = 1 / FPS;
const AT_HAND_FRAMES = 2; // the last ones that have come are not run into
const AHEAD_FRAMES = 30; // that must have come before it goes on
const LOOKED_AT = ["seeked", "canplay", "loadeddata", "progress", "error", "emptied"];

/** Emits "time" whenever what is shown changes, "state" when it starts, stops or changes speed. */
export class Lockstep extends EventTarget {
  #sound = null;
  isPlaying = false;
  rate = 1;
  loop = null; // [start, end] in seconds that is played again and again
  #turn = 0; // counts starts and stops: whoever waited for something sees that it is too late
  #numFrames = 0;
  #limit = null; // frames that there are to be shown, where more of them come
  isWaiting = false; // it would play, but what it is to show has not come yet
  #listening = new AbortController();

  get duration() {
    return this.#numFrames * FRAME_S;
  }

  /** Seconds on the clock. */
  get time() {
    return Math.min(this.#sound?.currentTime ?? 0, this.duration);
  }

  /** The frame that is on screen. */
  get frame() {
    return Math.max(0, Math.min(Math.floor(this.time * FPS + 1e-4), this.#numFrames - 1));
  }

  /** There are only so many frames so far; null once nothing has to be waited for. */
  setLimit(frames) {
    this.#limit = frames;
    const hasMore = frames === null || frames > this.frame + AHEAD_FRAMES;
    if (this.isWaiting && this.isPlaying && hasMore) this.#restart();
  }

  get #isAtLimit() {
    return this.#limit !== null && this.#limit < this.#numFrames && this.time * FPS > this.#limit - AT_HAND_FRAMES;
  }

  /** Stand until more has come; where a busy machine has let the sound run on, back at the last frame. */
  #wait() {
    this.#turn += 1;
    this.isWaiting = true;
    this.#sound.pause();
    const last = Math.max(0, this.#limit - AT_HAND_FRAMES);
    if (this.frame > last) this.#stand(last);
    this.#tell("state");
  }

  setSound(audio) {
    this.#sound = audio;
    const { signal } = this.#listening;
    audio.addEventListener("loadedmetadata", () => this.#measure(), { signal });
    audio.addEventListener("ended", () => this.#end(), { signal });
    if (audio.readyState >= HTMLMediaElement.HAVE_METADATA) this.#measure();
  }

  /** Forget everything and stop. */
  clear() {
    this.#turn += 1;
    this.#listening.abort();
    this.#listening = new AbortController();
    this.isPlaying = this.isWaiting = false;
    this.#limit = null;
    this.#sound?.pause();
    this.#sound?.removeAttribute("src");
    this.#sound?.load();
    this.#sound = null;
    this.loop = null;
    this.#numFrames = 0;
  }

  toggle() {
    return this.isPlaying ? this.pause() : this.play();
  }

  /** Start, from the start when the end was reached. */
  async play() {
    if (!this.#sound || this.isPlaying) return;
    const [start, end] = this.loop ?? [0, this.duration];
    if (this.frame >= Math.round(end * FPS) - 1 || this.time < start - FRAME_S) this.#stand(Math.round(start * FPS));
    this.isPlaying = true;
    this.#tell("state");
    await this.#restart();
  }

  /** Stop on the frame that is shown. */
  pause() {
    this.#turn += 1;
    this.isPlaying = this.isWaiting = false;
    this.#sound?.pause();
    this.#stand(this.frame);
    this.#tell("state");
  }

  /** Show the frame that is on at `seconds`, playing or not. */
  seek(seconds) {
    this.seekFrame(Math.floor(seconds * FPS + 1e-4));
  }

  seekFrame(frame) {
    this.#stand(Math.max(0, Math.min(frame, this.#numFrames - 1)));
    if (this.isPlaying) this.#restart();
  }

  /** Go some frames on or back, and stand there. */
  step(frames) {
    if (this.isPlaying) this.pause();
    this.seekFrame(this.frame + frames);
  }

  setRate(rate) {
    this.rate = rate;
    if (this.#sound) this.#sound.playbackRate = rate;
    this.#tell("state");
  }

  /** Play [start, end) in seconds again and again, or with null everything once. */
  setLoop(range) {
    this.loop = range;
    if (range && this.isPlaying && (this.time < range[0] || this.time >= range[1])) this.seek(range[0]);
    this.#tell("state");
  }

  #measure() {
    const { duration } = this.#sound;
    this.#numFrames = Number.isFinite(duration) ? Math.max(1, Math.round(duration * FPS)) : 0;
    this.#tell("state");
  }

  /** On one frame, without a change of whether it plays. */
  #stand(frame) {
    this.#turn += 1;
    const sound = this.#sound;
    if (sound) sound.currentTime = Math.min((frame + 0.5) * FRAME_S, sound.duration || Infinity);
    this.#tell("time");
  }

  /** Stop, wait until the sound is where it was told to be, and start. */
  async #restart() {
    if (this.#isAtLimit) return this.#wait();
    const turn = ++this.#turn;
    const sound = this.#sound;
    if (this.isWaiting) {
      this.isWaiting = false;
      this.#tell("state");
    }
    sound.pause();
    await isReady(sound);
    if (turn !== this.#turn || !this.isPlaying) return;
    sound.playbackRate = this.rate;
    try {
      await sound.play();
    } catch {
      if (turn === this.#turn) this.pause(); // the browser wants a click first, or has no more of it
      return;
    }
    if (turn === this.#turn) this.#run(turn);
  }

  /** Tell the time from picture to picture for as long as this start lasts. */
  #run(turn) {
    if (turn !== this.#turn) return;
    if (this.loop && this.#sound.currentTime >= this.loop[1] - FRAME_S / 2) {
      this.seek(this.loop[0]);
      return;
    }
    if (this.#isAtLimit) this.#wait();
    this.#tell("time");
    requestAnimationFrame(() => this.#run(turn));
  }

  #end() {
    if (!this.isPlaying) return;
    if (this.#isAtLimit) this.#wait();
    else if (this.loop) this.seek(this.loop[0]);
    else {
      this.pause();
      this.seekFrame(this.#numFrames - 1);
    }
  }

  #tell(type) {
    this.dispatchEvent(new Event(type));
  }
}

/**
 * Resolves when a sound stands where it was told to and can go on from there.
 *
 * @param {HTMLMediaElement} sound
 * @returns {Promise<void>}
 */
function isReady(sound) {
  const isThere = () => {
    const isAtEnd = sound.duration - sound.currentTime < 2 * FRAME_S;
    const enough = isAtEnd ? HTMLMediaElement.HAVE_CURRENT_DATA : HTMLMediaElement.HAVE_FUTURE_DATA;
    return sound.error || (!sound.seeking && sound.readyState >= enough);
  };
  return new Promise((resolve) => {
    const look = () => {
      if (!isThere() && sound.isConnected) return;
      for (const name of LOOKED_AT) sound.removeEventListener(name, look);
      resolve();
    };
    for (const name of LOOKED_AT) sound.addEventListener(name, look);
    look();
  });
}
