"""Gradio's queue, restricted to events with a connected listener, and to few per address.

An event starts if its browser or program listens for the results; one without a listener for a few
seconds is dropped. A run that has started continues without its page, as on a phone that locks,
until another visitor waits.
"""

from __future__ import annotations

import asyncio
import random
import time
from typing import Any

import fastapi
from gradio import queueing, route_utils
from gradio.queueing import Event, EventQueue
from gradio.utils import LRUCache

from app.page.visitors.job_folders import Jobs
from app.page.visitors.visitors import CHECKS, RUNS, client_network_of

MAX_OF_ADDRESS, MAX_CHECKS_OF_ADDRESS = 4, 16
MAX_UNATTENDED_S = 10.0
"""Time (s) without a listener after which a waiting event is dropped."""
MAX_SESSIONS = 2000
"""Maximum number of pages with stored messages."""
FULL = "The queue is full: {count} runs are already waiting. Try again later."
FULL_OF_ADDRESS = (
    "{count} requests from your IP address are already waiting; the limit is {count}. Wait until "
    "one is finished."
)


class MessageQueue(asyncio.Queue):
    """Messages to one page, with the number of their listeners."""

    num_listening = 0

    async def get(self) -> Any:
        self.num_listening += 1
        try:
            return await super().get()
        finally:
            self.num_listening -= 1


class _AllMessages(LRUCache):
    """Messages by page, in queues of type `MessageQueue`."""

    def __setitem__(self, session: str, queue: asyncio.Queue) -> None:
        super().__setitem__(session, queue if isinstance(queue, MessageQueue) else MessageQueue())


class LimitedQueue(queueing.Queue):
    """Event queue of one page, used only from Gradio's event loop, as its base class is."""

    def __init__(self, jobs: Jobs, max_waiting: int, **options: Any) -> None:
        """Make the queue of at most ``max_waiting`` waiting events, without checks of uploads."""
        super().__init__(max_size=None, **options)
        self.max_queue_size = max_waiting
        self.pending_messages_per_session = _AllMessages(MAX_SESSIONS)
        self._jobs = jobs
        self._abandoned: set[str] = set()
        """Ids of events that keep running after their page was closed or disconnected."""
        self._checked = ""
        """Address of the last checked upload."""

    async def push(
        self, body: Any, request: fastapi.Request, username: str | None
    ) -> tuple[Any, Any, Any]:
        """Accept an event unless too many wait, in total or from its address."""
        if body.fn_index is not None:
            kind = route_utils.get_fn(self.blocks, None, body).concurrency_id
            self._drop_unheard()
            waiting = [event for event in self._waiting() if event.concurrency_id != CHECKS]
            if kind != CHECKS and len(waiting) >= self.max_queue_size:
                return False, FULL.format(count=len(waiting)), "queue_full"
            limit = MAX_CHECKS_OF_ADDRESS if kind == CHECKS else MAX_OF_ADDRESS
            own = [one for one in self._waiting(kind) if _is_from(one, client_network_of(request))]
            if len(own) >= limit:
                return False, FULL_OF_ADDRESS.format(count=limit), "error"
        held, messages = self.pending_event_ids_session, self.pending_messages_per_session
        if len(held) > 2 * MAX_SESSIONS:  # Gradio drops messages of pages, but not their events
            for session in [each for each in held if each not in messages]:
                del held[session]
        return await super().push(body, request, username)

    def get_events(self) -> tuple[list[Event], bool, str] | None:
        """Return the event to start now, if there is one."""
        self._drop_unheard()
        queues = list(self.event_queue_per_concurrency_id.values())
        random.shuffle(queues)
        for queue in queues:
            event = self._next_of(queue)
            if event is None:
                continue
            limit = queue.concurrency_limit
            if limit is not None and queue.current_concurrency >= limit:
                self._end_abandoned(queue.concurrency_id)
                continue
            if queue.concurrency_id == CHECKS:
                self._checked = client_network_of(event.request)
            queue.queue.remove(event)
            return [event], False, queue.concurrency_id
        return None

    def _next_of(self, queue: EventQueue) -> Event | None:
        """Return the first event with a listener; checks alternate between addresses."""
        waited_for = [event for event in queue.queue if self._has_listener(event)]
        others = [event for event in waited_for if not _is_from(event, self._checked)]
        return next(iter((others if queue.concurrency_id == CHECKS else []) or waited_for), None)

    def send_message(self, event: Event, event_message: Any) -> None:
        """Send a message to the event's page if it is connected."""
        if event._id not in self._abandoned:
            super().send_message(event, event_message)

    async def clean_events(
        self, *, session_hash: str | None = None, event_id: str | None = None
    ) -> None:
        """Remove the events of a page that has lost its connection.

        Waiting ones are dropped, started ones ended, except for a run that outlives its page.
        """

        def is_meant(event: Event) -> bool:
            return event.session_hash == session_hash or event._id == event_id

        others = [each for each in self._waiting(RUNS) if self._has_listener(each)]
        for event in filter(is_meant, self._begun()):
            if event.concurrency_id == RUNS and self._jobs.survives_disconnect(event.session_hash):
                if not any(not is_meant(other) for other in others):
                    self._abandoned.add(event._id)
                    continue
            event.alive = False
        async with self.delete_lock:
            for event in filter(is_meant, self._waiting()):
                self._remove(event)
        if session_hash is not None:
            self.pending_messages_per_session.pop(session_hash, None)

    def _end_abandoned(self, kind: str) -> None:
        """End the events of a queue that continue without a page, as another visitor waits."""
        for event in self._begun():
            if event.concurrency_id == kind and event._id in self._abandoned:
                event.alive = False

    async def process_events(self, events: list[Event], *how: Any) -> None:
        try:
            await super().process_events(events, *how)
        finally:
            self._abandoned.difference_update(event._id for event in events)

    def _waiting(self, kind: str | None = None) -> list[Event]:
        queues = self.event_queue_per_concurrency_id.items()
        return [event for name, each in queues if kind in (None, name) for event in each.queue]

    def _begun(self) -> list[Event]:
        return [event for events in self.active_jobs for event in events or ()]

    def _has_listener(self, event: Event) -> bool:
        """Check whether an event has a listener."""
        messages = self.pending_messages_per_session.get(event.session_hash)
        return isinstance(messages, MessageQueue) and messages.num_listening > 0

    def _drop_unheard(self) -> None:
        before = time.monotonic() - MAX_UNATTENDED_S
        for event in self._waiting():
            if event.enqueue_time < before and not self._has_listener(event):
                self._remove(event)

    def _remove(self, event: Event) -> None:
        """Remove a waiting event, and the stored messages of its page if it was the last."""
        self.event_queue_per_concurrency_id[event.concurrency_id].queue.remove(event)
        self.event_ids_to_events.pop(event._id, None)
        ids = self.pending_event_ids_session.get(event.session_hash, set())
        ids.discard(event._id)
        if not ids and not self._has_listener(event):
            self.pending_event_ids_session.pop(event.session_hash, None)
            self.pending_messages_per_session.pop(event.session_hash, None)


def _is_from(event: Event, address: str) -> bool:
    return client_network_of(event.request) == address
