"""B1: hundreds of kinds of bad files, to every command that reads files.

Each case: no panic, no signal, no hang, a bounded memory, an exit code that says it failed, and nothing changed that is not its own.
"""

from __future__ import annotations

import json
import os
import re
import resource
import shutil
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..kit.disk import tree
from ..kit.pictures import write_bad_pictures
from ..kit.recorded import recorded_run
from ..kit.row import Context, Observed, Row

_LIMIT_S = 60.0
_LIMIT_MB = 3000
"""Twice what measuring a good recording takes with room for one 30 000 x 30 000 picture."""

Prepare = Callable[[Path], object]


@dataclass(frozen=True)
class Case:
    """One command on one bad input. Arguments are relative to the work folder."""

    name: str
    arguments: Sequence[str]
    prepare: Prepare = lambda work: None
    must_fail: bool = True
    kept: str | None = None
    """A folder in which nothing may change."""


def _edit(path: str, change: Callable[[Any], Any]) -> Prepare:
    def prepare(work: Path) -> None:
        value = json.loads((work / path).read_text())
        change(value)
        (work / path).write_text(json.dumps(value))

    return prepare


def _write(path: str, content: bytes | str) -> Prepare:
    def prepare(work: Path) -> None:
        target = work / path
        target.parent.mkdir(parents=True, exist_ok=True)
        if target.is_symlink() or target.is_file():
            target.unlink()
        target.write_bytes(content if isinstance(content, bytes) else content.encode())

    return prepare


def _copy(source: str, target: str) -> Prepare:
    def prepare(work: Path) -> None:
        (work / target).unlink(missing_ok=True)
        if (work / source).is_symlink():
            (work / target).symlink_to(Path(target).name)
        elif (work / source).is_fifo():
            os.mkfifo(work / target)
        elif (work / source).is_dir():
            (work / target).mkdir()
        else:
            shutil.copy(work / source, work / target)

    return prepare


def _both(*steps: Prepare) -> Prepare:
    def prepare(work: Path) -> None:
        for step in steps:
            step(work)

    return prepare


def _unseal(work: Path) -> None:
    (work / "rec/RUN/A01/SHA256SUMS").unlink()


def _number(key: str, value: str) -> Prepare:
    def prepare(work: Path) -> None:
        path = work / "rec/RUN/A01/recording.json"
        path.write_text(re.sub(rf'"{key}": *[-0-9.e]+', f'"{key}": {value}', path.read_text(), count=1))

    return prepare


