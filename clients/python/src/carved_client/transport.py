"""One request, repeated as often as necessary and allowed.

GET PUT DELETE, and POST that the caller marks as idempotent
  ├─ connection lost, timed out, 429 500 502 503 504 ──> pause: Retry-After, else 0.25 s doubling to 5 s ──> again
  └─ anything else, or no attempts left ──> the answer, or Unreachable
any other POST: once
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import httpx

from .decode import decode
from .errors import CarvedError, Problem, ProblemError, Unreachable

RETRIED = frozenset({429, 500, 502, 503, 504})
IDEMPOTENT = frozenset({"GET", "HEAD", "PUT", "DELETE"})


@dataclass(frozen=True)
class Retry:
    """How often a request is repeated, and with which pauses."""

    attempts: int = 8
    first_pause_s: float = 0.25
    longest_pause_s: float = 5.0
    #: If the daemon asks for a longer pause than this, its answer is raised as an error.
    longest_retry_after_s: float = 60.0

    def pause_s(self, failures: int) -> float:
        """The pause after this number of failures in a row (at least one)."""
        return min(self.first_pause_s * 2.0 ** (failures - 1), self.longest_pause_s)


#: An emergency stop must not wait because of a lost packet.
AT_ONCE = Retry(attempts=20, first_pause_s=0.05, longest_pause_s=0.2, longest_retry_after_s=0.0)


class Transport:
    """An HTTP connection to one daemon, with repeats and errors."""

    def __init__(
        self,
        base_url: str,
        *,
        token: str | None = None,
        timeout_s: float = 10.0,
        retry: Retry | None = None,
        transport: httpx.BaseTransport | None = None,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        headers = {"authorization": f"Bearer {token}"} if token else {}
        # Proxies of the environment are for the internet, not for an instrument.
        self._http = httpx.Client(
            base_url=base_url, headers=headers, timeout=timeout_s, transport=transport, trust_env=False
        )
        self.timeout_s = timeout_s
        self.retry = retry or Retry()
        self.sleep = sleep
        #: The token of a held lease, sent with every request.
        self.lease_token: str | None = None

    def close(self) -> None:
        """Closes the connections."""
        self._http.close()

    def request(
        self,
        method: str,
        path: str,
        *,
        body: object | None = None,
        content: tuple[bytes, str] | None = None,
        params: Mapping[str, str | int | float] | None = None,
        headers: Mapping[str, str] | None = None,
        idempotent: bool | None = None,
        timeout_s: float | None = None,
        retry: Retry | None = None,
    ) -> httpx.Response:
        """Sends a request. Returns 2xx and 304 answers, and raises all others as `CarvedError`.

        The body is JSON, or `content` with its media type.
        """
        retry = retry or self.retry
        again = method in IDEMPOTENT if idempotent is None else idempotent
        name = f"{method} {path}"
        if body is not None:
            content = (json.dumps(body).encode(), "application/json")
        sent = dict(headers or {})
        if content is not None:
            sent["content-type"] = content[1]
        if self.lease_token is not None:
            sent["carved-lease"] = self.lease_token
        request = self._http.build_request(
            method,
            path,
            content=None if content is None else content[0],
            params=params,
            headers=sent,
            timeout=self.timeout_s if timeout_s is None else timeout_s,
        )
        failures = 0
        while True:
            pause_s: float | None
            failure: CarvedError
            try:
                response = self._http.send(request)
            except httpx.TransportError as error:
                failure = Unreachable(f"{name}: {type(error).__name__}: {error}")
                failure.__cause__ = error
                pause_s = retry.pause_s(failures + 1)
            else:
                if response.is_success or response.status_code == httpx.codes.NOT_MODIFIED:
                    return response
                failure = ProblemError(problem_of(response), name)
                pause_s = self._pause_s(response, failures + 1, retry) if response.status_code in RETRIED else None
            failures += 1
            if pause_s is None or not again or failures >= retry.attempts:
                raise failure
            self.sleep(pause_s)

    @staticmethod
    def _pause_s(response: httpx.Response, failures: int, retry: Retry) -> float | None:
        """The pause that the daemon asks for, and at least the back-off. None if it is too long."""
        asked_s = retry_after_s(response)
        if asked_s is None:
            return retry.pause_s(failures)
        if asked_s > retry.longest_retry_after_s > 0.0:
            return None
        return max(min(asked_s, retry.longest_retry_after_s), retry.pause_s(failures))

    def stream(self, path: str, *, headers: Mapping[str, str], timeout_s: float) -> Any:
        """Opens a stream, without repeats. Returns a context manager of the response."""
        return self._http.stream("GET", path, headers=dict(headers), timeout=timeout_s)


def retry_after_s(response: httpx.Response) -> float | None:
    """The pause that an answer asks for, s. None if it asks for none."""
    asked = response.headers.get("retry-after", "").strip()
    return float(asked) if asked.isdecimal() else None


def problem_of(response: httpx.Response) -> Problem:
    """The problem of a refusal, also if another program than carved refused."""
    kind = response.headers.get("content-type", "")
    if kind.split(";")[0].strip() == "application/problem+json":
        try:
            return decode(Problem, response.json())
        except (ValueError, CarvedError):
            pass
    detail = f"an answer that is not carved's: {kind or 'no content type'}: {response.text[:200]!r}"
    return Problem(status=response.status_code, code="foreign_answer", detail=detail)
