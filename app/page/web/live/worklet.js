/**
 * Sound of any rate to blocks of 16 kHz mono, in the browser's audio thread. A block of 640 samples
 * (40 ms) is posted as 16-bit numbers, with its peak; silence comes where nothing is connected.
 */

const RATE = 16000;
const BLOCK = 640;
const ZEROS = 16; // of the sinc, on either side
const PHASES = 256;
const PASS = 0.92; // of the band below 8 kHz

class Blocks extends AudioWorkletProcessor {
  #step = sampleRate / RATE;
  #half = Math.ceil(ZEROS * Math.max(1, sampleRate / RATE));
  #kernels = [];
  #input = [];
  #first = 0; // number of the first sample in #input
  #next = 0; // place of the next output, in input samples
  #block = new Int16Array(BLOCK);
  #filled = 0;
  #peak = 0;

  process([input]) {
    this.#input.push(...(input[0] ?? new Float32Array(128)));
    while (this.#next + this.#half < this.#first + this.#input.length) {
      this.#give(this.#at(this.#next));
      this.#next += this.#step;
    }
    const spent = Math.floor(this.#next) - this.#half - this.#first;
    if (spent > 4096) {
      this.#input.splice(0, spent);
      this.#first += spent;
    }
    return true;
  }

  /** The sound at a place between samples: a windowed sinc. */
  #at(place) {
    const whole = Math.floor(place);
    const phase = Math.round((place - whole) * PHASES);
    const kernel = (this.#kernels[phase] ??= this.#kernel(phase / PHASES));
    let sum = 0;
    for (let k = 0; k < kernel.length; k++) {
      sum += kernel[k] * (this.#input[whole - this.#half + 1 + k - this.#first] ?? 0);
    }
    return sum;
  }

  #kernel(shift) {
    const cut = PASS / Math.max(1, this.#step);
    const weights = Array.from({ length: 2 * this.#half }, (_, k) => {
      const x = k - this.#half + 1 - shift;
      const sinc = x === 0 ? 1 : Math.sin(Math.PI * cut * x) / (Math.PI * cut * x);
      return sinc * (0.5 + 0.5 * Math.cos((Math.PI * x) / (this.#half + 1)));
    });
    const sum = weights.reduce((a, b) => a + b, 0);
    return weights.map((weight) => weight / sum);
  }

  #give(value) {
    this.#peak = Math.max(this.#peak, Math.abs(value));
    this.#block[this.#filled++] = Math.max(-32768, Math.min(32767, Math.round(32768 * value)));
    if (this.#filled < BLOCK) return;
    this.port.postMessage({ block: this.#block, peak: this.#peak }, [this.#block.buffer]);
    [this.#block, this.#filled, this.#peak] = [new Int16Array(BLOCK), 0, 0];
  }
}

registerProcessor("blocks", Blocks);