def _recordings(names: list[str]) -> list[Case]:
    record = "rec/RUN/A01/recording.json"

    def ledger(n: int, new: dict[str, Any]) -> Callable[[Any], Any]:
        return lambda r: r["ledger"][n].update(new)

    def method(new: dict[str, Any]) -> Callable[[Any], Any]:
        return lambda r: r["method"].update(new)

    damages: dict[str, Prepare] = {
        **{f"frame is {name}": _copy(f"bad/{name}", "rec/RUN/A01/frames/view_004.png") for name in names},
        "frame is missing": lambda w: (w / "rec/RUN/A01/frames/view_004.png").unlink(),
        "frames is a file": _both(lambda w: shutil.rmtree(w / "rec/RUN/A01/frames"), _write("rec/RUN/A01/frames", "x")),
        "record is empty": _write(record, b""),
        "record is binary": _write(record, b"\xff\xfe\0"),
        "record is cut": lambda w: os.truncate(w / record, 500),
        "record is missing": lambda w: (w / record).unlink(),
        "record is deep": _write(record, b"[" * 100_000),
        "record is of a newer schema": _edit(record, lambda r: r.update(schema="carved.recording/99")),
        "record is of another schema": _edit(record, lambda r: r.update(schema="x")),
        "omega is NaN": _number("omega", "NaN"),
        "omega is 1e999": _number("omega", "1e999"),
        "omega is null": _edit(record, ledger(3, {"omega": None})),
        "all omega are 0": _edit(record, lambda r: [entry.update(omega=0.0) for entry in r["ledger"]]),
        "asd is 0": _edit(record, method({"asd": 0})),
        "asd is 4e9": _edit(record, method({"asd": 4_000_000_000})),
        "voxel is 1e-6": _edit(record, method({"voxel_um": 1e-6})),
        "voxel is 0": _edit(record, method({"voxel_um": 0})),
        "voxel is -1": _edit(record, method({"voxel_um": -1})),
        "voxel is text": _edit(record, method({"voxel_um": "7"})),
        "box is 2e9 um wide": _edit(record, method({"box_um": {"min": [-1e9] * 3, "max": [1e9] * 3}})),
        "epsilon is 2": _edit(record, method({"epsilon": 2})),
        "kx is 0": _edit(record, lambda r: r["rig"]["camera"].update(kx=0)),
        "f is 0": _edit(record, lambda r: r["rig"]["camera"].update(f=0)),
        "width is 4e9": _edit(record, lambda r: r["rig"]["camera"].update(width=4_000_000_000)),
        "width is 60000": _edit(record, lambda r: r["rig"]["camera"].update(width=60_000, height=60_000)),
        "steps are 0/0": _edit(record, lambda r: r["rig"].update(steps_per_revolution=[0, 0])),
        "ledger is empty": _edit(record, lambda r: r.update(ledger=[])),
        "a view is there twice": _edit(record, lambda r: r["ledger"].append(dict(r["ledger"][2]))),
        "view number is -1": _edit(record, ledger(2, {"view": -1})),
        "view number is 4e9": _edit(record, ledger(2, {"view": 4_000_000_000})),
        "hash of another view": _edit(record, lambda r: r["ledger"][2].update(sha256=r["ledger"][3]["sha256"])),
        "hash is text": _edit(record, ledger(2, {"sha256": "../../x"})),
        "well leads out": _edit(record, lambda r: r["specimen"].update(well="../../x")),
    }
    cases = []
    for name, damage in damages.items():
        for sealed, how in (("", damage), (", no sums", _both(damage, _unseal))):
            cases.append(Case(f"measure: {name}{sealed}", ["measure", "rec/RUN/A01"], how, kept="rec"))
            cases.append(Case(f"replay: {name}{sealed}", ["replay", "rec/RUN", "A01"], how, kept="rec"))
    run = "rec/RUN/run.json"
    for name, damage in {
        "run is empty": _write(run, b""),
        "run is cut": lambda w: os.truncate(w / run, 300),
        "run is deep": _write(run, b'{"a":' * 100_000),
        "run is of a newer schema": _edit(run, lambda r: r.update(schema="carved.run/99")),
    }.items():
        cases.append(Case(f"replay: {name}", ["replay", "rec/RUN", "A01"], damage, kept="rec"))
        cases.append(Case(f"export table: {name}", ["export", "table", "rec/RUN", "--out", "out.csv"], damage, kept="rec"))
        cases.append(Case(f"report: {name}", ["report", "rec/RUN", "--out", "out.html"], damage, kept="rec"))
        cases.append(Case(f"archive: {name}", ["archive", "rec/RUN", "--to", "copies"], damage, kept="rec"))
    for name, damage in {
        "measurement is cut": lambda w: os.truncate(w / "rec/RUN/A01/measurement.json", 200),
        "measurement is NaN": _write("rec/RUN/A01/measurement.json", "NaN"),
        "mesh is cut": lambda w: os.truncate(w / "rec/RUN/A01/mesh.ply", 300),
        "mesh is text": _write("rec/RUN/A01/mesh.ply", "ply\nformat ascii 1.0\nelement vertex 99999999999\nend_header\n"),
    }.items():
        cases.append(Case(f"archive: {name}", ["archive", "rec/RUN", "--to", "copies"], damage, kept="rec"))
        for kind in ("stl", "nrrd", "ome-tiff"):
            must = kind == "stl" if name.startswith("mesh") else False
            out = ["--out", "exported"]
            cases.append(Case(f"export {kind}: {name}", ["export", kind, "rec/RUN/A01", *out], damage, must, "rec"))
    cases += [
        Case("measure nothing", ["measure", "no-such"]),
        Case("measure a file", ["measure", "rec/RUN/run.json"], kept="rec"),
        Case("measure an empty folder", ["measure", "empty"], lambda w: (w / "empty").mkdir()),
        Case("measure a link to itself", ["measure", "self"], lambda w: (w / "self").symlink_to("self")),
        Case("measure --asd 0", ["measure", "--asd", "0", "rec/RUN/A01"], kept="rec"),
        Case("replay a well that leads out", ["replay", "rec/RUN", "../A01"], kept="rec"),
        Case("replay a method that leads out", ["replay", "rec/RUN", "--method", "../../x"], kept="rec"),
        Case(
            "replay a method of NaN",
            ["replay", "rec/RUN", "A01", "--method", "m.toml"],
            _write("m.toml", "asd = 21\nepsilon = nan\n"),
            kept="rec",
        ),
        Case("archive into the run itself", ["archive", "rec/RUN", "--to", "rec/RUN"], kept="rec"),
        Case("archive over other files", ["archive", "rec/RUN", "--to", "copies"], _write("copies/RUN/run.json", "mine"), kept="copies"),
        Case("index rebuild of nothing", ["index", "rebuild", "no-such"]),
        Case("prune of nothing", ["prune", "no-such", "--yes"]),
    ]
    return cases


