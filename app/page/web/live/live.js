/**
 * The tab "Live": speak, and a body moves. Sound goes to the server in blocks; joint rotations come
 * back and move a body that is drawn here. The picture lives in the tab of one visitor; the server
 * keeps the last minute of it, which `kept` names.
 */

import { make } from "../dom.js";
import { GlbView, isDrawingSlow } from "../body/glb_view.js";
import { Playout } from "./playout.js";
import { Sound } from "./sound.js";
import { ORBIT_HELP, Orbit } from "../body/orbit.js";

const PICTURE_PX = 640;
const SLOW_PICTURE_PX = 360; // where the processor draws
const SLOW_REST = 1; // after a picture that a processor drew, as a share of the time that took
const LEAST_FACE = 0.01;
const FOLLOW_MS = 3000; // in which the camera goes most of the way after the body
const LATE_MS = 1500;
const LATE_FOR_MS = 3000; // before it is said
const LOST = "The connection to the server was lost; start again.";
const READY = "Press Start, then speak. The body follows about a second later.";

class Live {
  #root;
  #told;
  #view = null;
  #socket = null;
  #sound = null;
  #playout = null;
  #token = "";
  #news = null;
  #lateSince = null;
  #drawnAt = 0;
  #isDrawing = false;
  #restUntil = 0;
  #centre = null; // what the camera looks at
  #pose = null;
  #pace = null;
  #order = []; // names of the face weights, as they come
  #run = null; // what Start began; null while nothing goes on
  #doing = "";

  constructor(root, told) {
    this.#root = root;
    this.#told = told;
    this.#build();
    this.#showBodyOnceSeen();
    root.live = this; // for whoever wants to look at it from outside
  }

  /** The session whose last minute can be kept; stops it. */
  kept() {
    this.stop("Stopped: the last minute is being kept, below.");
    return this.#token;
  }

  /** Measured, ms; null until there is a picture. */
  get latency() {
    return this.#playout?.latency ?? null;
  }

  /** Rotations of the last picture. */
  get pose() {
    return this.#pose;
  }

  get socket() {
    return this.#socket;
  }

  // -------------------------------------------------------------- what is seen

  #build() {
    const { systems, speakers, examples } = this.#told;
    const choice = (label, name, options) => {
      const select = make("select", { name }, ...options.map(([value, text]) => make("option", { value }, text)));
      return [make("label", {}, make("span", {}, label), select), select];
    };
    const sources = [["microphone", "Microphone"], ...examples.map(({ url, label }) => [url, `Example: ${label}`]), ["file", "A file of yours …"]];
    const [sourceLabel, source] = choice("What is spoken", "source", sources);
    const [systemLabel, system] = choice("System", "system", systems.map((name) => [name, name]));
    const [speakerLabel, speaker] = choice("Speaker style", "speaker", speakers.map((name) => [name, name]));
    const file = make("input", { type: "file", accept: "audio/*", "aria-label": "Sound to play as if spoken" });
    const filePart = make("div", { class: "file", hidden: true }, file, make("small", {}, "It stays in your browser; the server hears it as it is played."));
    source.addEventListener("change", () => { filePart.hidden = source.value !== "file"; });
    this.fields = { source, system, speaker, file };
    this.button = make("button", { class: "start", type: "button", onclick: () => (this.#socket ? this.stop() : this.start()) }, "Start");
    this.level = make("meter", { min: 0, max: 1, value: 0, "aria-label": "Loudness of what is heard" });
    this.status = make("p", { role: "status", "aria-live": "polite" }, READY);
    this.canvas = make("canvas", { width: PICTURE_PX, height: PICTURE_PX, role: "application", tabindex: "0", "aria-label": `The body that follows your speech. ${ORBIT_HELP}`, title: ORBIT_HELP });
    this.number = make("b", {}, "–");
    this.parts = make("small");
    this.#root.replaceChildren(
      make("div", { class: "asked" }, sourceLabel, filePart, systemLabel, speakerLabel, this.button, this.level, this.status,
        make("p", { class: "latency", title: "From the moment a sound is captured to the picture that answers it, measured here" }, "From sound to moved body ", this.number, this.parts)),
      make("div", { class: "picture" }, this.canvas),
    );
  }

  #say(sentence, isBad = false) {
    this.status.textContent = sentence;
    this.status.classList.toggle("bad", isBad);
  }

