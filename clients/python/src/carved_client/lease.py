"""While a lease lasts, its holder alone commands the instrument; others get 423 with who holds it and for how long.

with client.lease("loader 1"):   PUT /v1/lease, under a token of its own: sent again where the answer is lost
    ...                          the token goes with every request; a thread begins its time anew, thrice in each ttl
                                 DELETE on the way out; of a client that dies it is free after ttl_s
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
    """Held inside its `with` block. An abort or emergency stop by others passes all the same."""

    def __init__(self, transport: Transport, holder: str, ttl_s: int) -> None:
        self._transport, self._holder, self._ttl_s = transport, holder, ttl_s
        # Its own, so that the daemon knows a request that comes again.
        self._token = secrets.token_hex(16)
        self._done = threading.Event()
        self._renewal = threading.Thread(target=self._renew, name="carved-lease", daemon=True)
        #: Why it could not be renewed, if so: it is over, or soon will be.
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
        # One that is over already, or whose daemon is away, needs no end.
        with contextlib.suppress(CarvedError):
            self._transport.request("DELETE", "/v1/lease")
        self._transport.lease_token = None