def _packs() -> list[Case]:
    """`A01.tar` in the place of the folder `A01`."""
    import io
    import tarfile

    def member(name: str, content: bytes = b"x", kind: bytes = tarfile.REGTYPE, size: int | None = None) -> bytes:
        out = io.BytesIO()
        info = tarfile.TarInfo(name)
        info.type, info.size, info.linkname = kind, len(content) if size is None else size, "/etc/passwd"
        out.write(info.tobuf())
        if kind == tarfile.REGTYPE:
            out.write(content + b"\0" * (-len(content) % 512))
        return out.getvalue()

    packs = {
        "is empty": b"",
        "is text": b"hello " * 200,
        "has no end": member("recording.json", b"{}" * 300)[:700],
        "is longer by its head": member("recording.json", b"{}", size=2**33) + b"\0" * 1024,
        "leads out": member("../../evil", b"x") + b"\0" * 1024,
        "is absolute": member("/tmp/carved-evil", b"x") + b"\0" * 1024,
        "has a link": member("recording.json", kind=tarfile.SYMTYPE) + b"\0" * 1024,
        "has a device": member("recording.json", kind=tarfile.CHRTYPE) + b"\0" * 1024,
        "has a wrong sum": b"A" * 100 + member("recording.json", b"{}")[100:] + b"\0" * 1024,
        "has a record twice": member("recording.json", b"{}") * 2 + b"\0" * 1024,
        "is noise": bytes((i * 7919) % 251 for i in range(5120)),
    }

    def pack(content: bytes) -> Prepare:
        return _both(lambda w: shutil.rmtree(w / "rec/RUN/A01"), _write("rec/RUN/A01.tar", content))

    cases = []
    for name, content in packs.items():
        cases.append(Case(f"measure: pack {name}", ["measure", "rec/RUN/A01.tar"], pack(content), kept="rec"))
        cases.append(Case(f"replay: pack {name}", ["replay", "rec/RUN", "A01"], pack(content), kept="rec"))
    return cases


def _segment(names: list[str]) -> list[Case]:
    good = "frames/v3.png"
    cases = [Case(f"segment {name}", ["segment", "--out", "seg", f"bad/{name}"], kept="bad") for name in names]
    cases += [
        Case(f"segment --reference {name}", ["segment", "--out", "seg", "--reference", f"bad/{name}", good], kept="bad")
        for name in names
        if name != "constant.png"
    ]
    settings = {
        "nan": "opacity = nan\n",
        "no TOML": "[[[",
        "negative": "[edge]\nblur_px = -1\n",
        "infinite": "[edge]\nblur_px = inf\n",
        "huge": "[edge]\nblur_px = 1e9\n",
        "binary": "\0\1",
        "an unknown key": "colour = 1\n",
    }
    for name, text in settings.items():
        cases.append(Case(f"segment --settings {name}", ["segment", "--out", "seg", "--settings", "s.toml", good], _write("s.toml", text)))
    shapes = {"empty": b"", "deep": b"[" * 100_000, "NaN": b'{"fish": NaN}', "text": b"hello", "other": b'{"a": 1}'}
    for name, content in shapes.items():
        compare = ["segment", "--out", "seg", "--compare", "shapes", good]
        cases.append(Case(f"segment --compare {name}", compare, _write("shapes/v3__SHAPES.json", content), must_fail=False))
    return [
        *cases,
        Case("segment nothing", ["segment", "--out", "seg", "no-such.png"]),
        Case("segment into a file", ["segment", "--out", "mine/file", good], _write("mine/file", "mine"), kept="mine"),
    ]


