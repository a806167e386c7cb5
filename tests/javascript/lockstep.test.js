/** The player's clock, over media that do what they are told in a time that the test lets pass. */

import assert from "node:assert/strict";
import { beforeEach, test } from "node:test";

Object.assign(globalThis, { HTMLMediaElement: { HAVE_METADATA: 1, HAVE_CURRENT_DATA: 2, HAVE_FUTURE_DATA: 3 } });
const { Lockstep } = await import("../../app/page/web/player/lockstep.js");

const FRAME_S = 1 / 30;
const TICK_MS = 10; // between two pictures
let now = 0;
let waiting = [];
let media = [];
globalThis.requestAnimationFrame = (next) => waiting.push(next);
globalThis.performance.now = () => now;

/** A sound or a video that runs `pace` times as fast as it should. */
class Medium extends EventTarget {
  readyState = 4;
  paused = true;
  seeking = false;
  isConnected = true;
  error = null;
  playbackRate = 1;
  sought = 0;
  #time = 0;

  constructor(duration, pace = 1) {
    super();
    this.duration = duration;
    this.pace = pace;
    media.push(this);
  }

  get currentTime() {
    return this.#time;
  }

  set currentTime(time) {
    this.#time = time;
    this.sought += 1;
  }

  async play() {
    this.paused = false;
  }

  pause() {
    this.paused = true;
  }

  run(seconds) {
    if (this.paused) return;
    this.#time = Math.min(this.duration, this.#time + seconds * this.playbackRate * this.pace);
    if (this.#time < this.duration) return;
    this.paused = true;
    this.dispatchEvent(new Event("ended"));
  }
}

/** Let time pass, picture by picture. */
async function pass(seconds) {
  for (let left = seconds; left > 1e-9; left -= TICK_MS / 1000) {
    now += TICK_MS;
    for (const medium of media) medium.run(TICK_MS / 1000);
    const due = waiting;
    waiting = [];
    for (const each of due) each();
    for (let k = 0; k < 12; k++) await Promise.resolve(); // whoever waited for a medium goes on
  }
}

/** A clock of three seconds with videos, of which each runs as fast as is said. */
function started(...paces) {
  const player = new Lockstep();
  const sound = new Medium(3);
  player.setSound(sound);
  const videos = paces.map((pace) => new Medium(3, pace));
  for (const video of videos) player.add(video);
  return { player, sound, videos };
}

const off = ({ sound, videos }) => Math.max(...videos.map((video) => Math.abs(video.currentTime - sound.currentTime)));

beforeEach(() => {
  [now, waiting, media] = [0, [], []];
});

test("a moment is a frame, in its middle, for the sound and every video", () => {
  const { player, sound, videos } = started(1, 1);
  assert.equal(player.duration, 3);
  for (const [seek, frame] of [[1, 30], [29.999 / 30, 29], [9, 89], [-1, 0]]) {
    player.seek(seek);
    assert.equal(player.frame, frame);
    for (const medium of [sound, ...videos]) assert.ok(Math.abs(medium.currentTime - (frame + 0.5) * FRAME_S) < 1e-9);
  }
  player.seekFrame(10);
  player.step(2);
  player.step(-5);
  assert.equal(player.frame, 7);
});

test("videos that run too fast or too slowly are led back, and one that is thrown off jumps", async () => {
  const all = started(1.05, 0.95);
  await all.player.play();
  await pass(1);
  assert.ok(off(all) < FRAME_S, `${off(all)}`);
  const [fast, slow] = all.videos.map(({ playbackRate }) => playbackRate);
  assert.ok(fast < 1 && slow > 1 && fast >= 0.8 && slow <= 1.2, "by their speed");
  all.videos[0].currentTime += 0.5;
  await pass(0.3);
  assert.ok(off(all) < FRAME_S, "by a jump");
  assert.ok(all.player.isPlaying && all.sound.playbackRate === 1, "the sound is never bent");
  all.player.setRate(0.5);
  const before = all.sound.currentTime;
  await pass(0.4);
  assert.ok(Math.abs(all.sound.currentTime - before - 0.2) < 0.03 && off(all) < FRAME_S);
});

test("a pause stops all on the frame that the sound shows, and a start after the end is from the start", async () => {
  const { player, sound, videos } = started(1.1);
  await player.play();
  await pass(0.5);
  player.pause();
  const stood = player.frame;
  assert.ok(Math.abs(stood - 15) <= 1);
  assert.equal(Math.floor(videos[0].currentTime * 30), stood);
  await pass(0.3);
  assert.equal(player.frame, stood);
  player.toggle();
  await pass(4);
  assert.deepEqual([player.isPlaying, player.frame], [false, 89]);
  await player.play();
  assert.equal(player.frame, 0);
  await pass(0.2);
  assert.ok(!sound.paused);
});

test("a pause has a video that ran show its picture anew, even where it stands right", async () => {
  const { player, sound, videos } = started(1, 1);
  await player.play();
  await pass(0.5);
  videos[0].currentTime = (Math.floor(sound.currentTime * 30) + 0.5) * FRAME_S;
  const before = videos.map(({ sought }) => sought);
  player.pause();
  assert.deepEqual(videos.map(({ sought }, k) => sought - before[k]), [1, 1]);
  player.seekFrame(player.frame);
  assert.deepEqual(videos.map(({ sought }, k) => sought - before[k]), [1, 1], "once");
});

test("a loop is played again and again, and begun where it begins", async () => {
  const { player } = started(1);
  player.setLoop([1, 2]);
  await player.play();
  assert.equal(player.frame, 30);
  const seen = new Set();
  for (let k = 0; k < 25; k++) {
    await pass(0.1);
    seen.add(player.frame);
  }
  assert.ok(player.isPlaying && Math.min(...seen) >= 30 && Math.max(...seen) < 60);
  player.setLoop(null);
  await pass(3);
  assert.deepEqual([player.isPlaying, player.frame], [false, 89]);
});

test("where more is to come it waits short of the last frame there is, and goes on by itself", async () => {
  const { player, sound } = started(1);
  player.setLimit(40);
  await player.play();
  await pass(1);
  sound.currentTime = 1.6; // a busy machine has let it run on
  await pass(1);
  assert.deepEqual([player.isPlaying, player.isWaiting, sound.paused], [true, true, true]);
  assert.equal(player.frame, 38);
  player.setLimit(60);
  await pass(0.1);
  assert.ok(player.isWaiting, "less than a second more is not worth a start");
  player.setLimit(null);
  await pass(0.3);
  assert.ok(!player.isWaiting && player.frame > 40);
  await pass(3);
  assert.deepEqual([player.isPlaying, player.frame], [false, 89]);
});
