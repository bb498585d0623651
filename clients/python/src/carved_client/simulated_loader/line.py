"""A bad line between loader and instrument. A seed determines what happens to each request.

request ──> lost: never arrives            cut: half of it arrives
        ──> unanswered: it arrives, its answer does not: the sender times out and sends it again
        ──> twice: it arrives twice, and both must get the same answer
"""

from __future__ import annotations

import socket
from collections import Counter
from dataclasses import dataclass, field
from random import Random

import httpx

from ..watch import Misled


@dataclass(frozen=True)
class Mischief:
    """Shares of the requests with each fault."""

    lost: float = 0.0
    cut: float = 0.0
    unanswered: float = 0.0
    twice: float = 0.0


@dataclass
class BadLine(httpx.BaseTransport):
    """Wraps a transport. For one seed, the n-th request of a method and path always has the same fault."""

    inner: httpx.BaseTransport
    mischief: Mischief
    seed: int
    done: Counter[str] = field(default_factory=Counter)
    _sent: Counter[str] = field(default_factory=Counter)

    def handle_request(self, request: httpx.Request) -> httpx.Response:
        """Passes a request on, with or without a fault."""
        name = f"{request.method} {request.url.path}"
        self._sent[name] += 1
        fate = self._fate(Random(f"{self.seed} {name} {self._sent[name]}").random())
        if fate is not None:
            self.done[fate] += 1
        if fate == "lost":
            raise httpx.ConnectError("the simulated line lost it", request=request)
        if fate == "cut":
            _send_half(request)
            raise httpx.ReadError("the simulated line was cut", request=request)
        if fate == "unanswered":
            self.inner.handle_request(request).read()
            raise httpx.ReadTimeout("the simulated line lost the answer", request=request)
        if fate == "twice" and request.method != "GET":
            first = self.inner.handle_request(request)
            first.read()
            second = self.inner.handle_request(request)
            if first.is_success and not second.is_success:
                second.read()
                raise Misled(f"{name} was taken, and refused when it came twice: {second.status_code} {second.text}")
            return second
        return self.inner.handle_request(request)

    def _fate(self, roll: float) -> str | None:
        for fate in ("lost", "cut", "unanswered", "twice"):
            roll -= float(getattr(self.mischief, fate))
            if roll < 0.0:
                return fate
        return None

    def close(self) -> None:
        """Closes the wrapped transport."""
        self.inner.close()


def _send_half(request: httpx.Request) -> None:
    """Sends the head and half of the body, or half of the head, on a connection of its own, and closes it."""
    target = request.url.raw_path.decode()
    lines = [f"{request.method} {target} HTTP/1.1", *(f"{k}: {v}" for k, v in request.headers.items())]
    head, body = "\r\n".join(lines).encode() + b"\r\n\r\n", request.read()
    sent = head + body[: len(body) // 2] if body else head[: len(head) // 2]
    try:
        with socket.create_connection((request.url.host, request.url.port or 80), timeout=5.0) as line:
            line.sendall(sent)
    except OSError:
        pass  # The daemon is away, which has the same effect.