def _import(names: list[str]) -> list[Case]:
    base = ["import", "frames", "--bayer", "--out", "imported"]
    even = [*base, "--even"]
    cases = [
        Case(f"import: one frame is {name}", even, _copy(f"bad/{name}", "frames/v7.png"), kept="bad")
        for name in names
        if name != "constant.png"
    ]
    angles = {
        "NaN": "NaN\n" * 21,
        "infinite": "inf\n" * 21,
        "few": "0\n1\n",
        "words": "a\n" * 21,
        "huge": "\n".join(str(i * 1e300) for i in range(21)),
        "empty": "",
        "the same": "10\n" * 21,
        "of files outside": "file,angle_deg\n" + "".join(f"../frames/v{i}.png,{i * 360 / 21}\n" for i in range(21)),
        "without end": "1" * 200_000,
        "binary": "\0\1\2" * 50,
        "an open quote": 'file,angle_deg\n"v0.png,0\n',
    }
    for name, text in angles.items():
        cases.append(Case(f"import --angles {name}", [*base, "--angles", "angles.txt"], _write("angles.txt", text)))
    camera = '{"f":%s,"kx":%s,"ky":0.18,"ux":511,"uy":511,"width":%s,"height":1024%s}'
    cameras = {
        "NaN": '{"f":NaN}',
        "zero": camera % (0, 0, 0, ""),
        "huge": camera % ("1e308", "1e308", 1024, ""),
        "an angle of 1e999": camera % (60000, 0.18, 1024, ',"omega":[1e999]'),
        "wide": camera % (60000, 0.18, 10**12, ""),
        "deep": "[" * 200_000,
        "empty": "",
    }
    for name, text in cameras.items():
        cases.append(Case(f"import --cameras {name}", [*even, "--cameras", "camera.json"], _write("camera.json", text)))
        silhouettes = ["reconstruct", "--views", "profiles", "--cameras", "camera.json", "--out", "out.ply"]
        cases.append(Case(f"reconstruct --cameras {name}", silhouettes, _write("camera.json", text)))
        calibrate = ["calibrate", "specimen", "--views", "profiles", "--cameras", "camera.json"]
        cases.append(Case(f"calibrate --cameras {name}", calibrate, _write("camera.json", text)))
    for option, value in (("--well", "../x"), ("--dpf", "nan"), ("--voxel", "nan"), ("--voxel", "1e-9"), ("--epsilon", "-1")):
        cases.append(Case(f"import {option} {value}", [*even, f"{option}={value}"]))

    def only(count: int) -> Prepare:
        def prepare(work: Path) -> None:
            for view in range(count, 21):
                (work / f"frames/v{view}.png").unlink()

        return prepare

    cases += [
        Case("import of 2 frames", even, only(2)),
        Case("import of an empty folder", ["import", "empty", "--even", "--out", "imported"], lambda w: (w / "empty").mkdir()),
        Case("import over other files", ["import", "frames", "--even", "--out", "mine"], _write("mine/file", "mine"), kept="mine"),
        Case("import over a file", ["import", "frames", "--even", "--out", "mine/file"], _write("mine/file", "mine"), kept="mine"),
    ]
    return cases


def _reconstruct(names: list[str]) -> list[Case]:
    good = ["reconstruct", "--views", "profiles", "--cameras", "good.json", "--out", "out.ply"]
    cases = []
    for name in names:
        if name.endswith(".png") and name != "constant.png":
            cases.append(Case(f"reconstruct: one view is {name}", good, _copy(f"bad/{name}", "profiles/view_000.png"), kept="bad"))
    matrices = {
        "NaN": "\n".join(["nan " * 12] * 21),
        "zero": "\n".join(["0 " * 12] * 21),
        "infinite": "\n".join(["1e308 " * 12] * 21),
        "few numbers": "1 2 3\n" * 21,
        "a count of 1e11": "99999999999\n",
        "a negative count": "-1\n",
        "names outside": "1\n../../../../etc/passwd " + "1 0 0 0 1 0 0 0 1 " * 2 + "0 0 0\n",
        "words": "hello\n" * 21,
    }
    for name, text in matrices.items():
        arguments = ["reconstruct", "--views", "profiles", "--cameras", "matrices.txt", "--out", "out.ply"]
        cases.append(Case(f"reconstruct: matrices of {name}", arguments, _write("matrices.txt", text)))
    options = ["--box=nan,nan,nan,nan,nan,nan", "--box=0,0,0,0,0,0", "--box=-1e9,1e9,-1e9,1e9,-1e9,1e9", "--box=1,0,1,0,1,0", "--box=1,2,3"]
    options += ["--voxel=1e-9", "--voxel=nan", "--epsilon=nan", "--fairing-iterations=4000000000", "--fairing-lambda=nan"]
    cases += [Case(f"reconstruct {option}", [*good, option]) for option in options]
    return [
        *cases,
        Case("reconstruct over a file", [*good[:-1], "mine/file"], _write("mine/file", "mine"), kept="mine"),
        Case("reconstruct into no folder", [*good[:-1], "no/such/out.ply"]),
    ]


