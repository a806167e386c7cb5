/** What can be saved of one body: its motion, as other programs read it too, and its video. */

import { icon, make, popUp } from "../dom.js";

/** By what is asked for behind the address of a motion, as app/page/routes/media.py has them. */
const KINDS = {
  glb: [".glb", "animated body for 3D viewers (GLB)"],
  vrma: [".vrma", "animation for any VRM character (VRMA)"],
  bvh: [".bvh", "skeleton, for animation programs (BVH)"],
  blender: [".blender.npz", "for Blender's SMPL-X add-on"],
};

/** The same of the address of a plan. */
const PLAN_KINDS = {
  json: [".json", "gesture plan (JSON, can be loaded here)"],
  textgrid: [".TextGrid", "gesture plan for Praat (TextGrid)"],
  elan: [".eaf", "gesture plan for ELAN (EAF)"],
  markers: [".markers.csv", "events by frame (CSV)"],
};

/**
 * A button that opens the list; null where there is nothing.
 *
 * @param {import("../messages").PlayerRow} row
 * @param {boolean} [hasCharacter] Whether the body is the visitor's own.
 */
export function filesOf(row, hasCharacter = false) {
  if (!row.motion && !row.video) return null;
  const name = row.label ?? row.name;
  const link = (url, ending, words) => make("li", {}, make("a", { href: url, download: `${row.stem}${ending}`, onclick: () => (box.open = false) }, make("strong", {}, ending), ` ${words}`));
  const items = [];
  if (row.video) items.push(link(row.video, ".mp4", "video"));
  if (row.motion) {
    items.push(link(row.motion, ".npz", "motion in BEAT2's format (npz)"));
    if (hasCharacter) items.push(link(`${row.motion}&as=character`, "-character.glb", "your character with this motion"));
    for (const [kind, [ending, words]] of Object.entries(KINDS)) items.push(link(`${row.motion}&as=${kind}`, ending, words));
  }
  if (row.plan) for (const [kind, [ending, words]] of Object.entries(PLAN_KINDS)) items.push(link(`${row.plan}&as=${kind}`, ending, words));
  const box = popUp("files", make("summary", { title: `Save ${name}`, "aria-label": `Save ${name}` }, icon("save")), make("ul", {}, ...items));
  return box;
}
