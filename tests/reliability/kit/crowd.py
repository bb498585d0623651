"""Many clients that poll at a fixed pace, in one process on epoll: `python3 -m tests.reliability.kit.crowd PORT CLIENTS HZ SECONDS`.

The latency counts from the moment at which a request was due, so a client that falls behind counts against the daemon.
"""

from __future__ import annotations

import heapq
import json
import random
import resource
import select
import socket
import subprocess
import sys
import time
from dataclasses import dataclass, field
from typing import Any


@dataclass
class _Client:
    socket: socket.socket
    got: bytes = b""
    tag: bytes = b""
    due: float = 0.0
    waits: bool = False


@dataclass
class _Crowd:
    port: int
    hz: float
    clients: dict[int, _Client] = field(default_factory=dict)
    poller: select.epoll = field(default_factory=select.epoll)
    latencies: list[float] = field(default_factory=list)
    codes: dict[str, int] = field(default_factory=dict)
    errors: int = 0
    skipped: int = 0

    def open(self, count: int) -> None:
        for _ in range(count):
            s = socket.create_connection(("127.0.0.1", self.port), timeout=30)
            s.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            s.setblocking(False)
            self.clients[s.fileno()] = _Client(s)
            self.poller.register(s.fileno(), select.EPOLLIN)

    def drop(self, descriptor: int) -> None:
        self.errors += 1
        self.poller.unregister(descriptor)
        self.clients.pop(descriptor).socket.close()

    def ask(self, descriptor: int, due: float) -> None:
        client = self.clients[descriptor]
        if client.waits:
            self.skipped += 1
            return
        client.due, client.waits = due, True
        tag = b"If-None-Match: " + client.tag + b"\r\n" if client.tag else b""
        try:
            client.socket.send(f"GET /v1/status HTTP/1.1\r\nHost: 127.0.0.1:{self.port}\r\n".encode() + tag + b"\r\n")
        except OSError:
            self.drop(descriptor)

    def read(self, descriptor: int) -> None:
        client = self.clients[descriptor]
        try:
            got = client.socket.recv(262_144)
        except OSError:
            got = b""
        if not got:
            self.drop(descriptor)
            return
        client.got += got
        end = client.got.find(b"\r\n\r\n")
        if end < 0:
            return
        fields = {k.lower(): v for k, _, v in (line.partition(b": ") for line in client.got[:end].split(b"\r\n")[1:])}
        code = client.got[9:12].decode()
        if code != "304" and len(client.got) < end + 4 + int(fields.get(b"content-length", b"0")):
            return
        self.latencies.append(time.monotonic() - client.due)
        self.codes[code] = self.codes.get(code, 0) + 1
        client.tag, client.got, client.waits = fields.get(b"etag", client.tag), b"", False

    def run(self, seconds: float) -> None:
        begin = time.monotonic()
        due = [(begin + random.random() / self.hz, descriptor) for descriptor in self.clients]
        heapq.heapify(due)
        while (now := time.monotonic()) < begin + seconds and due:
            while due and due[0][0] <= now:
                when, descriptor = heapq.heappop(due)
                if descriptor in self.clients:
                    heapq.heappush(due, (when + 1 / self.hz, descriptor))
                    self.ask(descriptor, when)
            pause = max(0.0, min(due[0][0] if due else now, begin + seconds) - time.monotonic())
            for descriptor, _ in self.poller.poll(pause):
                self.read(descriptor)


def start(port: int, clients: int, hz: float, seconds: float) -> subprocess.Popen[str]:
    """Starts a crowd in a process of its own."""
    package = __package__ or ""
    command = [sys.executable, "-m", f"{package}.crowd", str(port), str(clients), str(hz), str(seconds)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def result(crowd: subprocess.Popen[str]) -> dict[str, Any]:
    """Waits for the end of a crowd: answers, codes, errors, skipped, p50_ms, p99_ms."""
    found: dict[str, Any] = json.loads(crowd.communicate()[0])
    return found


def main() -> None:
    """Polls as the arguments say and prints one line of JSON."""
    port, clients, hz, seconds = int(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3]), float(sys.argv[4])
    hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(20_000, hard), hard))
    crowd = _Crowd(port, hz)
    crowd.open(clients)
    crowd.run(seconds)
    ordered = sorted(crowd.latencies)

    def at(share: float) -> float | None:
        return 1000 * ordered[min(len(ordered) - 1, int(len(ordered) * share))] if ordered else None

    print(
        json.dumps(
            {
                "answers": len(ordered),
                "codes": crowd.codes,
                "errors": crowd.errors,
                "skipped": crowd.skipped,
                "p50_ms": at(0.5),
                "p99_ms": at(0.99),
            }
        )
    )


if __name__ == "__main__":
    main()
