"""The newest status for any number of subscribers.

thread: long polls ──> publish in the event loop ──> subscribers, each of which may skip what is no longer the newest
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator
from dataclasses import dataclass

from ...client import CarvedClient
from ...errors import CarvedError
from ...models import Status

#: Pause before the next request to a daemon that did not answer.
PAUSE_S = 1.0


@dataclass(frozen=True)
class Shown:
    """A status. It is the last known one while the daemon does not answer."""

    connected: bool
    status: Status | None


class StatusFeed:
    """Follows the status of one daemon. It belongs to the event loop in which it was started."""

    def __init__(self, client: CarvedClient) -> None:
        self._client = client
        self._newest: Shown | None = None
        self._changed = asyncio.Event()
        self._done = threading.Event()

    def start(self) -> None:
        """Begins to follow the status."""
        loop = asyncio.get_running_loop()
        # A daemon thread: a long poll that waits does not delay the end of the process.
        threading.Thread(target=self._follow, args=(loop,), name="carved-status", daemon=True).start()

    def stop(self) -> None:
        """Ends with the current long poll."""
        self._done.set()

    async def changes(self) -> AsyncIterator[Shown]:
        """Yields the current status and then every change."""
        seen: Shown | None = None
        while True:
            changed = self._changed
            if self._newest is not None and self._newest != seen:
                seen = self._newest
                yield seen
            else:
                await changed.wait()

    def _follow(self, loop: asyncio.AbstractEventLoop) -> None:
        status: Status | None = None
        after = 0
        while not self._done.is_set():
            try:
                status = self._client.newer_status(after)
            except CarvedError:
                after, connected = 0, False
            else:
                after, connected = status.revision, True
            if loop.is_closed():
                return
            loop.call_soon_threadsafe(self._publish, Shown(connected, status))
            if not connected:
                self._done.wait(PAUSE_S)

    def _publish(self, shown: Shown) -> None:
        self._newest = shown
        self._changed.set()
        self._changed = asyncio.Event()
