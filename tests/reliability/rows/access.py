"""R16 and R17: every mutating route of the contract under every attack, and the rules of exposure."""

from __future__ import annotations

import os
import statistics
import subprocess
import time
from collections import Counter
from collections.abc import Iterator
from typing import Any

from ..kit.daemon import Daemon, free_port, panics
from ..kit.http import exchange, status_of
from ..kit.row import Context, Observed, Row, percentile
from ..kit.served import configuration, serve

_TOKEN = "0123456789abcdef" * 4
_PAIRS = 1000
"""So many pairs of wrong tokens tell times apart."""
_MUTATING = ("put", "post", "delete", "patch")
_JSON = ("Content-Type", "application/json")
_NO_HTTP = ("no host", "two hosts")
"""Attacks whose head is no HTTP/1.1, so 400 is an answer too."""
Headers = list[tuple[str, str]]


def _send(port: int, method: str, target: str, headers: Headers, body: bytes = b"") -> int | None:
    lines = [f"{method} {target} HTTP/1.1", *(f"{name}: {value}" for name, value in headers)]
    if body or method != "GET":
        lines.append(f"Content-Length: {len(body)}")
    raw = ("\r\n".join([*lines, "Connection: close"]) + "\r\n\r\n").encode("latin1")
    return status_of(exchange(port, raw + body))


def _routes(contract: dict[str, Any], mutating: bool) -> Iterator[tuple[str, str, bool]]:
    """Method, path with example values, and whether the contract asks for the token."""
    for template, item in contract["paths"].items():
        for method, operation in item.items():
            if method in ("get", *_MUTATING) and (method in _MUTATING) == mutating:
                path = template
                examples = {"run_id": "r1", "well": "A01", "seq": "1", "view": "0.png", "picture": "lateral.png", "name": "n1"}
                for name, value in examples.items():
                    path = path.replace(f"{{{name}}}", value)
                if "{" in path:
                    raise ValueError(f"{template} has a parameter without an example value")
                yield method.upper(), path, any(operation.get("security") or [])


def _attacks(port: int, token: str | None) -> dict[str, Headers]:
    own = ("Host", f"127.0.0.1:{port}")
    auth: Headers = [("Authorization", f"Bearer {token}")] if token else []
    hosts = {
        "hostile host": "evil.example",
        "hostile host with port": f"evil.example:{port}",
        "empty host": "",
        "host with user": "127.0.0.1@evil.example",
        "host as user": f"evil@127.0.0.1:{port}",
        "host as prefix": "127.0.0.1.evil.example",
        "localhost as prefix": f"localhost.evil.example:{port}",
        "any address": f"0.0.0.0:{port}",
        "broken bracket": "[::1",
    }
    attacks: dict[str, Headers] = {name: [("Host", host), _JSON, *auth] for name, host in hosts.items()}
    attacks |= {
        "no host": [_JSON, *auth],
        "two hosts": [own, ("Host", "evil.example"), _JSON, *auth],
        "DNS rebinding": [("Host", f"evil.example:{port}"), ("Origin", f"http://evil.example:{port}"), _JSON, *auth],
    }
    origins = ("http://evil.example", "null", "", "http://127.0.0.1:1", f"ftp://127.0.0.1:{port}", f"http://127.0.0.1:{port}.evil.example")
    attacks |= {f"origin {origin!r}": [own, ("Origin", origin), _JSON, *auth] for origin in origins}
    for site in ("cross-site", "same-site"):
        attacks[f"Sec-Fetch-Site {site}"] = [own, ("Sec-Fetch-Site", site), _JSON, *auth]
    if token:
        wrong = {
            "no token": [],
            "empty token": ["Bearer "],
            "wrong token": ["Bearer " + "0" * 64],
            "half of the token": ["Bearer " + token[:32]],
            "token and more": ["Bearer " + token + "0"],
            "other scheme": [f"Basic {token}"],
            "token in upper case": ["Bearer " + token.upper()],
            "wrong and right token": ["Bearer " + "0" * 64, f"Bearer {token}"],
        }
        attacks |= {name: [own, _JSON, *(("Authorization", v) for v in values)] for name, values in wrong.items()}
    return attacks


def _state(daemon: Daemon) -> dict[str, Any]:
    """What a command can change."""
    status = daemon.status()
    state = {key: status[key] for key in ("state", "pending", "plate", "run", "specimen", "faults")}
    return {**state, "lease": daemon.http("GET", "/v1/lease").json()}


