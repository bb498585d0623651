"""Makes Schemathesis appear as many clients, because a rate limit or a lease would refuse most requests."""

from __future__ import annotations

import itertools
from typing import Any

import requests
import schemathesis
import urllib3.util.connection as connections

_connect = connections.create_connection
_addresses = itertools.cycle(f"127.0.0.{last}" for last in range(2, 250))


def _connect_as_another(*arguments: Any, **options: Any) -> Any:
    """Each connection comes from another loopback address, because the daemon limits the rate per address."""
    return _connect(*arguments, **{**options, "source_address": (next(_addresses), 0)})


connections.create_connection = _connect_as_another


@schemathesis.hook
def after_call(context: Any, case: Any, response: Any) -> None:
    """Returns a lease that was granted to a generated request, because it would block all other requests."""
    if (case.method, case.path) == ("PUT", "/v1/lease") and response.status_code in (200, 201):
        requests.delete(response.request.url, headers={"carved-lease": response.json()["token"]}, timeout=10.0)
