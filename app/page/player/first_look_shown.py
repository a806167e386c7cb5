"""The finished example that plays when the page opens."""

from __future__ import annotations

import json
from html import escape
from typing import Any

from app import text
from app.page.parts.html_parts import shown
from app.page.player.player import Showing
from app.page.routes.media import Media
from app.run.examples import FACTS, FIRST_LOOK, STEADY, TREMBLING


def first_look(media: Media) -> tuple[dict[str, Any], Any]:
    """Of the player and of what stands in the place of results, for a page that opens."""
    value = Showing(FIRST_LOOK, media.share(FIRST_LOOK, "")).value()
    plays = {**value, "plays": True, "guess": True, "running": False, "begins": False}
    return plays, shown(question(json.loads((FIRST_LOOK / FACTS).read_text())))


def question(facts: dict[str, Any]) -> str:
    """What to look for, with the answer folded away, and the way to something of one's own."""
    jerk, (system,) = facts["jerk_m_s3"], facts["provenance"]["weights"]
    answer = text.LOOK_ANSWER.format(
        row=TREMBLING,
        noise=facts["noise_rad"],
        trembling=jerk[TREMBLING],
        steady=jerk[STEADY],
    )
    about = text.LOOK_ABOUT.format(system=system)
    return (
        f'<div class="first-look"><h2>{escape(text.LOOK_QUESTION)}</h2>'
        f"<p>{escape(about)}</p>"
        f"<details><summary>{escape(text.LOOK_SHOW)}</summary><p>{escape(answer)}</p></details>"
        f'<a class="own" href="#speech">{escape(text.LOOK_OWN)}</a></div>'
    )
