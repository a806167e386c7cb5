/** A visitor's own character (.glb or .vrm) as the body of all motions of a stage. */

import { readGlb } from "../body/glb.js";
import { make } from "../dom.js";
import { theBody, Mesh } from "./mesh.js";

const ROUTE = "stage/character";
const MAX_BYTES = 50e6;
const TYPES = ".glb,.vrm";

/** What the server makes of a character, with or without the address of a motion. @type {(file: Blob, motion?: string) => Promise<Response>} */
async function answered(file, motion) {
  if (file.size > MAX_BYTES) throw new Error(`A character may have ${MAX_BYTES / 1e6} MB; this one has ${Math.ceil(file.size / 1e6)}.`);
  const query = motion ? `?${new URLSearchParams({ motion })}` : "";
  const answer = await fetch(ROUTE + query, { method: "POST", body: file, headers: { "Content-Type": "application/octet-stream" } });
  if (!answer.ok) throw new Error(await answer.text());
  return answer;
}

/** The body of a character's file; its texture is decoded. @type {(file: Blob) => Promise<Mesh>} */
export async function characterOf(file) {
  const glb = readGlb(await (await answered(file)).arrayBuffer());
  const mesh = new Mesh(glb);
  mesh.picture = await createImageBitmap(new Blob([glb.picture()]), { premultiplyAlpha: "none", colorSpaceConversion: "none" });
  return mesh;
}

/** Save the character's own file with a motion in it. @type {(file: File, motion: string, stem: string) => Promise<void>} */
export async function saveMoving(file, motion, stem) {
  const url = URL.createObjectURL(await (await answered(file, motion)).blob());
  const link = make("a", { href: url, download: `${stem}-${file.name.replace(/\.[^.]*$/, "")}.glb` });
  link.click();
  URL.revokeObjectURL(url);
}

/**
 * The choice of a character, which the file can also be dropped on the stage for; and the way back to the page's body.
 *
 * @param {any} stage
 */
export function bodyChoice(stage) {
  const said = make("output", {});
  const input = make("input", { type: "file", accept: TYPES, "aria-label": "Your own character (.glb or .vrm)" });
  const back = make("button", { type: "button", hidden: true }, "Open body");
  const wear = async (file) => {
    said.textContent = file ? "Reading the character" : "";
    try {
      stage.wear(file ? await characterOf(file) : await theBody(), file);
      said.textContent = file?.name ?? "";
      back.hidden = !file;
    } catch (error) {
      said.textContent = error.message;
    }
  };
  input.addEventListener("change", () => input.files[0] && wear(input.files[0]));
  back.addEventListener("click", () => wear(null));
  stage.view.addEventListener("dragover", (event) => event.preventDefault());
  stage.view.addEventListener("drop", (event) => {
    event.preventDefault();
    const [file] = event.dataTransfer.files;
    if (file) wear(file);
  });
  return make("label", { class: "body-choice" }, make("span", {}, "Body"), input, back, said);
}