def _texts() -> list[Case]:
    cases = []
    maps: dict[str, bytes] = {
        "empty.csv": b"",
        "nul.csv": b"\0" * 100,
        "latin.csv": "well,compound\nA01,\u00b5".encode("latin1"),
        "utf16.csv": "well\nA01".encode("utf-16"),
        "wide.csv": b"well," + b"x" * 200_000,
        "many.csv": b"well\n" + b"A01\n" * 400_000,
        "quote.csv": b'well,compound\nA01,"open',
        "outside.csv": b"well\n../../etc\n",
        "numbers.csv": b"well,dpf\nA01,nan\nA02,inf\nA03,1e400\n",
        "columns.csv": b"well," + b",".join(b"c%d" % i for i in range(5000)) + b"\n",
        "deep.json": b"[" * 200_000,
        "nan.json": b'[{"well":"A01","dpf":NaN}]',
        "huge.json": b'[{"well":"A01","dpf":1e999}]',
        "big.json": b"[" + b'{"well":"A01"},' * 300_000 + b'{"well":"A02"}]',
        "zip.xlsx": b"PK\x03\x04" + b"\0" * 200,
        "mihcsme.csv": b"##Investigation Information,,\n##Assay Conditions\nPlate,Well\n,\n",
    }
    for name, content in maps.items():
        cases.append(Case(f"plate check {name}", ["plate", "check", name], _write(name, content)))
    for name in ("bad", "bad/link.png", "bad/pipe.png"):
        cases.append(Case(f"plate check {name}", ["plate", "check", name], kept="bad"))
        cases.append(Case(f"config check {name}", ["config", "check", name], kept="bad"))
    configs: dict[str, bytes] = {
        "nan": b"[optics]\nkx_px_per_um = nan\n",
        "no TOML": b"[[[",
        "binary": b"\0\1\xff",
        "empty": b"",
        "deep": b"a = " + b"[" * 100_000,
        "keys": b"".join(b"k%d = 1\n" % i for i in range(20_000)),
        "an unknown table": b"[nothing]\na = 1\n",
        "a date": b"[http]\nlisten = 2020-01-01\n",
        "long": b'[http]\nlisten = "' + b"a" * 2_000_000 + b'"\n',
    }
    for name, content in configs.items():
        cases.append(Case(f"config check {name}", ["config", "check", "c.toml"], _write("c.toml", content)))
        cases.append(Case(f"serve {name}", ["serve", "--config", "c.toml"], _write("c.toml", content)))
        cases.append(Case(f"reference show {name}", ["reference", "show", "c.toml"], _write("c.toml", content)))
        cases.append(Case(f"calibrate scale {name}", ["calibrate", "scale", "--config", "c.toml", "bad"], _write("c.toml", content)))
        cases.append(Case(f"camera exposure {name}", ["camera", "exposure", "--config", "c.toml"], _write("c.toml", content)))
    build = ["reference", "build", "--out", "mine/r.toml", "bad"]
    return [*cases, Case("reference build over a file", build, _write("mine/r.toml", "mine"), kept="mine")]


def cases(names: list[str]) -> list[Case]:
    """All cases; `names` are those of the bad pictures."""
    return [*_recordings(names), *_packs(), *_segment(names), *_import(names), *_reconstruct(names), *_texts()]


@dataclass(frozen=True)
class _Ended:
    code: int | None
    seconds: float
    peak_mb: float
    said: str


