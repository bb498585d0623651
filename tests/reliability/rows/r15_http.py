"""R15: random and mutated HTTP. No panic, no hang, no answer of the kind 500; heads and bodies are bounded."""

from __future__ import annotations

import random
import socket
import time
from collections import Counter
from typing import Any

from ..kit.daemon import free_port, panics
from ..kit.http import exchange, status_of
from ..kit.row import Context, Observed, Row
from ..kit.served import serve

_METHODS = ("get", "put", "post", "delete")
_WORDS = [
    b"A01", b"r1", b"..", b"%2e%2e", b"%00", b"\xff", b"%ff", b"A" * 300, b"-1", b"99999999999999999999", b"NaN", b"", b"%2F",
    b"A01.attempt-1", "ü".encode(), b"0.png", b"detection.png", b"null", b"'", b'"', b"{}", b"?", b"#", b"%", b";", b"\\",
]  # fmt: skip
_BODIES = [
    b"{}", b"[]", b"null", b"1", b"1e999", b"{" * 5000, b"[" * 20000, b'{"a":' * 3000,
    b'{"plate_barcode":"P","method":"standard","operator":"x","plate_map":[{"well":"A01"}]}',
    b'{"loaded":true}', b'{"loaded":1}', b'{"holder":"x","ttl_s":1}', b'{"intent":"load","barcode":"P-1"}', b'{"intent":"unload"}',
    b"\xef\xbb\xbf{}", b"\xff\xfe", b'{"a":"\\ud800"}', b'{"dpf":NaN}',
    b'{"plate_map":[' + b'{"well":"A01"},' * 2000 + b'{"well":"A01"}]}',
    b"well,dpf\nA01,1e999\n", b"well\n" + b"A01\n" * 3000, b"sep=;\nwell;dpf\nA01;-0,0\n",
]  # fmt: skip
_QUERIES = [
    b"wait=2&after=0", b"wait=-1", b"wait=1e9&after=18446744073709551615", b"after=18446744073709551616", b"limit=0", b"limit=201",
    b"cursor=%ff", b"attempt=-1", b"attempt=4294967296", b"plate=%00", b"=" * 50, b"&" * 200, b"wait=nan",
    b"cursor=9223372036854775808-x", b"cursor=-9223372036854775808-", b"runs=" + b"r," * 400, b"width=0", b"width=99999999",
]  # fmt: skip
_STRANGE_METHODS = [b"GET", b"HEAD", b"OPTIONS", b"TRACE", b"PATCH", b"CONNECT", b"\x00", b"GET" * 50, b"get", b"PRI"]


def _header(rng: random.Random) -> bytes:
    return rng.choice(
        [
            b"If-None-Match: " + rng.choice([b"*", b'"x"', b'W/"' + b"a" * 500 + b'"', b'"\xff"', b",,,,"]),
            b"If-Match: *",
            b"Last-Event-ID: " + rng.choice([b"-1", b"0", b"1", b"x", b"18446744073709551615", b"\xff"]),
            b"Carved-Lease: " + rng.choice([b"x", b"\xff", b"a" * 64]),
            b"Range: bytes=0-0,5-",
            b"Expect: 100-continue",
            b"Upgrade: h2c\r\nConnection: Upgrade",
            b"Authorization: Bearer \xff",
            b"Origin: null",
            b"Accept-Encoding: " + b"gzip," * 100,
            b"X: " + b"a" * rng.choice([100, 15_000, 70_000]),
            b" folded: x",
            b"X\x00: y",
            b"Connection: close",
        ]
    )


def _target(rng: random.Random, routes: list[tuple[str, str]]) -> tuple[bytes, bytes]:
    method, path_text = rng.choice(routes)
    path = path_text.encode()
    for name in (b"{run_id}", b"{well}", b"{seq}", b"{view}"):
        path = path.replace(name, rng.choice(_WORDS))
    if rng.random() < 0.3:
        path += b"?" + rng.choice(_QUERIES)
    if rng.random() < 0.1:
        path = rng.randbytes(rng.randrange(40))
    return (method.encode() if rng.random() < 0.85 else rng.choice(_STRANGE_METHODS)), path


def _body_headers(rng: random.Random, body: bytes) -> tuple[bytes, bytes]:
    json = b"Content-Type: application/json\r\n"
    others = [
        b"Content-Type: text/csv\r\n",
        b"Content-Type: application/json; charset=\xff\r\n",
        b"",
        b"Content-Type: multipart/form-data\r\n",
    ]
    head, kind = rng.choice([json] * 6 + others), rng.random()
    if kind < 0.85:
        return head + b"Content-Length: %d\r\n" % len(body), body
    if kind < 0.9:
        return head + b"Transfer-Encoding: chunked\r\n", b"%x\r\n" % len(body) + body + b"\r\n0\r\n\r\n"
    if kind < 0.93:
        wrong = [b"zz\r\n", b"ffffffffffffffff\r\nabc", b"-1\r\n", b"5;" + b"a" * 9000 + b"\r\nabcde\r\n0\r\n\r\n"]
        return head + b"Transfer-Encoding: chunked\r\n", rng.choice(wrong)
    if kind < 0.96:
        length = rng.choice([b"-1", b"99999999999999999999", b"1, 2", b"0x10", b"65537", b"1048577"])
        return head + b"Content-Length: %s\r\n" % length, body
    return head + b"Content-Length: %d\r\nContent-Length: 3\r\nTransfer-Encoding: chunked\r\n" % len(body), body


