/**
 * The tab "Live": speak, and a body moves. Sound goes to the server in blocks; joint rotations come
 * back and move a body that is drawn here. The picture lives in the tab of one visitor; the server
 * keeps the last minute of it, which `stopForSaving` names.
 */

import { make } from "../dom.js";
import { currentFilter, followFilter } from "../filter_switch.js";
import { Displays } from "../player/displays.js";
import { answered, theFacts } from "../fetched.js";
import { own, theWorn } from "../stage/character.js";
import { Look } from "../stage/look.js";
import { unpacked } from "../stage/motion.js";
import { Stage } from "../stage/stage.js";
import { Planned } from "./planned.js";
import { Playout } from "./playout.js";
import { Following, Rolling } from "./rolling.js";
import { Sound } from "./sound.js";

const NAME = "live"; // of the one row
const COLOR = "#2e86de";
const AHEAD_MS = 200; // that filters look ahead
const SLOW_REST = 1; // after a picture that a processor drew, as a share of the time that took
const LATE_MS = 1500;
const LATE_FOR_MS = 3000; // before it is said
const LOST = "Connection to the server lost. Press Start to try again.";
const READY = "Press Start, then speak. The body follows about a second later.";
const KEEPS_ITS_KEYS = "input, textarea, select";

class Live {
  #root;
  #choices;
  #look = new Look();
  #stage = null; // null where the browser draws no 3D graphics
  #refusal = null; // why
  #bar = null;
  #rolling = null; // null until the body has come
  #cameras = null;
  socket = null;
  #sound = null;
  #playout = new Playout();
  #token = "";
  #news = null;
  #lateSince = null;
  #restUntil = 0;
  #pace = null;
  #run = null; // what Start began; null while nothing goes on
  #doing = "";
  #feed = () => {}; // the stage, with what has come

  constructor(root, choices) {
    this.#root = root;
    this.#choices = choices;
    this.#build();
    this.#setStage();
    root.live = this; // for whoever wants to look at it from outside
  }

  /** Stop, and return the token of the session, whose last minute can then be saved. */
  stopForSaving() {
    this.stop("Stopped. The last minute is being saved; the run will appear below.");
    return this.#token;
  }

  /** Measured, ms; null until there is a picture. */
  get latency() {
    return this.#playout.latency;
  }

  /** Frames since the first that was spoken, of what is shown. */
  get place() {
    return this.#playout.place;
  }

  // -------------------------------------------------------------- what is seen