def _matrix(daemon: Daemon, token: str | None, attacks: dict[str, Headers], observed: Observed) -> tuple[int, Counter[int | None]]:
    contract, codes, sent = daemon.http("GET", "/openapi.json").json(), Counter[int | None](), 0
    routes = list(_routes(contract, mutating=True))
    observed.expect(len(routes) >= 15, f"only {len(routes)} mutating routes in the contract")
    before = _state(daemon)
    auth: Headers = [("Authorization", f"Bearer {token}")] if token else []
    for method, path, _ in routes:
        for name, headers in attacks.items():
            code = _send(daemon.port, method, path, headers, b"{}")
            codes[code] += 1
            allowed = (401, 403, 400) if name in _NO_HTTP else (401, 403)
            observed.expect(code in allowed, f"{method} {path}: {name} is answered by {code}")
        absolute = f"http://evil.example:{daemon.port}{path}"
        code = _send(daemon.port, method, absolute, [("Host", f"127.0.0.1:{daemon.port}"), _JSON, *auth], b"{}")
        codes[code] += 1
        observed.expect(code in (401, 403), f"{method} {absolute} is answered by {code}")
        sent += len(attacks) + 1
    asked = 0
    for method, path, needs_token in _routes(contract, mutating=False):
        code = _send(daemon.port, method, path, [("Host", "evil.example"), *auth])
        codes[code] += 1
        sent += 1
        observed.expect(code == 403, f"{method} {path} for a hostile host is answered by {code}")
        if token and needs_token:
            asked += 1
            sent += 1
            code = _send(daemon.port, method, path, [("Host", f"127.0.0.1:{daemon.port}")])
            codes[code] += 1
            observed.expect(code == 401, f"{method} {path} without a token is answered by {code}")
    if token:
        observed.expect(asked >= 20, f"only {asked} reading routes of the contract ask for the token")
        observed.figures.append(f"{len(routes)} mutating routes, {asked} reading ones that ask for the token")
    after = _state(daemon)
    observed.expect(after == before, f"an attack changed the state from {before} to {after}")
    return sent, codes


def run_access(context: Context) -> Observed:
    """Every mutating route x attack, without and with a token."""
    observed, sent, codes, attacks_n = Observed(""), 0, Counter[int | None](), 0
    token_file = context.work / "token"
    token_file.write_text(_TOKEN)
    token_file.chmod(0o600)
    for token in (None, _TOKEN):
        port = free_port()
        keys = {"token_file": f'"{token_file}"'} if token else {}
        with serve(context, port, token, commands_per_minute=60_000, command_burst=10_000, **keys) as daemon:
            attacks = _attacks(port, token)
            if context.control:
                own: Headers = [("Host", f"127.0.0.1:{port}"), _JSON]
                attacks = {"no attack at all": own + ([("Authorization", f"Bearer {token}")] if token else [])}
            attacks_n = max(attacks_n, len(attacks))
            n, found = _matrix(daemon, token, attacks, observed)
            sent, codes = sent + n, codes + found
            daemon.end()
    observed.misses += panics(context.work / "daemon.log")
    observed.done = (
        f"every mutating route of the contract x {attacks_n + 1} attacks, without and with a token; every reading route for a hostile "
        "host and without the token"
    )
    observed.figures.append(f"{sent} requests: " + ", ".join(f"{code}: {n}" for code, n in sorted(codes.items(), key=str)))
    return observed


R16 = Row(
    "R16",
    "DNS rebinding, cross-site, no or bad token",
    "every mutating route x every attack = 401/403 (400 too for a head with no host or two, which is no HTTP), every route that asks for "
    "the token refuses without it, routes taken from the OpenAPI",
    (1, 1, 1),
    "matrix",
    "the attack is left out: own host, right token",
    r"no attack at all is answered by 2",
    run_access,
)


