"""HTTP without retries, and raw exchanges for requests that no HTTP library sends."""

from __future__ import annotations

import http.client
import json
import socket
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Answer:
    """One answer."""

    status: int
    headers: dict[str, str]
    body: bytes

    def json(self) -> Any:
        """The body as JSON, or None if it is none."""
        try:
            return json.loads(self.body)
        except ValueError:
            return None


def request(port: int, method: str, path: str, body: object = None, headers: dict[str, str] | None = None, timeout: float = 15) -> Answer:
    """Sends one request on a connection of its own. A body that is neither bytes nor text is sent as JSON."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=timeout)
    try:
        sent = dict(headers or {})
        if body is not None and not isinstance(body, (bytes, str)):
            body = json.dumps(body)
            sent.setdefault("Content-Type", "application/json")
        connection.request(method, path, body=body, headers=sent)
        response = connection.getresponse()
        return Answer(response.status, {name.lower(): value for name, value in response.getheaders()}, response.read())
    except http.client.HTTPException as error:
        raise ConnectionError(repr(error)) from error
    finally:
        connection.close()


def exchange(port: int, raw: bytes, timeout: float = 10) -> bytes:
    """Sends `raw` and returns everything that comes until the other side closes, or the head of an endless stream."""
    got = b""
    with socket.create_connection(("127.0.0.1", port), timeout=timeout) as s:
        try:
            s.sendall(raw)
            while chunk := s.recv(65536):
                got += chunk
                if b"text/event-stream" in got:
                    break
        except OSError:
            pass
    return got


def status_of(answer: bytes) -> int | None:
    """The status code of a raw answer."""
    return int(answer[9:12]) if answer.startswith(b"HTTP/1.") and answer[9:12].isdigit() else None
