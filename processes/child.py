"""Child process that runs one of our modules and exchanges Python objects with its parent.

It is started directly rather than through `multiprocessing`, which would import the caller's main
module, and torch with it, into every child. When the channel between them closes, because the child
is to stop or its parent has died, the child exits.
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

from processes.exit_report import ChildLog, ExitReport, count_out_of_memory_kills

_ENDS_WITHIN_S = 5.0
"""Longest time for a process with a closed channel to exit (s)."""


class ChildExited(Exception):
    """Exception for a child process that has ended."""


class Child:
    """Parent's handle of a child process. For use from one thread; another may call `kill`."""

    def __init__(
        self,
        module: str,
        *arguments: str,
        environment: Mapping[str, str] | None = None,
        is_log_handed_on: bool = False,
    ) -> None:
        """Start the child process.

        Args:
            module: run as ``python -m``; it calls `parent_channel` for its end of the channel.
            arguments: of its command line, after the channel's.
            environment: variables that are added to those of this process.
            is_log_handed_on: also copy its output to standard error.
        """
        self._channel, theirs = Pipe()
        self._killed_before = count_out_of_memory_kills()
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
            # No new session: Linux shares the processor by sessions before niceness.
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
        """Id of the process and of its group, which it leads: `kill` ends its children too."""
        return self._process.pid

    def is_alive(self) -> bool:
        return self._process.poll() is None

    def clear_log(self) -> None:
        """Discard the log so far, before a new task: it says nothing about how that ends."""
        self._log.clear()
        self._killed_before = count_out_of_memory_kills()

    def send(self, message: object) -> None:
        """Queue a message without waiting.

        If the child has ended, the next read raises `ChildExited`.
        """
        self._outbox.put(pickle.dumps(message))

    def has_message(self, within_s: float) -> bool:
        """Check for a message for ``within_s``; raises ChildExited if the child has ended."""
        try:
            return self._channel.poll(within_s)
        except (EOFError, OSError) as error:
            raise ChildExited from error

    def receive(self) -> Any:
        """Wait for the next message and return it; raises ChildExited if the child has ended."""
        try:
            return self._channel.recv()
        except (EOFError, OSError) as error:
            raise ChildExited from error

    def exit_report(self) -> ExitReport:
        """Return how a child ended, after `ChildExited`."""
        try:
            status = self._process.wait(_ENDS_WITHIN_S)
        except subprocess.TimeoutExpired:
            status = None
        return ExitReport(
            status, self._log.lines(), count_out_of_memory_kills() > self._killed_before
        )

    def kill(self) -> None:
        """Kill the child and all of its process group."""
        if self._channel.closed:
            return
        self._outbox.put(None)
        try:
            os.killpg(self.pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
        self._process.wait()
        self._sender.join(_ENDS_WITHIN_S)  # before its file descriptor is reused
        self._channel.close()

    def _send_all(self) -> None:
        while (sent := self._outbox.get()) is not None:
            try:
                self._channel.send_bytes(sent)
            except OSError:  # the child has ended
                return


def parent_channel() -> tuple[Connection, tuple[str, ...]]:
    """Return the child's end of the channel, and its command line arguments."""
    number, *arguments = sys.argv[1:]
    return Connection(int(number)), tuple(arguments)


def start_receiving(channel: Connection) -> queue.SimpleQueue[tuple[Any, threading.Event]]:
    """Start a thread that receives messages, and return their queue, each with a stop event.

    The parent's next None sets the event of the last message.

    If the parent dies, this process exits.
    """
    messages: queue.SimpleQueue[tuple[Any, threading.Event]] = queue.SimpleQueue()

    def listen() -> None:
        stop = threading.Event()
        try:
            while True:
                message = channel.recv()
                if message is None:
                    stop.set()
                else:
                    stop = threading.Event()
                    messages.put((message, stop))
        except (EOFError, OSError):
            os._exit(1)

    threading.Thread(target=listen, daemon=True).start()
    return messages