def _starts(context: Context, observed: Observed, name: str, wanted: bool, listen: str | None = None, **http: str | int) -> None:
    port = free_port()
    path = configuration(context, port, (listen or "127.0.0.1:{}").format(port), **http)
    process = subprocess.Popen([context.binary, "serve", "--config", path], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    end, started = time.monotonic() + 20, False
    address = f"127.0.0.1:{port}"
    while process.poll() is None and time.monotonic() < end and not started:
        started = status_of(exchange_or_none(port, f"GET /livez HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n")) is not None
        time.sleep(0.05)
    if process.poll() is None:
        process.terminate()
    said = process.communicate(timeout=20)[0]
    observed.expect(started == wanted, f"{name}: {'starts' if started else 'is refused'}: {said[-200:]}")


def exchange_or_none(port: int, text: str) -> bytes:
    """The answer, or nothing if nobody listens."""
    try:
        return exchange(port, text.encode(), 5)
    except OSError:
        return b""


def _exposure(context: Context, observed: Observed) -> int:
    token = context.work / "token"

    def write(text: str, mode: int = 0o600) -> str:
        token.unlink(missing_ok=True)
        token.write_text(text)
        token.chmod(mode)
        return f'"{token}"'

    cases: list[tuple[str, bool, str | None, str | None]] = [
        ("loopback without a token", True, None, None),
        ("0.0.0.0 without a token", False, "0.0.0.0:{}", None),
        ("[::] without a token", False, "[::]:{}", None),
        ("0.0.0.0 with a token", True, "0.0.0.0:{}", write(_TOKEN)),
    ]
    if context.control:
        # The token makes this start, and the rule says that it must not.
        cases = [("0.0.0.0 without a token", False, "0.0.0.0:{}", write(_TOKEN))]
    for name, wanted, listen, file in cases:
        _starts(context, observed, name, wanted, listen, **({"token_file": file} if file else {}))
    files = [] if context.control else [
        ("token file 0640", _TOKEN, 0o640), ("token file 0604", _TOKEN, 0o604), ("short token", "short", 0o600),
        ("empty token", "", 0o600), ("token with blanks", "a" * 31 + " b" * 8, 0o600), ("token that is not ASCII", "ü" * 40, 0o600),
    ]  # fmt: skip
    for name, text, mode in files:
        _starts(context, observed, name, False, None, token_file=write(text, mode))
    token.unlink(missing_ok=True)
    if not context.control:
        _starts(context, observed, "token file that is missing", False, None, token_file=f'"{token}"')
        os.mkfifo(token, 0o600)
        _starts(context, observed, "token file that is a pipe", False, None, token_file=f'"{token}"')
        token.unlink()
        _starts(context, observed, "allowed host *", False, None, allowed_hosts='["*"]')
    return len(cases) + len(files) + 3


def run_exposure(context: Context) -> Observed:
    """The rules of exposure, then `count` wrong tokens and the time of their comparison."""
    observed = Observed("", machine_load=True)
    n = _exposure(context, observed)
    token = context.work / "token"
    token.write_text(_TOKEN)
    token.chmod(0o600)
    port = free_port()
    with serve(context, port, _TOKEN, token_file=f'"{token}"') as daemon:

        def ask(value: str) -> int | None:
            return _send(port, "GET", "/v1/status", [("Host", f"127.0.0.1:{port}"), ("Authorization", f"Bearer {value}")])

        began = time.monotonic()
        codes = Counter(ask(f"{i:064d}") for i in range(context.count))
        pace = context.count / (time.monotonic() - began)
        first: list[float] = []
        last: list[float] = []
        for _ in range(context.count):
            for wrong, times in (("x" + _TOKEN[1:], first), (_TOKEN[:-1] + "x", last)):
                start = time.perf_counter()
                ask(wrong)
                times.append(1e6 * (time.perf_counter() - start))
        right = daemon.http("GET", "/v1/status").status
        observed.expect(right == 200, f"the right token after the wrong ones is answered by {right}")
        metrics = daemon.http("GET", "/metrics").body
        observed.expect(_TOKEN.encode() not in metrics, "the token is in the metrics")
        daemon.end()
    observed.expect(_TOKEN not in (context.work / "daemon.log").read_text(errors="replace"), "the token is in the log")
    observed.expect(set(codes) <= {401, 429}, f"wrong tokens are answered by {codes}")
    observed.expect(codes[429] > 0, f"no lock-out: {codes[401]} wrong tokens at {pace:.0f} per s were each answered by 401")
    spread = (percentile(first, 0.75) or 0) - (percentile(first, 0.25) or 0)
    apart = abs(statistics.median(first) - statistics.median(last))
    if context.count >= _PAIRS:
        observed.expect(apart <= max(spread, 50), f"a token wrong at its first or last letter is told apart by {apart:.0f} us")
    else:
        observed.not_judged.append(f"constant-time compare: needs {_PAIRS} pairs")
    observed.done = (
        f"{n} starts with good and bad exposure; {context.count} wrong tokens, and {context.count} pairs that differ in the first or "
        "last letter"
    )
    observed.figures += [
        f"wrong tokens at {pace:.0f} per s: " + ", ".join(f"{c}: {k}" for c, k in codes.items()),
        f"medians {apart:.0f} us apart, quartiles {spread:.0f} us apart",
    ]
    return observed


R17 = Row(
    "R17",
    "exposure",
    "loopback by default; refuses to listen elsewhere without a token; constant-time compare; token file 0600; lock-out after wrong tokens",
    (50, 1000, 5000),
    "wrong tokens",
    "a start that must be refused gets a token, so it starts",
    r"^0.0.0.0 without a token: starts",
    run_exposure,
    "there is no lock-out. A token has at least 32 characters, so guessing is hopeless at any pace, and a lock-out would let a program "
    "with an old token keep the loader of the same computer out.",
    "^no lock-out: ",
)
