/** What can be saved of one body: its motion, as other programs read it too, and its video. */

import { icon, make, popUp } from "../dom.js";

/** By what is asked for behind the address of a motion, as app/page/routes/media.py has them. */
const KINDS = {
  glb: [".glb", "moving body, for 3D viewers (GLB)"],
  bvh: [".bvh", "skeleton, for animation programs (BVH)"],
  blender: [".blender.npz", "for Blender's SMPL-X add-on"],
};

/** The same of the address of a plan. */
const PLAN_KINDS = {
  json: [".json", "plan of its gestures, as this page reads it"],
  textgrid: [".TextGrid", "the same, for Praat"],
  elan: [".eaf", "the same, for ELAN"],
  markers: [".markers.csv", "its events by frame, for animation programs"],
};

/**
 * A button that opens the list; null where there is nothing.
 *
 * @param {import("../told").Row} row
 */
export function filesOf(row) {
  if (!row.motion && !row.video) return null;
  const name = row.label ?? row.name;
  const link = (url, ending, words) => make("li", {}, make("a", { href: url, download: `${row.stem}${ending}`, onclick: () => (box.open = false) }, make("strong", {}, ending), ` ${words}`));
  const items = [];
  if (row.video) items.push(link(row.video, ".mp4", "video"));
  if (row.motion) {
    items.push(link(row.motion, ".npz", "motion, as this page reads it"));
    for (const [kind, [ending, words]] of Object.entries(KINDS)) items.push(link(`${row.motion}&as=${kind}`, ending, words));
  }
  if (row.plan) for (const [kind, [ending, words]] of Object.entries(PLAN_KINDS)) items.push(link(`${row.plan}&as=${kind}`, ending, words));
  const box = popUp("files", make("summary", { title: `Save ${name}`, "aria-label": `Save ${name}` }, icon("save")), make("ul", {}, ...items));
  return box;
}
