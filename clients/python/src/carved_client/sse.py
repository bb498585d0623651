"""`GET /v1/events`: server-sent events, continued after the last one that was read.

id: 41, data: {...} ──> Event
event: resync       ──> Resync: events are missing, read the status again
interrupted, or 503 ──> after the pause that the daemon asked for, again with Last-Event-ID
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import httpx

from .decode import decode
from .errors import MalformedAnswer, ProblemError
from .models import Event, Resync
from .transport import RETRIED, Transport, problem_of, retry_after_s

#: The daemon sends a comment every 15 s, so a longer silence means a dead connection.
SILENCE_S = 40.0


@dataclass
class Message:
    """One message of the stream, as far as it was read."""

    name: str = ""
    data: list[str] = field(default_factory=list)
    id: str | None = None
    retry_ms: int | None = None


def messages(lines: Iterable[str]) -> Iterator[Message]:
    """Parses the lines of a stream (WHATWG HTML, 9.2.6). A message without its final empty line is dropped."""
    message = Message()
    for line in lines:
        if not line:
            yield message
            message = Message()
        elif not line.startswith(":"):
            name, _, value = line.partition(":")
            value = value.removeprefix(" ")
            if name == "event":
                message.name = value
            elif name == "data":
                message.data.append(value)
            elif name == "id":
                message.id = value
            elif name == "retry" and value.isdecimal():
                message.retry_ms = int(value)


def events(transport: Transport, last_event_id: int | None) -> Iterator[Event | Resync]:
    """Yields the journal after `last_event_id` without end. Only a refusal ends it."""
    seen, pause_s, failures = last_event_id, 2.0, 0
    while True:
        asked_s = 0.0
        headers = {"accept": "text/event-stream", **({} if seen is None else {"last-event-id": str(seen)})}
        try:
            with transport.stream("/v1/events", headers=headers, timeout_s=SILENCE_S) as response:
                if not response.is_success:
                    response.read()
                    asked_s = retry_after_s(response) or 0.0
                    raise ProblemError(problem_of(response), "GET /v1/events")
                for message in messages(response.iter_lines()):
                    failures = 0
                    if message.retry_ms is not None:
                        pause_s = message.retry_ms / 1000.0
                    told = _told(message)
                    if isinstance(told, Event):
                        seen = told.id
                    if told is not None:
                        yield told
        except ProblemError as error:
            if error.status not in RETRIED:
                raise
        except httpx.TransportError:
            # Interrupted, for example by a restart of the daemon. The journal keeps the events of this time.
            pass
        transport.sleep(max(asked_s, min(pause_s * 2.0**failures, max(pause_s, 5.0))))
        failures = min(failures + 1, 4)


def _told(message: Message) -> Event | Resync | None:
    if not message.data:
        return None
    try:
        data = json.loads("\n".join(message.data))
    except ValueError as error:
        raise MalformedAnswer(f"event {message.id}: not JSON: {message.data[0][:200]!r}") from error
    return decode(Resync, data) if message.name == "resync" else decode(Event, data)
