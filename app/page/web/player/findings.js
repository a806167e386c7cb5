/** The gravest findings of a run beside its stage; each leads to where it is worst. */

import { make, momentText } from "../dom.js";

export class Findings {
  #show;

  /** @param {(finding: import("../messages").PlayerFinding) => void} show */
  constructor(show) {
    this.#show = show;
    this.element = make("ol", { class: "gravest", hidden: true, "aria-label": "Findings, most severe first" });
  }

  /**
   * @param {import("../messages").PlayerFinding[]} findings
   * @param {import("../messages").PlayerRow[]} rows
   */
  show(findings, rows) {
    this.element.hidden = !findings.length;
    this.element.replaceChildren(
      ...findings.map((finding) => {
        const { motion_name: name, sentence, worst_time_s: at, part } = finding;
        const row = rows.find((each) => each.name === name);
        const words = name ? [make("b", {}, `${row?.label ?? name}:`), " ", sentence] : [sentence];
        const where = at === null ? part && `the ${part}` : momentText(at);
        const go = where && make("button", { type: "button", class: "go", onclick: () => this.#show(finding) }, `Show ${where}`);
        return make("li", {}, make("p", {}, ...words), ...(go ? [go] : []));
      }),
    );
  }

  clear() {
    this.show([], []);
  }
}

/** Stand still at a moment. */
export function goTo(player, seconds) {
  player.pause();
  player.setLoop(null);
  player.seek(seconds);
}
