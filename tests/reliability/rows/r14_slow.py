"""R14: thousands of slow clients of several kinds. When are they cut, and what does a poller notice?

Clients that stay on the event stream are not slow and are not cut. More of them than there are connections must leave the status and
the emergency stop answered: those beyond the daemon's limit for streams are sent away with 503 and Retry-After.
"""

from __future__ import annotations

import contextlib
import resource
import select
import socket
import threading
import time
from collections import Counter
from dataclasses import dataclass, field

from ..kit import http
from ..kit.daemon import Daemon, free_port, panics
from ..kit.http import status_of
from ..kit.row import CannotRun, Context, Observed, Row, percentile
from ..kit.served import serve

_WATCHED_S = 25.0
_LIMIT_S = 10.0
# Heads may come until the limit; the moment of the cut is seen up to one turn of the watching loop later.
_SLACK_S = 2.0
_RDHUP = 0x2000
_STREAMS = 4_196
"""A hundred more than `max_connections` is by default."""
_POLLS = 20


def _first_bytes(kind: str, port: int) -> bytes:
    host = f"Host: 127.0.0.1:{port}\r\n"
    return {
        "head": "G",
        "silent": "",
        "body": f"POST /v1/preflight HTTP/1.1\r\n{host}Content-Type: application/json\r\nContent-Length: 60000\r\n\r\n{{",
        "idle": f"GET /livez HTTP/1.1\r\n{host}\r\n",
        "unread": f"GET /openapi.json HTTP/1.1\r\n{host}\r\n" * 60,
    }[kind].encode()


@dataclass
class _Attack:
    kind: str
    cut_s: list[float] = field(default_factory=list)
    left: int = 0
    status_s: list[float] = field(default_factory=list)
    failed: int = 0


def _poll(port: int, attack: _Attack, ended: threading.Event) -> None:
    while not ended.wait(0.05):
        began = time.monotonic()
        try:
            ok = http.request(port, "GET", "/v1/status", timeout=15).status == 200
        except OSError:
            ok = False
        attack.status_s.append(time.monotonic() - began)
        attack.failed += not ok


def _open(kind: str, port: int, count: int) -> dict[socket.socket, float]:
    clients = {}
    for _ in range(count):
        s = socket.socket()
        if kind == "unread":
            s.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
        s.settimeout(5)
        try:
            s.connect(("127.0.0.1", port))
            s.setblocking(False)
            s.send(_first_bytes(kind, port))
        except OSError:
            s.close()
            continue
        clients[s] = time.monotonic()
    return clients


def _attack_unread(daemon: Daemon, count: int, watched_s: float) -> _Attack:
    """Clients that read nothing do not see that they are cut: the end of the stream waits behind what they did not read.

    So the daemon's descriptors are counted. If they never rise, the attack was none, which counts as a failed poll.
    """
    attack, ended = _Attack("unread"), threading.Event()
    before = daemon.usage().descriptors
    poller = threading.Thread(target=_poll, args=(daemon.port, attack, ended))
    poller.start()
    clients = _open("unread", daemon.port, count)
    began = max(clients.values(), default=time.monotonic())
    held = 0
    while held < count // 2 and time.monotonic() < began + 3:
        held = daemon.usage().descriptors - before
    if held < count // 2:
        attack.failed += 1
    while held > 20 and time.monotonic() < began + watched_s:
        time.sleep(0.1)
        held = daemon.usage().descriptors - before
    attack.cut_s.append(time.monotonic() - began)
    attack.left = held if held > 20 else 0
    ended.set()
    poller.join()
    for s in clients:
        s.close()
    return attack


def _attack(kind: str, port: int, count: int, watched_s: float) -> _Attack:
    attack, ended = _Attack(kind), threading.Event()
    poller = threading.Thread(target=_poll, args=(port, attack, ended))
    poller.start()
    clients = _open(kind, port, count)
    events = select.EPOLLHUP | select.EPOLLERR | _RDHUP | select.EPOLLIN
    watch, by_descriptor = select.epoll(), {}
    for s in clients:
        watch.register(s.fileno(), events)
        by_descriptor[s.fileno()] = s
    drip = b"ET /v1/status HTTP/1.1\r\nHost: 127.0.0.1\r\nX-A: " + b"a" * 200
    dripped, next_drip, end = 0, time.monotonic() + 1, time.monotonic() + watched_s
    while clients and time.monotonic() < end:
        for descriptor, event in watch.poll(0.2):
            s = by_descriptor[descriptor]
            gone = bool(event & (select.EPOLLHUP | select.EPOLLERR | _RDHUP))
            if not gone:
                try:
                    gone = not s.recv(65536)
                except OSError:
                    gone = True
            if gone:
                attack.cut_s.append(time.monotonic() - clients.pop(s))
                watch.unregister(descriptor)
                s.close()
        if kind in ("head", "body") and time.monotonic() > next_drip:
            next_drip += 1
            for s in clients:
                with contextlib.suppress(OSError):
                    s.send(drip[dripped : dripped + 1] if kind == "head" else b" ")
            dripped += 1
    attack.left = len(clients)
    ended.set()
    poller.join()
    for s in clients:
        s.close()
    return attack