  // -------------------------------------------------------------- a session

  async start() {
    this.stop("Starting …");
    this.button.textContent = "Stop";
    const run = (this.#run = {});
    const sound = new Sound((block, peak) => this.#onBlock(block, peak), (why) => this.stop(why || "The sound is over. Press Start for more.", !!why));
    this.#sound = sound;
    this.#playout = new Playout();
    this.#centre = null;
    try {
      await this.#showBody();
      if (this.#run !== run) return;
      const bytes = await this.#bytes();
      await this.#connect();
      if (this.#run !== run) return;
      if (bytes) await sound.play(bytes);
      else await sound.listen();
      if (this.#run !== run) return sound.close();
      this.#doing = bytes ? "Playing. You hear it when the body moves to it." : "Listening: speak.";
      this.#say(this.#doing);
      this.#draw(run);
    } catch (error) {
      if (this.#run === run) this.stop(error.message, true);
    }
  }

  stop(sentence = "Stopped. Keep the last minute, or start again.", isBad = false) {
    this.#run = null;
    const socket = this.#socket;
    this.#socket = null;
    socket?.close();
    this.#sound?.close();
    this.#sound = null;
    this.button.textContent = "Start";
    this.level.value = 0;
    this.#say(sentence, isBad);
  }

  /** The body stands there before anything is started; what fails is told when it is. */
  #showBodyOnceSeen() {
    const seen = new IntersectionObserver(([entry]) => {
      if (!entry.isIntersecting) return;
      seen.disconnect();
      this.#showBody().catch(() => {});
    });
    seen.observe(this.canvas);
  }

  async #showBody() {
    if (this.#view) return;
    const isSlow = isDrawingSlow();
    if (isSlow) this.canvas.width = this.canvas.height = SLOW_PICTURE_PX;
    const view = new GlbView(this.canvas, { antialias: !isSlow });
    await view.load("live/body.glb");
    view.orbit = new Orbit();
    view.seek(0);
    this.#view = view;
    view.orbit.hold(this.canvas);
    view.orbit.addEventListener("change", () => this.#run || view.redraw()); // while it moves, the next picture comes anyhow
  }

  /** Of the sound that is played; null for the microphone. */
  async #bytes() {
    const { source, file } = this.fields;
    if (source.value === "microphone") return null;
    if (source.value === "file") {
      if (!file.files.length) throw new Error("Choose a file first.");
      return file.files[0].arrayBuffer();
    }
    const answer = await fetch(source.value);
    if (!answer.ok) throw new Error("The example cannot be fetched; load the page again.");
    return answer.arrayBuffer();
  }

  /**
   * Resolves when the server is ready to hear.
   *
   * @returns {Promise<void>}
   */
  #connect() {
    const url = new URL("live/speak", document.baseURI);
    url.protocol = url.protocol.replace("http", "ws");
    const socket = new WebSocket(url);
    socket.binaryType = "arraybuffer";
    this.#socket = socket;
    return new Promise((resolve, reject) => {
      socket.onopen = () => {
        const { system, speaker } = this.fields;
        socket.send(JSON.stringify({ system: system.value, speaker: speaker.value, seed: Math.floor(Math.random() * 2 ** 31) }));
      };
      socket.onmessage = ({ data }) => {
        if (data instanceof ArrayBuffer) return this.#onFrames(data);
        const told = JSON.parse(data);
        if ("end" in told) {
          reject(new Error(told.end));
          if (this.#socket === socket) this.stop(told.end, true);
          return;
        }
        this.#token = told.token;
        this.#pace = told;
        this.#order = told.faces;
        resolve();
      };
      socket.onclose = () => {
        reject(new Error(LOST));
        if (this.#socket === socket) this.stop(LOST, true);
      };
    });
  }

  #onBlock(block, peak) {
    if (this.#socket?.readyState !== WebSocket.OPEN) return;
    this.#playout.captured(block.length);
    this.#socket.send(block.buffer);
    this.level.value = Math.max(0, 1 + Math.log10(Math.max(peak, 1e-3)) / 2.5);
  }

  #onFrames(message) {
    this.#news = this.#playout.take(message);
    if (this.#sound) this.#sound.delay = this.#playout.delay / 1000;
  }

  // -------------------------------------------------------------- the picture

  #draw(run) {
    if (this.#run !== run) return;
    requestAnimationFrame(() => this.#draw(run));
    const time = performance.now();
    if (this.#isDrawing && !this.#view.isDrawing) this.#isDrawn(time);
    if (this.#isDrawing || time < this.#restUntil) return;
    const pair = this.#playout.now();
    if (!pair) return;
    const passed = time - this.#drawnAt;
    this.#drawnAt = time;
    this.#isDrawing = true;
    this.#view.pose(...this.#between(...pair, passed));
  }

  /** The picture is there; the next one leaves a processor that draws time for other things. */
  #isDrawn(time) {
    this.#isDrawing = false;
    this.#playout.shown();
    if (this.#view.isSlow) this.#restUntil = time + SLOW_REST * (time - this.#drawnAt);
    this.#tell(time);
  }

  /** A pose between two frames, `passed` ms after the last one. */
  #between(one, two, share, passed) {
    const mix = (a, b) => a + share * (b - a);
    const place = Array.from(one.position, (value, i) => mix(value, two.position[i]));
    const follow = 1 - Math.exp(-passed / FOLLOW_MS);
    this.#centre = this.#centre?.map((value, i) => value + follow * (place[i] - value)) ?? place;
    const position = [place[0] - this.#centre[0], place[1], place[2] - this.#centre[2]];
    const rotations = (this.#pose ??= new Float32Array(one.rotations.length));
    for (let at = 0; at < rotations.length; at += 4) {
      let dot = 0;
      for (let i = at; i < at + 4; i++) dot += one.rotations[i] * two.rotations[i];
      const sign = dot < 0 ? -1 : 1; // the short way
      for (let i = at; i < at + 4; i++) rotations[i] = mix(one.rotations[i], sign * two.rotations[i]);
    }
    const weights = this.#view.faces.map((name) => {
      const k = this.#order.indexOf(name);
      const weight = k < 0 ? 0 : mix(one.faces[k], two.faces[k]) / 255;
      return weight < LEAST_FACE ? 0 : weight;
    });
    return [position, rotations, weights];
  }

  #tell(time) {
    const { latency } = this.#playout;
    const { madeMs, waitedMs, visitors } = this.#news;
    const seconds = (ms) => `${(ms / 1000).toFixed(2)} s`;
    this.number.textContent = seconds(latency);
    this.#root.dataset.latency = latency.toFixed(0);
    const heard = ((this.#pace.ahead + this.#pace.hop) * 1000) / 30;
    const rest = Math.max(0, latency - heard - waitedMs - madeMs);
    this.parts.textContent = `hears ${seconds(heard)} · waits ${seconds(waitedMs)} · makes ${seconds(madeMs)} · sends and draws ${seconds(rest)}`;
    this.#lateSince = latency > LATE_MS ? (this.#lateSince ?? time) : null;
    if (this.#lateSince !== null && time - this.#lateSince > LATE_FOR_MS) {
      const who = visitors > 1 ? ` with ${visitors} who speak at once` : "";
      this.#say(`The machine is slow${who}: the body follows ${(latency / 1000).toFixed(1)} s after the voice.`, true);
    } else if (this.status.classList.contains("bad")) {
      this.#say(this.#doing);
    }
  }

  dispose() {
    this.stop();
    this.#view?.dispose();
  }
}

/** Called by Gradio's component. */
export function mountLive(element, props) {
  const root = element.querySelector(".live");
  const live = new Live(root, JSON.parse(JSON.stringify(props.value ?? {})));
  const gone = new MutationObserver(() => {
    if (root.isConnected) return;
    gone.disconnect();
    live.dispose();
  });
  gone.observe(document.body, { childList: true, subtree: true });
}
