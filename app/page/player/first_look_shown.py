"""The finished example that plays when the page opens, as soon as it has been made once."""

from __future__ import annotations

import logging
from html import escape
from typing import Any

import gradio as gr

from app import text
from app.config import AppConfig
from app.page.parts import markup
from app.page.parts.catalogue import Catalogue
from app.page.parts.html_parts import shown
from app.page.player.player import Showing, browser_addresses
from app.page.queue.worker import Worker
from app.page.routes.media import MediaAddresses
from app.run.examples import (
    STEADY,
    TREMBLING,
    FirstLook,
    first_look,
    make_first_look,
    take_stored,
)
from model.systems.registry import usual_systems

log = logging.getLogger(__name__)
EXAMPLE = "three_reasons"


class FirstLooks:
    """Makes the example in its turn among all runs, and offers it to every visitor."""

    def __init__(
        self,
        config: AppConfig,
        catalogue: Catalogue,
        addresses: MediaAddresses,
        worker: Worker,
    ) -> None:
        self._config = config
        self._addresses = addresses
        self._worker = worker
        paths = {example.path.stem: example.path for example in catalogue.examples}
        self._look: FirstLook | None = None
        systems = [name for name in usual_systems("first-look") if name in catalogue.systems]
        if systems and EXAMPLE in paths:
            self._look = first_look(config.kept, config.weights, systems[0], paths[EXAMPLE])
        self._shown: tuple[dict[str, Any], str] | None = None
        self.is_coming = self._look is not None
        """Whether more of it will be there in a while; false where all is, or nothing can be."""

    def make(self) -> None:
        """Make it where it has not been made; a failure leaves the page as it was."""
        if self._look is None:
            return
        try:
            if not self._look.is_made and not take_stored(self._look):
                self._worker.do(make_first_look, self._look)
            self._show(self._look)
        except Exception:
            log.exception("the example of the page could not be made")
        finally:
            self.is_coming = False

    def updates(self) -> tuple[Any, Any]:
        """Of the player and of what stands in the place of results, for a page that opens."""
        if self._shown is not None:
            player, asked = self._shown
            return player, shown(asked)
        return gr.skip(), shown(markup.empty_state(text.LOOK_COMING if self.is_coming else ""))

    def _show(self, look: FirstLook) -> None:
        value = Showing(look.folder, browser_addresses(self._addresses, "")).value()
        plays = {**value, "plays": True, "guess": True, "running": False, "begins": False}
        self._shown = plays, question(look.facts(), look.system)


def question(facts: dict[str, Any], system: str) -> str:
    """What to look for, with the answer folded away, and the way to something of one's own."""
    jerk = facts["jerk_m_s3"]
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
