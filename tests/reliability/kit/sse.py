"""A reader of the event stream that outlives the daemon."""

from __future__ import annotations

import json
import socket
import threading
import time
from typing import Any

Event = dict[str, Any]


class Listener(threading.Thread):
    """Follows `/v1/events` of whatever daemon listens on the port, with `Last-Event-ID`. What it heard was acknowledged."""

    def __init__(self, port: int) -> None:
        super().__init__(daemon=True)
        self.port = port
        self.heard: dict[int, Event] = {}
        self.heard_at: dict[int, float] = {}
        self.order: list[int] = []
        self.conflicts: list[int] = []
        self._ended = False
        self.start()

    def end(self) -> None:
        """Ends after the next event or keep-alive."""
        self._ended = True

    def events(self) -> list[Event]:
        """What was heard so far, in the order of the numbers."""
        return [event for _, event in sorted(dict(self.heard).items())]

    def run(self) -> None:
        """Follows the stream until `end`."""
        while not self._ended:
            try:
                self._follow()
            except (OSError, ValueError):
                time.sleep(0.05)

    def _follow(self) -> None:
        with socket.create_connection(("127.0.0.1", self.port), timeout=30) as s:
            head = f"GET /v1/events HTTP/1.1\r\nHost: 127.0.0.1:{self.port}\r\nAccept: text/event-stream\r\n"
            if self.order:
                head += f"Last-Event-ID: {self.order[-1]}\r\n"
            s.sendall((head + "\r\n").encode())
            stream = s.makefile("rb")
            if b" 200 " not in stream.readline():
                raise OSError("no stream")
            while stream.readline().strip():
                pass
            fields: dict[str, str] = {}
            while not self._ended:
                size = int(stream.readline(), 16)
                if size == 0:
                    raise OSError("end of the stream")
                chunk = stream.read(size)
                stream.readline()
                for line in chunk.decode().split("\n"):
                    if line == "":
                        self._take(fields)
                        fields = {}
                    elif not line.startswith(":"):
                        name, _, value = line.partition(":")
                        fields[name] = value.removeprefix(" ")

    def _take(self, fields: dict[str, str]) -> None:
        if "id" not in fields or "data" not in fields:
            return
        number, event = int(fields["id"]), json.loads(fields["data"])
        if self.heard.setdefault(number, event) != event:
            self.conflicts.append(number)
        self.heard_at.setdefault(number, time.monotonic())
        self.order.append(number)
