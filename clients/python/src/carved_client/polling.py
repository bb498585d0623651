"""Follows the status as a scheduler does, over restarts of the daemon.

change seen ──> 0.25 s ──> nothing new ──> 0.5 s ──> 1 s ──> 2 s ──> 4 s ──> 5 s ──> 5 s ...
     ^_______________________|
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

from .errors import ProblemError, TimedOut, Unreachable
from .models import Status
from .transport import RETRIED

FIRST_PAUSE_S = 0.25
LONGEST_PAUSE_S = 5.0

Sleep = Callable[[float], None]


def _away(error: Unreachable | ProblemError) -> bool:
    """Whether this answer can come from a daemon that is restarting, or from a proxy in front of it."""
    return isinstance(error, Unreachable) or error.status in RETRIED


def poll(
    ask: Callable[[str | None], tuple[Status | None, str | None]], sleep: Sleep, timeout_s: float | None
) -> Iterator[Status]:
    """Polls with `If-None-Match`, less often while nothing changes."""
    until = None if timeout_s is None else time.monotonic() + timeout_s
    etag, pause_s = None, FIRST_PAUSE_S
    while until is None or time.monotonic() < until:
        try:
            status, etag = ask(etag)
        except (Unreachable, ProblemError) as error:
            if not _away(error):
                raise
            status = None
        if status is not None:
            pause_s = FIRST_PAUSE_S
            yield status
        sleep(pause_s)
        pause_s = min(2.0 * pause_s, LONGEST_PAUSE_S)


def follow(newer: Callable[[int, float], Status], sleep: Sleep, timeout_s: float | None) -> Iterator[Status]:
    """Long polls: each answer is a change, or the unchanged status after the daemon's longest wait."""
    until = None if timeout_s is None else time.monotonic() + timeout_s
    seen: tuple[str, int] | None = None
    # No revision of a daemon is 0: the first answer comes at once, also after a restart.
    after, failures = 0, 0
    while True:
        left_s = 25.0 if until is None else until - time.monotonic()
        if left_s <= 0.0:
            return
        try:
            status = newer(after, min(left_s, 25.0))
        except (Unreachable, ProblemError) as error:
            if not _away(error):
                raise
            sleep(min(FIRST_PAUSE_S * 2.0**failures, LONGEST_PAUSE_S))
            after, failures = 0, min(failures + 1, 8)
            continue
        failures = 0
        after, now = status.revision, (status.boot_id, status.revision)
        if now != seen:
            seen = now
            yield status


def first(statuses: Iterator[Status], done: Callable[[Status], bool], what: str, timeout_s: float | None) -> Status:
    """The first status for which `done` returns true."""
    last: Status | None = None
    for last in statuses:
        if done(last):
            return last
    shown = "no answer at all" if last is None else f"state {last.state}: {last.doing}"
    raise TimedOut(f"waited {timeout_s} s for {what}; last seen: {shown}")
