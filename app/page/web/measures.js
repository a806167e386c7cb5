/** The table of measures: one switch for the filter, a CSV. */

import { make } from "./dom.js";
import { followFilter, wireSwitch } from "./filter_switch.js";
import { goTo as goToMoment } from "./player/findings.js";

export function mountMeasures(element, props, watch) {
  let unfollow = () => {};
  const wire = () => {
    unfollow();
    const table = element.querySelector(".measures");
    if (table) unfollow = wireTable(table);
  };
  watch("value", wire);
  wire();
}

/** Show the moment at which something is worst, in the player of the same tab. */
function goTo(button, root) {
  const players = root.closest("[role=tabpanel]")?.querySelectorAll(".lockstep:not([hidden])") ?? [];
  const player = [...players].find(({ lockstep }) => lockstep); // a live body has no time to go to
  if (!player) return;
  goToMoment(player.lockstep, Number(button.dataset.at));
  player.scrollIntoView({ block: "nearest", behavior: "smooth" });
}

/** Wire what the server has written; returns a function that lets go of it. */
function wireTable(root) {
  const more = root.querySelector(".more");
  if (more) more.onclick = () => showMore(root, more);
  root.querySelector(".csv").onclick = () => save(root);
  for (const button of root.querySelectorAll(".findings .go")) button.onclick = () => goTo(button, root);
  const ends = [wireSwitch(root.querySelector(".switch")), followFilter((name) => root.setAttribute("data-filter", name))];
  return () => ends.forEach((end) => end());
}

/** All measures, or the few that are there at first. */
function showMore(root, button) {
  const { fewer } = button.dataset;
  button.dataset.fewer = button.textContent;
  button.textContent = fewer;
  button.setAttribute("aria-expanded", String(root.classList.toggle("all")));
}

function headNames(root) {
  return [...root.querySelectorAll("thead th[data-name]")].map((head) => head.dataset.name);
}

/** What the table holds, raw and filtered, one number in a line. */
function save(root) {
  const names = headNames(root);
  const lines = [["measure", "unit", "name", "filter", "value"]];
  for (const row of root.querySelectorAll("tr[data-measure]")) {
    for (const [i, name] of names.entries()) {
      for (const filter of ["raw", "savgol"]) {
        const value = row.children[1 + i].getAttribute(`data-${filter}`);
        if (value !== null) lines.push([row.dataset.measure, row.dataset.unit, name, filter, value]);
      }
    }
  }
  const content = lines.map((line) => line.map(quoted).join(",")).join("\r\n") + "\r\n";
  const url = URL.createObjectURL(new Blob([content], { type: "text/csv" }));
  make("a", { href: url, download: "measures.csv" }).click();
  URL.revokeObjectURL(url);
}

/** A cell that no spreadsheet takes for a formula; as model/storage/harmless.py. */
function quoted(cell) {
  const number = /^[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$/i;
  const plain = String(cell).replaceAll(/[\p{C}\p{Zl}\p{Zp}]/gu, "?");
  const harmless = number.test(plain) ? plain : plain.replaceAll(/(^|;)(?= *[=+\-@\uff1d\uff0b\uff0d\uff20])/g, "$1'");
  return `"${harmless.replaceAll('"', '""')}"`;
}
