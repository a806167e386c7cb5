/** The table of measures: one switch for the filter, few or all of them, and moments to look at. */

import { currentFilter, followFilter, wireSwitch } from "./filter_switch.js";

export function mountMeasures(element, props, watch) {
  const mark = wireSwitch(element);
  const show = () => {
    mark();
    element.querySelector(".measures")?.setAttribute("data-filter", currentFilter());
  };
  followFilter(show);
  watch("value", () => requestAnimationFrame(show)); // after Gradio has put it there
  element.addEventListener("click", ({ target }) => {
    const button = target.closest("button");
    if (button?.matches(".more")) showMore(button);
    if (button?.matches(".go")) goTo(button);
  });
}

/** Show the moment at which something is worst, in the player of the same tab. */
function goTo(button) {
  const players = button.closest("[role=tabpanel]")?.querySelectorAll(".lockstep:not([hidden])") ?? [];
  const player = [...players].find(({ lockstep }) => lockstep); // a live body has no time to go to
  if (!player) return;
  player.dispatchEvent(new Event("watch"));
  const { name, part, at } = button.dataset;
  player.showFinding({ motion_name: name, part, worst_time_s: at ? Number(at) : null });
  player.scrollIntoView({ block: "nearest", behavior: "smooth" });
}

/** All measures, or the few that are there at first. */
function showMore(button) {
  const { fewer } = button.dataset;
  button.dataset.fewer = button.textContent;
  button.textContent = fewer;
  button.setAttribute("aria-expanded", String(button.closest(".measures").classList.toggle("all")));
}
