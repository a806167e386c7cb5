"""Limits on connections: so many per address, and none whose client has stalled."""

from __future__ import annotations

import asyncio
import ipaddress
from collections.abc import Collection
from typing import Any, ClassVar

from app.page.visitors.visitors import network_of

MAX_CONNECTIONS_PER_ADDRESS = 300
"""Maximum number of open connections of one address, unless it is a trusted proxy's."""
STALLED_S = 60.0
"""Time (s) after which a client has stalled that stops sending a request or reading the answer."""
_Network = ipaddress.IPv4Network | ipaddress.IPv6Network


def limit_connections(
    protocol: type[asyncio.Protocol], proxies: Collection[str]
) -> type[asyncio.Protocol]:
    """Return a class of uvicorn's HTTP connections with the limits."""
    networks = [ipaddress.ip_network(proxy, strict=False) for proxy in proxies]
    return type(
        "LimitedConnection", (_LimitedConnection, protocol), {"proxies": networks, "transports": {}}
    )


class _LimitedConnection(asyncio.Protocol):
    """Limits in front of a protocol of uvicorn; streams of answers may be idle."""

    proxies: ClassVar[Collection[_Network]] = ()
    transports: ClassVar[dict[str, set[asyncio.Transport]]]
    """Open connections, and some that are closed, by address."""
    connections: set[Any]
    client: tuple[str, int] | None
    transport: asyncio.Transport
    loop: asyncio.AbstractEventLoop
    cycle: Any
    flow: Any
    _num_steps = 0
    """Number of times that the client has sent or read something."""

    def connection_made(self, transport: Any) -> None:
        super().connection_made(transport)
        if self._is_one_too_many():
            transport.abort()
        else:
            self.loop.call_later(STALLED_S, self._end_stalled, self._progress())

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        address = _address(self)
        own = self.transports.get(address, set())
        own.discard(self.transport)
        if not own:
            self.transports.pop(address, None)

    def data_received(self, data: bytes) -> None:
        self._num_steps += 1
        super().data_received(data)

    def resume_writing(self) -> None:
        self._num_steps += 1
        super().resume_writing()

    def _is_one_too_many(self) -> bool:
        host = self.client[0] if self.client else ""
        if not host or any(ipaddress.ip_address(host) in each for each in self.proxies):
            return False
        # Looking through all connections for each new one took 4 s for 3,000.
        own = self.transports.setdefault(_address(self), set())
        own -= {each for each in own if each.is_closing()}  # by now WebSockets, which do not say so
        own.add(self.transport)
        return len(own) > MAX_CONNECTIONS_PER_ADDRESS

    def _progress(self) -> tuple[int, int]:
        return self._num_steps, self.transport.get_write_buffer_size()

    def _end_stalled(self, before: tuple[int, int]) -> None:
        if self not in self.connections:  # closed, or a WebSocket by now
            return
        progress = self._progress()
        is_sending = self.cycle is None or (self.cycle.more_body and not self.flow.read_paused)
        is_unread = progress[1] > 0
        if progress == before and (is_sending or is_unread):
            self.transport.abort()
        else:
            self.loop.call_later(STALLED_S, self._end_stalled, progress)


def _address(connection: Any) -> str:
    """Return the address of a connection's client; empty for a socket file."""
    return network_of(connection.client[0]) if connection.client else ""
