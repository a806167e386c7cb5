/** The gravest findings of a run beside its stage; each leads to where it is worst. */

import { make, momentText } from "../dom.js";

export class Findings {
  #player;

  constructor(player) {
    this.#player = player;
    this.element = make("ol", { class: "gravest", hidden: true, "aria-label": "Findings, most severe first" });
  }

  /** `findings` say `name`, `sentence` and `at`, seconds or null; `rows` say how each motion is called. */
  show(findings, rows) {
    this.element.hidden = !findings.length;
    this.element.replaceChildren(
      ...findings.map(({ name, sentence, at }) => {
        const row = rows.find((each) => each.name === name);
        const words = name ? [make("b", {}, `${row?.label ?? name}:`), " ", sentence] : [sentence];
        const go = at === null ? null : make("button", { type: "button", class: "go", onclick: () => goTo(this.#player, at) }, `Show ${momentText(at)}`);
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