def _request(rng: random.Random, routes: list[tuple[str, str]], port: int) -> bytes:
    if rng.random() < 0.05:
        return rng.randbytes(rng.randrange(1, 400))
    method, path = _target(rng, routes)
    host = f"Host: 127.0.0.1:{port}\r\n".encode()
    body = rng.choice(_BODIES) if method in (b"PUT", b"POST") or rng.random() < 0.1 else b""
    if body and rng.random() < 0.15:
        mutated = bytearray(body[:4000])
        for _ in range(rng.randrange(1, 6)):
            mutated[rng.randrange(len(mutated))] = rng.randrange(256)
        body = bytes(mutated)
    version = rng.choice([b" HTTP/1.1", b" HTTP/1.1", b" HTTP/1.1", b" HTTP/1.0", b" HTTP/2.0", b" HTTP/9.9", b""])
    head = method + b" " + path + version + b"\r\n"
    head += host if rng.random() < 0.95 else b""
    head += host if rng.random() < 0.05 else b""
    if body or rng.random() < 0.1:
        fields, body = _body_headers(rng, body)
        head += fields
    for _ in range(rng.choice([0, 0, 0, 1, 3])):
        head += _header(rng) + b"\r\n"
    if rng.random() < 0.02:
        head += b"".join(b"X-%d: y\r\n" % i for i in range(rng.choice([90, 101, 3000])))
    return head + b"\r\n" + body


def _answered(got: bytes, raw: bytes, streams: bool) -> bool:
    end = got.find(b"\r\n\r\n")
    if end < 0:
        return False
    head = got[:end].lower()
    at = head.find(b"content-length: ")
    if streams or at < 0 or raw.startswith(b"HEAD"):
        return True
    return len(got) - end - 4 >= int(head[at + 16 :].split(b"\r")[0])


def _send(port: int, raw: bytes, shut: bool) -> str:
    """What came: a status code, `closed`, `odd`, or `silence` after the deadline of a request."""
    first = raw.split(b"\r\n")[0]
    streams = b"/v1/events" in first or b"wait=" in first
    got = b""
    try:
        with socket.create_connection(("127.0.0.1", port), timeout=15) as s:
            s.sendall(raw)
            if shut:
                s.shutdown(socket.SHUT_WR)
            while chunk := s.recv(65536):
                got += chunk
                if _answered(got, raw, streams):
                    break
    except TimeoutError:
        return "silence"
    except OSError:
        return "reset"
    if not got:
        return "closed"
    code = status_of(got)
    return str(code) if code else "odd"


def _bounds(port: int, observed: Observed) -> None:
    """Heads above 16 KiB and bodies above 64 KiB are refused."""
    host = f"Host: 127.0.0.1:{port}\r\n".encode()
    head = exchange(port, b"GET /v1/status HTTP/1.1\r\n" + host + b"X: " + b"a" * 20_000 + b"\r\n\r\n")
    observed.expect(status_of(head) in (431, 400), f"a head of 20 000 bytes is answered by {status_of(head)}")
    start = b"POST /v1/preflight HTTP/1.1\r\nContent-Type: application/json\r\nConnection: close\r\n" + host
    body = exchange(port, start + b"Content-Length: 3000000\r\n\r\n" + b" " * 3_000_000)
    observed.expect(status_of(body) == 413, f"a body of 3 MB is answered by {status_of(body)}")


def run(context: Context) -> Observed:
    """Sends `count` requests to a daemon whose pace of commands is set high, so that bodies are read."""
    observed, port, codes, rng = Observed(""), free_port(), Counter[str](), context.random
    with serve(context, port, commands_per_minute=60_000, command_burst=10_000) as daemon:
        contract: dict[str, Any] = daemon.http("GET", "/openapi.json").json()
        routes = [(m.upper(), p) for p, item in contract["paths"].items() for m in item if m in _METHODS]
        _bounds(port, observed)
        before, began = daemon.usage(), time.monotonic()
        for n in range(context.count):
            raw = _request(rng, routes, port)
            came = _send(port, raw, rng.random() < 0.7)
            codes[came] += 1
            observed.expect(came not in ("silence", "odd"), f"{came} to {raw[:120]!r}")
            observed.expect(not came.startswith("5") or came in ("503", "507", "501", "505"), f"{came} to {raw[:300]!r}")
            if context.control and n == context.count // 2:
                daemon.kill()
            if daemon.process.poll() is not None:
                observed.misses.append(f"the daemon ended with {daemon.process.returncode} at {raw[:200]!r}")
                break
            if n % 1000 == 999:
                context.say(f"{n + 1} requests, {dict(codes)}")
        seconds = time.monotonic() - began
        if daemon.process.poll() is None:
            after = daemon.usage()
            observed.figures.append(f"memory {before.rss_mb:.0f} MB before, {after.rss_mb:.0f} MB after")
            observed.expect(after.rss_mb < before.rss_mb + 100, f"memory grew from {before.rss_mb:.0f} to {after.rss_mb:.0f} MB")
            # Runs that the requests have started are waited for or aborted by the end.
            code, _ = daemon.end()
            observed.expect(code == 0, f"exit code {code} after the requests")
    observed.misses += panics(context.work / "daemon.log")
    observed.done = f"{context.count} random and mutated requests to {len(routes)} routes of the contract in {seconds:.0f} s"
    observed.figures.insert(0, ", ".join(f"{code}: {n}" for code, n in sorted(codes.items())))
    return observed


ROW = Row(
    "R15",
    "HTTP fuzz",
    "0 panics, 0 hangs, 0 answers 500; bodies and heads bounded",
    (200, 5000, 100_000),
    "requests",
    "the daemon is killed half-way",
    r"^the daemon ended with -9 at",
    run,
)
