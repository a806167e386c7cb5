/** The player's clock, over a sound that does what it is told in a time that the test lets pass. */

import assert from "node:assert/strict";
import { test } from "node:test";

Object.assign(globalThis, { HTMLMediaElement: { HAVE_METADATA: 1, HAVE_CURRENT_DATA: 2, HAVE_FUTURE_DATA: 3 } });
const { Lockstep } = await import("../../app/page/web/player/lockstep.js");

const FRAME_S = 1 / 30;
const TICK_MS = 10; // between two pictures
let waiting = [];
let sound = null;
globalThis.requestAnimationFrame = (next) => waiting.push(next);

class Sound extends EventTarget {
  readyState = 4;
  paused = true;
  seeking = false;
  isConnected = true;
  error = null;
  playbackRate = 1;
  currentTime = 0;
  duration = 3;

  async play() {
    this.paused = false;
  }

  pause() {
    this.paused = true;
  }

  run(seconds) {
    if (this.paused) return;
    this.currentTime = Math.min(this.duration, this.currentTime + seconds * this.playbackRate);
    if (this.currentTime < this.duration) return;
    this.paused = true;
    this.dispatchEvent(new Event("ended"));
  }
}

/** Let time pass, picture by picture. */
async function pass(seconds) {
  for (let left = seconds; left > 1e-9; left -= TICK_MS / 1000) {
    sound.run(TICK_MS / 1000);
    const due = waiting;
    waiting = [];
    for (const each of due) each();
    for (let k = 0; k < 12; k++) await Promise.resolve(); // whoever waited for the sound goes on
  }
}

/** A clock of three seconds. */
function started() {
  const player = new Lockstep();
  waiting = [];
  sound = new Sound();
  player.setSound(sound);
  return player;
}

test("a moment is a frame, in whose middle the sound stands", () => {
  const player = started();
  assert.equal(player.duration, 3);
  for (const [seek, frame] of [[1, 30], [29.999 / 30, 29], [9, 89], [-1, 0]]) {
    player.seek(seek);
    assert.equal(player.frame, frame);
    assert.ok(Math.abs(sound.currentTime - (frame + 0.5) * FRAME_S) < 1e-9);
  }
  player.seekFrame(10);
  player.step(2);
  player.step(-5);
  assert.equal(player.frame, 7);
});

test("a pause stands on the frame that is shown, and a start after the end is from the start", async () => {
  const player = started();
  await player.play();
  await pass(0.5);
  player.pause();
  const stood = player.frame;
  assert.ok(Math.abs(stood - 15) <= 1);
  await pass(0.3);
  assert.equal(player.frame, stood);
  player.toggle();
  player.setRate(0.5);
  const before = sound.currentTime;
  await pass(0.4);
  assert.ok(Math.abs(sound.currentTime - before - 0.2) < 0.03);
  player.setRate(1);
  await pass(4);
  assert.deepEqual([player.isPlaying, player.frame], [false, 89]);
  await player.play();
  assert.equal(player.frame, 0);
  await pass(0.2);
  assert.ok(!sound.paused);
});

test("a loop is played again and again, and begun where it begins", async () => {
  const player = started();
  player.setLoop([1, 2]);
  await player.play();
  assert.equal(player.frame, 30);
  const frames = new Set();
  for (let k = 0; k < 25; k++) {
    await pass(0.1);
    frames.add(player.frame);
  }
  assert.ok(player.isPlaying && Math.min(...frames) >= 30 && Math.max(...frames) < 60);
  player.setLoop(null);
  await pass(3);
  assert.deepEqual([player.isPlaying, player.frame], [false, 89]);
});

test("where more is to come it waits short of the last frame there is, and goes on by itself", async () => {
  const player = started();
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
