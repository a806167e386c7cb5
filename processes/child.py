"""A module of ours run as a process of its own, which Python objects go to and come from.

It is started directly rather than through `multiprocessing`, which would import the caller's main
module, and torch with it, into every child. Both ends speak over one channel: when it closes,
because a child is to stop or its parent has died, the child knows, and ends.
"""

import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Mapping
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from processes.ended import ChildLog, Ended, memory_kills

_ENDS_WITHIN_S = 5.0
"""A process whose channel is closed has ended, or is about to."""


class Gone(Exception):
    """The child has ended."""


class Child:
    """The parent's side. Used from one thread, of whom another may call `end`."""

    def __init__(
        self,
        module: str,
        *arguments: str,
        environment: Mapping[str, str] | None = None,
        is_log_handed_on: bool = False,
    ) -> None:
        """
        Args:
            module: run as ``python -m``; it finds its end by `parent_channel`.
            arguments: of its command line, after the channel's.
            environment: variables beside those of this process.
            is_log_handed_on: whether what it says goes to standard error.
        """
        self._channel, theirs = Pipe()
        self._killed_before = memory_kills()
        self._process = subprocess.Popen(
            [
                *(sys.executable, "-X", "faulthandler", "-m", module),
                str(theirs.fileno()),
                *arguments,
            ],
            cwd=Path(__file__).parents[1],
            env={**os.environ, **(environment or {})},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            pass_fds=(theirs.fileno(),),
            # In no session of its own: Linux shares out the processor by sessions before niceness.
            process_group=0,
        )
        theirs.close()
        assert self._process.stdout is not None
        self._log = ChildLog(self._process.stdout, is_log_handed_on)
        self._outbox: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._sender = threading.Thread(target=self._send_all, daemon=True)
        self._sender.start()

    @property
    def pid(self) -> int:
        """Also of its process group, which it leads, so that `end` also ends what it started."""
        return self._process.pid

    def is_alive(self) -> bool:
        return self._process.poll() is None

    def forget(self) -> None:
        """Begin a new piece of work: what was said before tells nothing of how that ends."""
        self._log.forget()
        self._killed_before = memory_kills()

    def send(self, message: object) -> None:
        """Never waits: a child that does not read, or is gone, is met by who listens to it."""
        self._outbox.put(pickle.dumps(message))

    def has_message(self, within_s: float) -> bool:
        """Wait for a moment.

        Raises:
            Gone: if the child has ended.
        """
        try:
            return self._channel.poll(within_s)
        except (EOFError, OSError) as error:
            raise Gone from error

    def receive(self) -> Any:
        """The next message; waits for it.

        Raises:
            Gone: if the child has ended.
        """
        try:
            return self._channel.recv()
        except (EOFError, OSError) as error:
            raise Gone from error

    def ended(self) -> Ended:
        """How a child ended that is `Gone`."""
        try:
            status = self._process.wait(_ENDS_WITHIN_S)
        except subprocess.TimeoutExpired:
            status = None
        return Ended(status, self._log.lines(), memory_kills() > self._killed_before)

    def end(self) -> None:
        """End it, and all of its group."""
        if self._channel.closed:
            return
        self._outbox.put(None)
        try:
            os.killpg(self.pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
        self._process.wait()
        self._sender.join(_ENDS_WITHIN_S)  # before its number is another file's
        self._channel.close()

    def _send_all(self) -> None:
        while (sent := self._outbox.get()) is not None:
            try:
                self._channel.send_bytes(sent)
            except OSError:  # it has gone
                return


def parent_channel() -> tuple[Connection, tuple[str, ...]]:
    """In the child: its end of the channel, and the arguments it was started with."""
    number, *arguments = sys.argv[1:]
    return Connection(int(number)), tuple(arguments)


def heard(channel: Connection) -> queue.SimpleQueue[tuple[Any, threading.Event]]:
    """In the child: what the parent sends from now on, each with what a None after it sets. Without
    a parent nobody would ever end this process: then it ends."""
    messages: queue.SimpleQueue[tuple[Any, threading.Event]] = queue.SimpleQueue()

    def listen() -> None:
        stop = threading.Event()
        try:
            while True:
                told = channel.recv()
                if told is None:
                    stop.set()
                else:
                    stop = threading.Event()
                    messages.put((told, stop))
        except (EOFError, OSError):
            os._exit(1)

    threading.Thread(target=listen, daemon=True).start()
    return messages
