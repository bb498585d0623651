"""While a lease lasts, only its holder commands the instrument; others get 423 with the holder and the time left.

with client.lease("loader 1"):   PUT /v1/lease with a token of its own: repeated if the answer is lost
    ...                          every request carries the token; a thread renews the lease three times per ttl
                                 DELETE at the end; if the client dies, the lease ends after ttl_s
"""

from __future__ import annotations

import contextlib
import secrets
import threading
from types import TracebackType

from .decode import decode
from .errors import CarvedError, MalformedAnswer
from .transport import Transport


class Lease:
    """A lease, held inside its `with` block. An abort or emergency stop of another client is still accepted."""

    def __init__(self, transport: Transport, holder: str, ttl_s: int) -> None:
        self._transport, self._holder, self._ttl_s = transport, holder, ttl_s
        # A token of its own, by which the daemon recognises a repeated request.
        self._token = secrets.token_hex(16)
        self._done = threading.Event()
        self._renewal = threading.Thread(target=self._renew, name="carved-lease", daemon=True)
        #: Why the lease could not be renewed; None while it is valid.
        self.lost: CarvedError | None = None

    def _put(self) -> str:
        body = {"holder": self._holder, "ttl_s": self._ttl_s, "token": self._token}
        answer = decode(dict[str, object], self._transport.request("PUT", "/v1/lease", body=body).json())
        token = answer.get("token")
        if not isinstance(token, str):
            raise MalformedAnswer("PUT /v1/lease: no token")
        return token

    def _renew(self) -> None:
        while not self._done.wait(self._ttl_s / 3.0):
            try:
                self._put()
            except CarvedError as error:
                self.lost = error

    def __enter__(self) -> Lease:
        self._transport.lease_token = self._put()
        self._renewal.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._done.set()
        self._renewal.join()
        # A lease that has ended, or whose daemon is away, need not be ended.
        with contextlib.suppress(CarvedError):
            self._transport.request("DELETE", "/v1/lease")
        self._transport.lease_token = None
