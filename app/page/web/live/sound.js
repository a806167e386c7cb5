/** What is spoken: the microphone, or a file as if it were spoken, in blocks of 16 kHz mono. */

const CONSTRAINTS = { channelCount: 1, echoCancellation: false };
const TAIL_S = 2; // of silence after a file, so that the body comes to its end

export class Sound {
  #context = new AudioContext();
  #stream = null;
  #source = null;
  #delay = null;
  #blocks = null;

  /**
   * @param onBlock called with 16-bit samples and their peak (0 to 1), 25 times a second
   * @param onEnd called when a file is over, or the microphone was taken away
   */
  constructor(onBlock, onEnd) {
    this.onBlock = onBlock;
    this.onEnd = onEnd;
  }

  /** Rejects with an Error that holds a sentence. */
  async listen() {
    if (!navigator.mediaDevices) {
      throw new Error("Browsers allow the microphone only on https pages or on localhost. Choose an example or a file.");
    }
    try {
      this.#stream = await navigator.mediaDevices.getUserMedia({ audio: CONSTRAINTS });
    } catch (cause) {
      throw new Error(refusal(cause), { cause });
    }
    const [track] = this.#stream.getAudioTracks();
    track.addEventListener("ended", () => this.onEnd("The microphone was disconnected. Start again."));
    await this.#begin(this.#context.createMediaStreamSource(this.#stream));
  }

  /** Play sound (the bytes of a file) as if it were spoken; it is heard, `delay` later. */
  async play(bytes) {
    let buffer;
    try {
      buffer = await this.#context.decodeAudioData(bytes);
    } catch (cause) {
      throw new Error("This browser cannot read the audio in this file. Choose a WAV, MP3, OGG or M4A file.", { cause });
    }
    const source = this.#context.createBufferSource();
    source.buffer = buffer;
    this.#delay = this.#context.createDelay(10);
    this.#delay.delayTime.value = 1;
    source.connect(this.#delay).connect(this.#context.destination);
    source.addEventListener("ended", () => setTimeout(() => this.onEnd(""), 1000 * TAIL_S));
    await this.#begin(source);
    source.start();
  }

  async #begin(source) {
    await this.#context.audioWorklet.addModule(new URL("worklet.js", import.meta.url));
    /** @type {AudioWorkletNodeOptions} */
    const options = { numberOfInputs: 1, numberOfOutputs: 1, channelCount: 1, channelCountMode: "explicit" };
    this.#blocks = new AudioWorkletNode(this.#context, "blocks", options);
    this.#blocks.port.onmessage = ({ data }) => this.onBlock(data.block, data.peak);
    this.#source = source;
    source.connect(this.#blocks).connect(this.#context.destination); // which it gives silence
    await this.#context.resume();
  }

  /** A file is heard so many seconds later than it is spoken: when the body moves to it. */
  set delay(seconds) {
    if (this.#delay && Math.abs(this.#delay.delayTime.value - seconds) > 0.06) {
      this.#delay.delayTime.value = Math.min(10, seconds);
    }
  }

  close() {
    this.onBlock = this.onEnd = () => {};
    this.#stream?.getTracks().forEach((track) => track.stop());
    this.#source?.disconnect();
    this.#blocks?.disconnect();
    if (this.#context.state !== "closed") this.#context.close();
  }
}

function refusal({ name }) {
  if (name === "NotAllowedError") {
    return "The browser denied access to the microphone. Allow it for this page, or choose an example or a file.";
  }
  if (name === "NotFoundError") return "No microphone was found: connect one, or choose an example or a file.";
  return "The microphone is not available; another program may be using it. Close that program and start again.";
}
