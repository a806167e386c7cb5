/**
 * Any number of silent videos that follow one clock.
 *
 * The clock is a sound where there is one, else the first video. While it plays, each video's
 * shown frame is compared with it and the video is sped up or slowed a little, or made to jump when
 * it is far off. Before it plays, and after it pauses, all stand on the same frame.
 */

import { FPS } from "../rates.js";

const FRAME_S = 1 / FPS;
const JUMP_S = 0.25; // further off than this, a video is not led back but put right
const CALM_MS = 1000; // between two jumps of one video: a slow machine must get to show something
const STALE_S = 0.3; // a shown frame as old as this says nothing of now
const TOLERANCE_S = FRAME_S / 6;
const AT_HAND_FRAMES = 2; // the last ones that have come are not run into
const AHEAD_FRAMES = 30; // that must have come before it goes on
const GAIN = 2.5; // share of the drift that is made good in a second
const MOST_CHANGE = 0.2; // of the speed, or the picture is seen to rush

const ENOUGH = HTMLMediaElement.HAVE_FUTURE_DATA;

/** Emits "time" whenever what is shown changes, "state" when it starts, stops or changes speed. */
export class Lockstep extends EventTarget {
  #sound = null;
  #followers = new Map(); // video -> Follower, in the order of the rows
  #isPlaying = false;
  #rate = 1;
  #loop = null;
  #turn = 0; // counts starts and stops: whoever waited for something sees that it is too late
  #numFrames = 0;
  #limit = null; // frames that there are to be shown, where more of them come
  #isWaiting = false;
  #listening = new AbortController();

  get isPlaying() {
    return this.#isPlaying;
  }

  get rate() {
    return this.#rate;
  }

  /** [start, end] in seconds that is played again and again, or null. */
  get loop() {
    return this.#loop;
  }

  get duration() {
    return this.#numFrames * FRAME_S;
  }