def _execute(binary: Path, arguments: Sequence[str], work: Path) -> _Ended:
    began = time.monotonic()
    with open(work / "said", "w+b") as out:
        process = subprocess.Popen(
            [binary, *arguments], stdin=subprocess.DEVNULL, stdout=out, stderr=out, cwd=work,
            env={**os.environ, "RUST_BACKTRACE": "0"},
        )  # fmt: skip
        late = threading.Timer(_LIMIT_S, process.kill)
        late.start()
        _, status, usage = os.wait4(process.pid, 0)
        late.cancel()
        process.returncode = os.waitstatus_to_exitcode(status)
        out.seek(0)
        said = out.read(2_000_000).decode(errors="replace")
    seconds = time.monotonic() - began
    code = None if seconds >= _LIMIT_S and process.returncode == -signal.SIGKILL else process.returncode
    return _Ended(code, seconds, usage.ru_maxrss / 1024, said)


def _judge(case: Case, ended: _Ended) -> str | None:
    last = (ended.said.strip().splitlines() or [""])[-1][:160]
    if ended.code is None:
        return f"no end within {_LIMIT_S:.0f} s"
    if "panicked at" in ended.said:
        return "panic: " + next(line for line in ended.said.splitlines() if "panicked at" in line)[:200]
    if ended.code < 0:
        return f"ended by {signal.Signals(-ended.code).name}: {last}"
    if ended.peak_mb > _LIMIT_MB:
        return f"{ended.peak_mb:.0f} MB of memory"
    if case.must_fail and ended.code == 0:
        return f"exit code 0: {last}"
    if ended.code and not ended.said.strip():
        return f"exit code {ended.code} without a word"
    return None


def run(context: Context) -> Observed:
    """Runs `count` of the cases, evenly chosen."""
    observed = Observed("")
    source, bad = recorded_run(context), context.work / "bad-pictures"
    frame = (source / "A01/frames/view_003.png").read_bytes()
    names = write_bad_pictures(bad, frame)
    every = cases(names)
    chosen = [every[n * len(every) // min(context.count, len(every))] for n in range(min(context.count, len(every)))]
    peak = slowest = 0.0
    resource.setrlimit(resource.RLIMIT_CORE, (0, resource.getrlimit(resource.RLIMIT_CORE)[1]))
    for n, case in enumerate(chosen):
        work = context.work / "case"
        shutil.rmtree(work, ignore_errors=True)
        shutil.copytree(source, work / "rec/RUN")
        shutil.copytree(source / "A01/profiles", work / "profiles")
        (work / "frames").mkdir()
        for view in range(21):
            shutil.copy(source / f"A01/frames/view_{view:03d}.png", work / f"frames/v{view}.png")
        camera = json.loads((source / "A01/recording.json").read_text())["rig"]["camera"]
        camera["omega"] = [i * 6.283185307 / 21 for i in range(21)]
        (work / "good.json").write_text(json.dumps(camera))
        shutil.copytree(bad, work / "bad", symlinks=True, ignore=shutil.ignore_patterns("pipe.png"))
        os.mkfifo(work / "bad/pipe.png")
        case.prepare(work)
        before = tree(work / case.kept) if case.kept else None
        arguments = ["measure", "rec/RUN/A01"] if context.control else case.arguments
        if context.control:
            shutil.rmtree(work / "rec")
            shutil.copytree(source, work / "rec/RUN")
        ended = _execute(context.binary, arguments, work)
        peak, slowest = max(peak, ended.peak_mb), max(slowest, ended.seconds)
        wrong = _judge(case, ended)
        if wrong:
            observed.misses.append(f"{case.name}: {wrong}")
            context.say(observed.misses[-1])
        if case.kept and before != tree(work / case.kept):
            observed.misses.append(f"{case.name}: it changed files in {case.kept}")
            context.say(observed.misses[-1])
        if n % 50 == 49:
            context.say(f"{n + 1} of {len(chosen)} cases")
    commands = sorted({case.arguments[0] for case in chosen})
    observed.done = f"{len(chosen)} of {len(every)} kinds of bad files, to {', '.join(commands)}"
    observed.figures += [
        f"{len(chosen) - len(observed.misses)} refused or read as they must be",
        f"peak memory {peak:.0f} MB, slowest {slowest:.1f} s",
    ]
    return observed


ROW = Row(
    "B1",
    "bad files to every command that reads files",
    f"0 panics, 0 signals, 0 hangs ({_LIMIT_S:.0f} s), at most {_LIMIT_MB} MB, an exit code that says it failed, nothing else changed",
    (12, 515, 515),
    "kinds",
    "the input is good where the case expects a failure",
    r"exit code 0: ",
    run,
)