def _first_lines(clients: list[socket.socket], patience_s: float) -> Counter[str]:
    """What the clients were answered: `200`, `503`, `503 without Retry-After`, another code, `nothing`."""
    got, watch, end = {s.fileno(): b"" for s in clients}, select.epoll(), time.monotonic() + patience_s
    for s in clients:
        watch.register(s.fileno(), select.EPOLLIN)
    waiting = {s.fileno(): s for s in clients}
    while waiting and time.monotonic() < end:
        for descriptor, _ in watch.poll(0.2):
            try:
                chunk = waiting[descriptor].recv(65536)
            except OSError:
                chunk = b""
            got[descriptor] += chunk
            if not chunk or b"\r\n\r\n" in got[descriptor]:
                watch.unregister(descriptor)
                del waiting[descriptor]
    found = Counter[str]()
    for answer in got.values():
        code = status_of(answer)
        retry = b"\r\nretry-after:" in answer.lower()
        found["nothing" if code is None else "503 without Retry-After" if code == 503 and not retry else str(code)] += 1
    return found


def _attack_streams(daemon: Daemon, observed: Observed) -> list[float]:
    """Takes all connections for event streams. Returns the seconds that the status took meanwhile."""
    request = f"GET /v1/events HTTP/1.1\r\nHost: 127.0.0.1:{daemon.port}\r\n\r\n".encode()
    clients, status_s, failed = [], [], 0
    with contextlib.ExitStack() as opened:
        for _ in range(_STREAMS):
            s = opened.enter_context(socket.socket())
            s.settimeout(5)
            try:
                s.connect(("127.0.0.1", daemon.port))
                s.sendall(request)
                clients.append(s)
            except OSError:
                failed += 1
        observed.expect(not failed, f"sse: {failed} of {_STREAMS} clients could not connect")
        answers = _first_lines(clients, _LIMIT_S)
        said = ", ".join(f"{what}: {n}" for what, n in sorted(answers.items()))
        observed.figures.append(f"sse: {_STREAMS} clients, answered by {said}")
        observed.expect(set(answers) <= {"200", "503"}, f"sse: {_STREAMS} clients were answered by {said}")
        lost = 0
        for _ in range(_POLLS):
            began = time.monotonic()
            try:
                lost += daemon.http("GET", "/v1/status", timeout=5).status != 200
            except OSError:
                lost += 1
            status_s.append(time.monotonic() - began)
            if lost == 3:
                break
        observed.expect(not lost, f"sse: {lost} of {len(status_s)} polls failed while {len(clients)} clients were on the event stream")
        try:
            stopped: int | str = daemon.http("POST", "/v1/emergency-stop", timeout=5).status
        except OSError as error:
            stopped = f"{type(error).__name__}"
        observed.expect(stopped == 200, f"sse: the emergency stop was answered by {stopped} meanwhile")
    return status_s


def run(context: Context) -> Observed:
    """Attacks with `count` clients of each kind."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard < _STREAMS + 200:
        raise CannotRun(f"{_STREAMS} clients need more open files than {hard}: ulimit -Hn")
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(20_000, hard), hard))
    observed, port, log = Observed("", machine_load=True), free_port(), context.work / "daemon.log"
    kinds = ("head", "silent", "body", "idle", "unread")
    streams_s: list[float] = []
    if context.control:
        with serve(context, port, head_timeout_ms=600_000, body_timeout_ms=600_000) as daemon:
            attacks = [_attack("head", port, context.count, _LIMIT_S + _SLACK_S + 1)]
    else:
        with Daemon(context.binary, context.work / "data", port, log=log) as daemon:
            before = daemon.usage()
            attacks = []
            for kind in kinds:
                unread = kind == "unread"
                attacks.append(
                    _attack_unread(daemon, context.count, _WATCHED_S) if unread else _attack(kind, port, context.count, _WATCHED_S)
                )
                context.say(f"{kind}: {len(attacks[-1].cut_s)} cut, {attacks[-1].left} left")
            time.sleep(1.5)
            after = daemon.usage()
            observed.expect(after.descriptors <= before.descriptors + 20, f"{after.descriptors} descriptors, {before.descriptors} before")
            observed.figures.append(f"memory {before.rss_mb:.0f} MB before, {after.rss_mb:.0f} MB after")
            streams_s = _attack_streams(daemon, observed)
            daemon.end()
        observed.misses += panics(log)
    for attack in attacks:
        # A keep-alive connection without a second request is not an attack in itself; it is cut too.
        observed.expect(not attack.left, f"{attack.kind}: {attack.left} clients were never cut")
        observed.at_most(f"{attack.kind}: last cut after", max(attack.cut_s, default=None), _LIMIT_S + _SLACK_S, "s")
        observed.expect(not attack.failed, f"{attack.kind}: {attack.failed} of {len(attack.status_s)} polls failed")
    polls = [1000 * s for s in [*streams_s, *(s for attack in attacks for s in attack.status_s)]]
    observed.done = (
        f"{context.count} slow clients of each kind ({', '.join(kinds)}), beside a poller; then {_STREAMS} clients that stay on "
        "`/v1/events` (sse), more than there are connections"
    )
    observed.at_most("status p99 meanwhile", percentile(polls, 0.99), 1000, "ms")
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    return observed


ROW = Row(
    "R14",
    "2000 slow-loris connections",
    "cut within 10 s (seen up to 2 s later), status unaffected: no poll fails, p99 under 1 s; with all connections wanted for event "
    "streams, those beyond the limit get 503 with Retry-After, status and emergency stop are answered",
    (50, 2000, 2000),
    "clients of each kind",
    "the daemon's deadlines for heads and bodies are set to 10 minutes",
    r"^head: \d+ clients were never cut$",
    run,
)