  #build() {
    const { systems, speakers, examples } = this.#choices;
    const choice = (label, name, options) => {
      const select = make("select", { name }, ...options.map(([value, text]) => make("option", { value }, text)));
      return [make("label", {}, make("span", {}, label), select), select];
    };
    const sources = [["microphone", "Microphone"], ...examples.map(({ url, label }) => [url, `Example: ${label}`]), ["file", "Your own file …"]];
    const [sourceLabel, source] = choice("Audio source", "source", sources);
    const [systemLabel, system] = choice("System", "system", systems.map((name) => [name, name]));
    const [speakerLabel, speaker] = choice("Speaker style", "speaker", speakers.map((name) => [name, name]));
    const file = make("input", { type: "file", accept: "audio/*", "aria-label": "Audio file to play instead of the microphone" });
    const filePart = make("div", { class: "file", hidden: true }, file, make("small", {}, "The file stays in your browser; its audio is streamed to the server while it plays."));
    source.addEventListener("change", () => { filePart.hidden = source.value !== "file"; });
    this.fields = { source, system, speaker, file };
    this.button = make("button", { class: "start", type: "button", onclick: () => (this.socket ? this.stop() : this.start()) }, "Start");
    this.level = make("meter", { min: 0, max: 1, value: 0, "aria-label": "Input level" });
    this.status = make("p", { role: "status", "aria-live": "polite" }, READY);
    this.planned = new Planned((message) => this.socket?.readyState === WebSocket.OPEN && this.socket.send(message));
    this.picture = make("div", { class: "picture lockstep staged" });
    this.number = make("b", {}, "–");
    this.parts = make("small");
    this.#root.replaceChildren(
      make("div", { class: "asked" }, sourceLabel, filePart, systemLabel, speakerLabel, this.button, this.level, this.status,
        make("p", { class: "latency", title: "Time from the capture of a sound to the frame that responds to it" }, "Latency ", this.number, this.parts), this.planned.element),
      this.picture,
    );
  }

  /** The same stage as that of a run, with what switches its displays. */
  #setStage() {
    const changed = () => this.#bar?.update();
    try {
      this.#stage = new Stage(this.#playout, this.#look, changed);
    } catch (error) {
      this.#refusal = error;
      this.picture.append(make("p", { class: "no-stage", role: "note" }, `${error.message} The Live tab needs them.`));
      return;
    }
    this.#bar = new Displays(this.#look, this.#stage, {}, ["isAligned", "hasWords"]);
    const others = make("div", { class: "group compare" }, this.#bar.closeUp, this.#bar.more);
    this.picture.append(this.#stage.element, make("div", { class: "controls", role: "toolbar", "aria-label": "Displays" }, this.#bar.element, others), this.#bar.box);
    this.#bar.update();
    this.#stage.element.addEventListener("drawn", ({ detail }) => this.#isDrawn(detail));
    this.#look.addEventListener("change", () => this.#lookAhead());
    followFilter(() => this.#lookAhead());
    this.picture.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey || event.target.closest(KEEPS_ITS_KEYS)) return;
      if (this.#bar.press(event.key.toLowerCase())) event.preventDefault();
    });
    this.#showBodyOnceVisible();
    own.addEventListener("change", () => {
      if (this.#rolling) this.#showBody(true).catch((error) => this.#say(error.message, true));
    });
  }

  /** Filters know the motion on either side of a moment. */
  #lookAhead() {
    this.#playout.ahead = this.#look.get("factor") > 1 || currentFilter() === "savgol" ? AHEAD_MS : 0;
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
    const sound = new Sound((block, peak) => this.#onBlock(block, peak), (why) => this.stop(why || "The audio has ended. Press Start to play it again.", !!why));
    this.#sound = sound;
    this.#news = null;
    this.#playout.clear();
    try {
      await this.#showBody();
      if (this.#run !== run) return;
      const bytes = await this.#bytes();
      await this.#connect();
      if (this.#run !== run) return;
      if (bytes) await sound.play(bytes);
      else await sound.listen();
      if (this.#run !== run) return sound.close();
      this.#doing = bytes ? "Playing. The audio is delayed to match the motion." : "Listening: speak.";
      this.#say(this.#doing);
      this.#playout.go(true);
      this.#tick(run);
    } catch (error) {
      if (this.#run === run) this.stop(error.message, true);
    }
  }

  stop(sentence = "Stopped. Save the last minute, or start again.", isBad = false) {
    if (this.#run) this.#playout.go(false);
    this.#run = null;
    const socket = this.socket;
    this.socket = null;
    socket?.close();
    this.#sound?.close();
    this.#sound = null;
    this.button.textContent = "Start";
    this.level.value = 0;
    this.#say(sentence, isBad);
  }

  /** The body stands there before anything is started; what fails is told when it is. */
  #showBodyOnceVisible() {
    const observer = new IntersectionObserver(([entry]) => {
      if (!entry.isIntersecting) return;
      observer.disconnect();
      this.#showBody().catch(() => {});
    });
    observer.observe(this.picture);
  }

  async #showBody(isOther = false) {
    if (this.#refusal) throw this.#refusal;
    if (this.#rolling && !isOther) return;
    const [mesh, facts] = await Promise.all([theWorn(), theFacts()]);
    if (this.#rolling && !isOther) return; // both times at once
    const reaches = unpacked(Uint8Array.from(atob(facts.reaches), (letter) => letter.charCodeAt(0)).buffer);
    this.#rolling = new Rolling(mesh, facts.exaggeration.max_turn);
    this.#rolling.push(0, reaches.part(0, 1)); // at rest
    this.#cameras = new Following(mesh, facts, reaches, this.#rolling);
    this.#playout.rolling = this.#rolling;
    this.#feed = () => this.#stage.feed(NAME, this.#rolling.shown, this.#cameras, mesh, facts);
    this.#stage.show([{ name: NAME, label: "You speak", color: COLOR, stem: NAME, is_reference: false, noise: null }]);
    this.#feed();
  }

  /** Of the sound that is played; null for the microphone. */
  async #bytes() {
    const { source, file } = this.fields;
    if (source.value === "microphone") return null;
    if (source.value === "file") {
      if (!file.files.length) throw new Error("Choose a file first.");
      return file.files[0].arrayBuffer();
    }
    return (await answered(source.value)).arrayBuffer();
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
    this.socket = socket;
    return new Promise((resolve, reject) => {
      socket.onopen = () => {
        const { system, speaker } = this.fields;
        socket.send(JSON.stringify({ system: system.value, speaker: speaker.value, seed: Math.floor(Math.random() * 2 ** 31) }));
      };
      socket.onmessage = ({ data }) => {
        if (data instanceof ArrayBuffer) return this.#onFrames(data);
        const message = JSON.parse(data);
        if ("end" in message) {
          reject(new Error(message.end));
          if (this.socket === socket) this.stop(message.end, true);
          return;
        }
        if ("plan" in message) return this.planned.take(message.plan);
        this.#token = message.token;
        this.#pace = message;
        this.planned.begin(message.plans);
        resolve();
      };
      socket.onclose = () => {
        reject(new Error(LOST));
        if (this.socket === socket) this.stop(LOST, true);
      };
    });
  }

  #onBlock(block, peak) {
    if (this.socket?.readyState !== WebSocket.OPEN) return;
    this.#playout.captured(block.length);
    this.socket.send(block.buffer);
    this.level.value = Math.max(0, 1 + Math.log10(Math.max(peak, 1e-3)) / 2.5);
  }

  #onFrames(message) {
    this.#news = this.#playout.came(message);
    this.#rolling.push(this.#news.first, unpacked(message, this.#news.first));
    this.#feed();
    if (this.#sound) this.#sound.delay = this.#playout.delay / 1000;
  }

  // -------------------------------------------------------------- the picture

  #tick(run) {
    if (this.#run !== run) return;
    requestAnimationFrame(() => this.#tick(run));
    if (this.#news && performance.now() >= this.#restUntil) this.#playout.tick();
  }

  /** The picture is there; the next one leaves a processor that draws time for other things. */
  #isDrawn(took) {
    const time = performance.now();
    if (!this.#run || !this.#news) return;
    this.#playout.shown(this.#playout.place);
    if (this.#stage.pace.isSlow) this.#restUntil = time + SLOW_REST * took;
    this.planned.draw(this.#playout.place / 30);
    this.#tell(time);
  }

  #tell(time) {
    const { latency } = this.#playout;
    const { madeMs, waitedMs, visitors } = this.#news;
    const seconds = (ms) => `${(ms / 1000).toFixed(2)} s`;
    this.number.textContent = seconds(latency);
    this.#root.dataset.latency = latency.toFixed(0);
    const windowMs = ((this.#pace.ahead + this.#pace.hop) * 1000) / 30;
    const rest = Math.max(0, latency - windowMs - waitedMs - madeMs);
    this.parts.textContent = `audio window ${seconds(windowMs)} · queue ${seconds(waitedMs)} · generation ${seconds(madeMs)} · network and rendering ${seconds(rest)}`;
    this.#lateSince = latency > LATE_MS ? (this.#lateSince ?? time) : null;
    if (this.#lateSince !== null && time - this.#lateSince > LATE_FOR_MS) {
      const who = visitors > 1 ? ` (${visitors} live visitors)` : "";
      this.#say(`The server is slow${who}: the motion follows ${(latency / 1000).toFixed(1)} s after the voice.`, true);
    } else if (this.status.classList.contains("bad")) {
      this.#say(this.#doing);
    }
  }
}

/** Called by Gradio's component. */
export function mountLive(element, props) {
  return new Live(element.querySelector(".live"), JSON.parse(JSON.stringify(props.value ?? {})));
}
