"""What a page shows that has just been opened, by its address."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gradio as gr

from app import text
from app.page.parts import markup
from app.page.parts.html_parts import shown
from app.page.queue.in_turn import Updates
from app.page.results.kept_runs import PARAMETER, KeptRun
from app.page.results.result_parts import ResultParts
from app.page.results.run_pair import RunPair
from app.page.tabs.services import Services
from app.page.visitors.visitors import cookie_of


class Opening:
    """The run whose link led to the page, in the tab that it came from, or two beside each other;
    else the example. And in each tab the visitor's runs."""

    def __init__(
        self,
        services: Services,
        tabs: gr.Tabs,
        places: Mapping[str, ResultParts],
        form: Mapping[str, Any],
    ) -> None:
        """
        Args:
            places: by the id of a tab where it shows results; the first is that of all runs whose
                own tab is not among them.
            form: fields of the first tab's form by name, to be filled in as the run was asked for.
        """
        self._kept = services.kept
        self._keep_s = services.config.keep_results_s
        self._tabs = tabs
        self._places = places
        self._first_look = services.first_look
        self._form = form

    @property
    def outputs(self) -> list[Any]:
        parts = [part for parts in self._places.values() for part in parts.all]
        return [self._tabs, *parts, *self._form.values()]

    def opened(self, request: gr.Request) -> Updates:
        cookie = cookie_of(request)
        listed = shown(self._kept.html(cookie))
        updates: Updates = {parts.runs: listed for parts in self._places.values()}
        tokens = request.query_params.getlist(PARAMETER)[:2]
        runs = [run for run in map(self._kept.find, tokens) if run is not None]
        if len(runs) == 2 and runs[0] != runs[1]:
            return {**updates, **self._pair_opened(RunPair.of(*runs), cookie)}
        if runs and len(tokens) == len(runs):
            return {**updates, **self._run_opened(runs[0], cookie)}
        parts = next(iter(self._places.values()))
        if self._first_look is not None:
            updates[parts.player], updates[parts.empty] = self._first_look.updates()
        if tokens:
            gone = text.RUN_GONE.format(minutes=round(self._keep_s / 60))
            updates[parts.message] = shown(markup.notes_message([gone]))
        return updates

    def _pair_opened(self, pair: RunPair, cookie: str) -> Updates:
        parts = next(iter(self._places.values()))
        return {
            **pair.updates(parts, cookie),
            parts.runs: shown(self._kept.html(cookie, pair.a, pair.b)),
            parts.empty: gr.update(visible=False),
        }

    def _run_opened(self, run: KeptRun, cookie: str) -> Updates:
        tab = run.job.tab if run.job.tab in self._places else next(iter(self._places))
        parts = self._places[tab]
        return {
            **run.run.for_visitor(cookie).updates(parts),
            parts.runs: shown(self._kept.html(cookie, run)),
            parts.empty: gr.update(visible=False),
            **{self._form[name]: gr.update(value=value) for name, value in run.run.form.items()},
            self._tabs: gr.Tabs(selected=tab),
        }
