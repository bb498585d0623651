"""The bad line has the stated faults, and the same ones again for the same seed."""

from __future__ import annotations

import contextlib
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import httpx
import pytest

from carved_client.simulated_loader import BadLine, Mischief
from carved_client.watch import Misled


def fates(seed: int, mischief: Mischief, interleaved: int) -> list[str]:
    """The faults of twenty commands, with this number of polls between two of them."""

    def answer(request: httpx.Request) -> httpx.Response:
        return httpx.Response(200)

    line = BadLine(httpx.MockTransport(answer), mischief, seed)
    found = []
    with httpx.Client(transport=line, base_url="http://127.0.0.1:9") as http:
        for _ in range(20):
            for _ in range(interleaved):
                with contextlib.suppress(httpx.TransportError):
                    http.get("/v1/status")
            before = dict(line.done)
            try:
                http.put("/v1/runs/r")
                found.append("twice" if line.done["twice"] > before.get("twice", 0) else "through")
            except httpx.TransportError as error:
                found.append(type(error).__name__)
    return found


def test_a_seed_settles_what_becomes_of_commands_however_often_is_polled_between() -> None:
    mischief = Mischief(lost=0.2, cut=0.2, unanswered=0.2, twice=0.2)
    assert fates(3, mischief, 0) == fates(3, mischief, 5)
    assert fates(3, mischief, 0) != fates(4, mischief, 0)
    assert set(fates(3, mischief, 0)) == {"ConnectError", "ReadError", "ReadTimeout", "twice", "through"}


def test_a_command_that_is_refused_when_it_comes_twice_is_found_out() -> None:
    answers = [httpx.Response(201), httpx.Response(409)]
    line = BadLine(httpx.MockTransport(lambda request: answers.pop(0)), Mischief(twice=1.0), 1)
    with httpx.Client(transport=line) as http, pytest.raises(Misled, match="was taken, and refused when it came twice"):
        http.put("http://instrument/v1/runs/r")


def test_half_a_request_arrives_where_the_line_is_cut() -> None:
    heard: list[bytes] = []
    arrived = threading.Event()

    class Ears(BaseHTTPRequestHandler):
        def do_PUT(self) -> None:
            heard.append(self.rfile.read())
            arrived.set()

        def log_message(self, format: str, *arguments: object) -> None: ...

    with ThreadingHTTPServer(("127.0.0.1", 0), Ears) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        line = BadLine(httpx.HTTPTransport(), Mischief(cut=1.0), 1)
        with httpx.Client(transport=line) as http, pytest.raises(httpx.ReadError):
            http.put(f"http://127.0.0.1:{server.server_port}/x", content=b"12345678")
        assert arrived.wait(10.0)
        server.shutdown()
    assert heard == [b"1234"]
