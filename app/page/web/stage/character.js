/** A visitor's own character (.glb or .vrm) as the body of all motions on all stages of the page. */

import { readGlb } from "../body/glb.js";
import { make } from "../dom.js";
import { theBody, Mesh } from "./mesh.js";

const ROUTE = "stage/character";
const MAX_BYTES = 50e6;
const TYPES = ".glb,.vrm";
const NAME = "character"; // of what the browser remembers: the name of the file

/** What `use` of the browser's storage gives; undefined where there is none. */
function remembered(use) {
  try {
    return use();
  } catch {
    return undefined;
  }
}

/** The visitor's character: null while bodies are the page's. Tells `change` of another. */
class Own extends EventTarget {
  /** @type {Mesh | null} */
  mesh = null;
  name = remembered(() => localStorage.getItem(NAME)) ?? "";

  constructor() {
    super();
    if (this.name) this.#wear("GET").catch(() => this.#set("", null)); // it has expired
  }

  /** Have a file read and kept by the server, or no character any more. @type {(file: File | null) => Promise<void>} */
  async choose(file) {
    if (!file) {
      await fetch(ROUTE, { method: "DELETE" });
      return this.#set("", null);
    }
    if (file.size > MAX_BYTES) throw new Error(`This file is ${Math.ceil(file.size / 1e6)} MB; the limit for a character is ${MAX_BYTES / 1e6} MB.`);
    return this.#wear("POST", file);
  }

  async #wear(method, file = null) {
    const answer = await fetch(ROUTE, { method, body: file, headers: { "Content-Type": "application/octet-stream" } });
    if (!answer.ok) throw new Error(await answer.text());
    const glb = readGlb(await answer.arrayBuffer());
    const mesh = new Mesh(glb);
    mesh.picture = await createImageBitmap(new Blob([glb.picture()]), { premultiplyAlpha: "none", colorSpaceConversion: "none" });
    this.#set(file?.name ?? this.name, mesh);
  }

  #set(name, mesh) {
    [this.name, this.mesh] = [name, mesh];
    remembered(() => (name ? localStorage.setItem(NAME, name) : localStorage.removeItem(NAME)));
    this.dispatchEvent(new Event("change"));
  }
}

export const own = new Own();

/** The body that motions move: the visitor's character, or the page's. @type {() => Promise<Mesh>} */
export const theWorn = async () => own.mesh ?? (await theBody());

/**
 * The choice of a character, which the file can also be dropped on the stage for; and the way back to the page's body.
 *
 * @param {any} stage
 */
export function bodyChoice(stage) {
  const status = make("output", {});
  const input = make("input", { type: "file", accept: TYPES, "aria-label": "Your own character (.glb or .vrm)" });
  const back = make("button", { type: "button", hidden: true, onclick: () => choose(null) }, "Open body");
  const choose = async (file) => {
    status.textContent = file ? "Reading the character" : "";
    await own.choose(file).catch((error) => (status.textContent = error.message));
  };
  const show = async () => {
    status.textContent = own.name;
    back.hidden = !own.mesh;
    stage.wear(await theWorn(), !!own.mesh);
  };
  own.addEventListener("change", show);
  if (own.mesh) show();
  input.addEventListener("change", () => input.files[0] && choose(input.files[0]));
  stage.view.addEventListener("dragover", (event) => event.preventDefault());
  stage.view.addEventListener("drop", (event) => {
    event.preventDefault();
    const [file] = event.dataTransfer.files;
    if (file) choose(file);
  });
  return make("label", { class: "body-choice" }, make("span", {}, "Body"), input, back, status);
}