  /** Seconds on the clock. */
  get time() {
    return Math.min(this.#clock?.currentTime ?? 0, this.duration);
  }

  /** The frame that is on screen. */
  get frame() {
    return Math.max(0, Math.min(Math.floor(this.time * FPS + 1e-4), this.#numFrames - 1));
  }

  get #clock() {
    return this.#sound ?? this.#followers.keys().next().value ?? null;
  }

  /** Videos that must be led: all but the one that is the clock. */
  get #led() {
    const clock = this.#clock;
    return [...this.#followers.values()].filter(({ video }) => video !== clock);
  }

  /** Whether it would play, but what it is to show has not come yet. */
  get isWaiting() {
    return this.#isWaiting;
  }

  /** There are only so many frames so far; null once nothing has to be waited for. */
  setLimit(frames) {
    this.#limit = frames;
    const hasMore = frames === null || frames > this.frame + AHEAD_FRAMES;
    if (this.#isWaiting && this.#isPlaying && hasMore) this.#restart();
  }

  get #isAtLimit() {
    return this.#limit !== null && this.#limit < this.#numFrames && this.time * FPS > this.#limit - AT_HAND_FRAMES;
  }

  /** Stand until more has come; where a busy machine has let the sound run on, back at the last frame. */
  #wait() {
    this.#turn += 1;
    this.#isWaiting = true;
    this.#clock.pause();
    for (const { video } of this.#led) video.pause();
    const last = Math.max(0, this.#limit - AT_HAND_FRAMES);
    if (this.frame > last) this.#stand(last);
    this.#tell("state");
  }

  /** Let a sound be the clock. */
  setSound(audio) {
    this.#sound = audio;
    this.#listen(audio);
  }

  /** Take in a video; it joins at the present moment. */
  add(video) {
    this.#followers.set(video, new Follower(video));
    this.#listen(video);
    if (this.#isPlaying) this.#restart();
    else this.#followers.get(video).stand(this.#middle(this.frame));
  }

  /** Forget everything and stop. */
  clear() {
    this.#turn += 1;
    this.#listening.abort();
    this.#listening = new AbortController();
    this.#isPlaying = this.#isWaiting = false;
    this.#limit = null;
    for (const media of [this.#sound, ...this.#followers.keys()]) {
      media?.pause();
      media?.removeAttribute("src");
      media?.load();
    }
    this.#sound = null;
    this.#followers.clear();
    this.#loop = null;
    this.#numFrames = 0;
  }

  toggle() {
    return this.#isPlaying ? this.pause() : this.play();
  }

  /** Start all together, from the start when the end was reached. */
  async play() {
    if (!this.#clock || this.#isPlaying) return;
    const [start, end] = this.#loop ?? [0, this.duration];
    if (this.frame >= Math.round(end * FPS) - 1 || this.time < start - FRAME_S) this.#stand(Math.round(start * FPS));
    this.#isPlaying = true;
    this.#tell("state");
    await this.#restart();
  }

  /** Stop all on the frame that the clock shows. */
  pause() {
    this.#turn += 1;
    this.#isPlaying = this.#isWaiting = false;
    this.#clock?.pause();
    this.#stand(this.frame);
    this.#tell("state");
  }

  /** Show the frame that is on at `seconds`, playing or not. */
  seek(seconds) {
    this.seekFrame(Math.floor(seconds * FPS + 1e-4));
  }

  seekFrame(frame) {
    this.#stand(Math.max(0, Math.min(frame, this.#numFrames - 1)));
    if (this.#isPlaying) this.#restart();
  }

  /** Go some frames on or back, and stand there. */
  step(frames) {
    if (this.#isPlaying) this.pause();
    this.seekFrame(this.frame + frames);
  }

  setRate(rate) {
    this.#rate = rate;
    for (const follower of this.#followers.values()) follower.setRate(rate);
    if (this.#clock) this.#clock.playbackRate = rate;
    if (this.#isPlaying) this.#restart();
    this.#tell("state");
  }

  /** Play [start, end) in seconds again and again, or with null everything once. */
  setLoop(range) {
    this.#loop = range;
    if (range && this.#isPlaying && (this.time < range[0] || this.time >= range[1])) this.seek(range[0]);
    this.#tell("state");
  }

  #listen(media) {
    const { signal } = this.#listening;
    media.addEventListener("loadedmetadata", () => this.#measure(), { signal });
    media.addEventListener("ended", () => media === this.#clock && this.#end(), { signal });
    if (media.readyState >= HTMLMediaElement.HAVE_METADATA) this.#measure();
  }

  /** As long as the sound, or without one as the longest video, in whole frames. */
  #measure() {
    const lengths = (this.#sound ? [this.#sound] : [...this.#followers.keys()]).map(({ duration }) => duration);
    const known = lengths.filter(Number.isFinite);
    this.#numFrames = known.length ? Math.max(1, Math.round(Math.max(...known) * FPS)) : 0;
    this.#tell("state");
  }

  #middle(frame) {
    return (frame + 0.5) * FRAME_S;
  }

  /** Everything on one frame, without a change of whether it plays. */
  #stand(frame) {
    this.#turn += 1;
    const time = this.#middle(frame);
    const clock = this.#clock;
    if (clock) clock.currentTime = Math.min(time, clock.duration || time);
    for (const follower of this.#led) follower.stand(time);
    this.#tell("time");
  }

  /** Stop, wait until every video has its frame, and start all at once. */
  async #restart() {
    if (this.#isAtLimit) return this.#wait();
    const turn = ++this.#turn;
    const clock = this.#clock;
    if (this.#isWaiting) {
      this.#isWaiting = false;
      this.#tell("state");
    }
    clock.pause();
    const led = this.#led;
    for (const follower of led) follower.stand(clock.currentTime);
    await Promise.all([clock, ...led.map(({ video }) => video)].map(isReady));
    if (turn !== this.#turn || !this.#isPlaying) return;
    clock.playbackRate = this.#rate;
    for (const follower of led) follower.start(this.#rate);
    try {
      await clock.play();
    } catch {
      if (turn === this.#turn) this.pause(); // the browser wants a click first, or has no more of it
      return;
    }
    if (turn === this.#turn) this.#run(turn);
  }

  /** Lead the videos from picture to picture for as long as this start lasts. */
  #run(turn) {
    if (turn !== this.#turn) return;
    const clock = this.#clock;
    if (this.#loop && clock.currentTime >= this.#loop[1] - FRAME_S / 2) {
      this.seek(this.#loop[0]);
      return;
    }
    if (this.#isAtLimit) {
      this.#wait();
      this.#tell("time");
      return;
    }
    for (const follower of this.#led) follower.lead(clock, this.#rate);
    this.#tell("time");
    requestAnimationFrame(() => this.#run(turn));
  }

  #end() {
    if (!this.#isPlaying) return;
    if (this.#isAtLimit) return this.#wait();
    if (this.#loop) this.seek(this.#loop[0]);
    else {
      this.pause();
      this.seekFrame(this.#numFrames - 1);
    }
  }

  #tell(type) {
    this.dispatchEvent(new Event(type));
  }
}

/** One video and how far it is from the clock. */
class Follower {
  #seen = null; // what the browser last said of a shown frame
  #jumped = -Infinity;
  #wanted = null; // where to go once the seek under way has ended
  #hasRun = false; // since it last stood: then a picture may be due that a pause has kept back
  #rate = 1;

  constructor(video) {
    this.video = video;
    video.addEventListener("seeked", () => {
      if (this.#wanted !== null) this.stand(this.#wanted);
    });
  }

  /** Pause and show the picture at `seconds`; while an earlier wish is met, only the last counts. */
  stand(seconds) {
    const { video } = this;
    video.pause();
    this.#seen = null;
    const time = Math.min(seconds, this.#lastMoment);
    if (video.seeking) {
      this.#wanted = seconds;
      return;
    }
    this.#wanted = null;
    if (this.#hasRun || Math.abs(video.currentTime - time) > FRAME_S / 100) video.currentTime = time;
    this.#hasRun = false;
  }

  start(rate) {
    this.#jumped = performance.now();
    this.setRate(rate);
    if (this.video.currentTime < this.#lastMoment) this.#play();
    this.#watch();
  }

  #play() {
    this.#hasRun = true;
    this.video.play().catch(() => {}); // paused again
  }

  setRate(rate) {
    this.#rate = rate;
    this.video.playbackRate = rate;
  }

  /** Seconds ahead of the clock: of the shown frame where the browser tells of it. */
  drift(clock) {
    const age = this.#seen ? (performance.now() - this.#seen.shownAt) / 1000 : Infinity;
    if (age > STALE_S) return this.video.currentTime - clock.currentTime;
    return this.#seen.mediaTime + FRAME_S / 2 - (clock.currentTime - age * clock.playbackRate);
  }

  lead(clock, rate) {
    const { video } = this;
    if (video.seeking || clock.seeking || clock.currentTime >= this.#lastMoment) return;
    if (video.paused) this.#play();
    const drift = this.drift(clock);
    const now = performance.now();
    if (Math.abs(drift) > JUMP_S && now - this.#jumped > CALM_MS) {
      this.#jumped = now;
      this.#seen = null;
      this.setRate(rate);
      video.currentTime = Math.min(clock.currentTime, this.#lastMoment);
      return;
    }
    const change = Math.max(-MOST_CHANGE, Math.min(MOST_CHANGE, -GAIN * drift));
    const wanted = Math.abs(drift) < TOLERANCE_S ? rate : rate * (1 + change);
    if (Math.abs(wanted - this.#rate) > 0.01 * rate || (wanted === rate && this.#rate !== rate)) this.setRate(wanted);
  }

  /** The middle of the last frame: a seek to the very end shows nothing in some browsers. */
  get #lastMoment() {
    const { duration } = this.video;
    return Number.isFinite(duration) ? Math.max(0, duration - FRAME_S / 2) : Infinity;
  }

  #watch() {
    const { video } = this;
    if (!video.requestVideoFrameCallback || this.isWatching) return;
    this.isWatching = true;
    const note = (_, { mediaTime, expectedDisplayTime }) => {
      this.#seen = { mediaTime, shownAt: expectedDisplayTime };
      if (video.paused) this.isWatching = false;
      else video.requestVideoFrameCallback(note);
    };
    video.requestVideoFrameCallback(note);
  }
}

/**
 * Resolves when a medium stands where it was told to and can go on from there.
 *
 * @param {HTMLMediaElement} media
 * @returns {Promise<void>}
 */
function isReady(media) {
  const isThere = () => {
    const isAtEnd = media.duration - media.currentTime < 2 * FRAME_S;
    const enough = isAtEnd ? HTMLMediaElement.HAVE_CURRENT_DATA : ENOUGH;
    return media.error || (!media.seeking && media.readyState >= enough);
  };
  return new Promise((resolve) => {
    const events = ["seeked", "canplay", "loadeddata", "progress", "error", "emptied"];
    const look = () => {
      if (!isThere() && media.isConnected) return;
      for (const name of events) media.removeEventListener(name, look);
      resolve();
    };
    for (const name of events) media.addEventListener(name, look);
    look();
  });
}
