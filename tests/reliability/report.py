"""The table of `docs/reliability.md`, made from the newest result of each row."""

from __future__ import annotations

import fcntl
import json
import re
import shutil
import textwrap
from collections.abc import Sequence
from datetime import date
from pathlib import Path
from typing import Any

from .kit.row import Observed, Row

_HEAD = """# Reliability

`make qa` writes this page ([how](#how-it-is-measured)). Each row attacks the release program from outside, or runs the
named Rust tests. A row that missed its goal says so. Nothing here was measured on a real instrument: motor and camera
are emulated, and the protocols are those of the real parts.

The column "size" has the size of the newest run and that of the full form. **A small size is no substitute for the full
form**, so the verdict names the share where it is smaller. The last column names the program that was measured, by its
commit, and for rows that Rust tests hold the commit of the tests. "load" is the number of processes that wanted a
processor when the row began. Times of a machine with more load than cores are not those of an instrument's computer,
which does nothing else.

"""

_HOW = """
## How it is measured

```sh
make qa                          # all rows, default sizes
make qa ROW=R13                  # one row
make qa ROW="R1 R9" SCALE=full   # the full form
make qa CONTROL=1                # breaks what each row names: every row must report the miss that the break causes
```

The rows are Python modules in [tests/reliability](../tests/reliability), standard library only. They need a C compiler
for the fault shim, and R2, R4 to R8 need cargo. `make test` runs the rows that take seconds in their short form.
`python3 -m tests.reliability --list` prints the sizes. Seeds are fixed; `--seed` changes them. The results behind this
page are in [reliability/results.json](reliability/results.json). A row that is not run keeps its newest result.

- **What was heard is compared with the disk.** A reader of the event stream stays connected over all deaths of the
  daemon. An event that it heard was acknowledged, so it must be in the journals. Its view must be in the ledger with
  the pixels that the ledger names.
- **Faults of disk and clock** come from [a preloaded shim](../tests/reliability/kit/shim.c): writes, syncs and renames
  fail from a chosen one on, the wall clock jumps, and the reading of the monotonic clock fails in one thread, which
  Rust answers with a panic. The shim also records when a stop byte was written to the motor's wire.
- **kill -9 is no power cut**: unsynced writes survive it. R2 is tested by a file layer in the tests of `carved-store`,
  which drops or tears what was not synced, and by B2, which damages finished folders.

"""

_CONTROLS = """
## Controls

A control run breaks something on purpose, and the row must report the miss that belongs to it. Another miss does not
count, and a daemon that does not start is no result. A row whose control was **not run** has not been seen failing.
`make qa CONTROL=1` repeats all of them.

"""


_GROWN = "what was added to the goal after this run"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")


def _short(program: str) -> str:
    """A commit in twelve digits."""
    return re.sub(r"\b([0-9a-f]{12})[0-9a-f]{28}\b", r"\1", program)


def _share(count: int, full: int) -> str:
    """The share of the full form, for a size below it."""
    return f" at {count} of {full:_}".replace("_", " ") if count < full else ""


def _replace(path: Path, text: str) -> None:
    """Writes a file whole or not at all, so that a full disk costs no earlier result."""
    beside = path.with_suffix(".new")
    beside.write_text(text)
    beside.replace(path)


class Results:
    """The newest result and control of each row, in a folder, and the page made of them."""

    def __init__(self, folder: Path, page: Path, rows: Sequence[Row]) -> None:
        self._folder, self._page, self._order = folder, page, rows
        self._rows: dict[str, dict[str, Any]] = {}

    def take(self, row: Row, observed: Observed, program: str, count: int, seconds: float, day: date, machine: str, plot: Path) -> None:
        """Takes the result of a row and writes the page."""
        self._folder.mkdir(parents=True, exist_ok=True)
        if plot.exists():
            shutil.copy(plot, self._folder / plot.name)
        result = {
            "count": count,
            "goal": row.goal,
            "done": observed.done,
            "figures": [figure for figure in observed.figures if figure],
            "misses": len(observed.misses),
            "first_misses": observed.misses[:5],
            "not_judged": observed.not_judged,
            "seconds": round(seconds),
            "program": program,
            "date": day.isoformat(),
            "machine": machine,
            "timed": observed.machine_load,
        }
        self._write(row, "result", result)

    def take_control(self, row: Row, observed: Observed, program: str, day: date) -> None:
        """Takes what a control run reported of its break and writes the page."""
        misses = row.control_misses(observed)
        first = misses[0] if misses else None
        self._write(row, "control", {"date": day.isoformat(), "program": program, "misses": len(misses), "first_miss": first})

    def _write(self, row: Row, part: str, value: dict[str, Any]) -> None:
        """Adds to what is there now: another process may write the result of another row."""
        self._folder.mkdir(parents=True, exist_ok=True)
        path = self._folder / "results.json"
        with open(self._folder / ".lock", "w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            self._rows = json.loads(path.read_text()) if path.exists() else {}
            self._rows.setdefault(row.id, {})[part] = value
            ordered = {known.id: self._rows[known.id] for known in self._order if known.id in self._rows}
            _replace(path, json.dumps(ordered, indent=1, ensure_ascii=False) + "\n")
            rows = self._order
            _replace(
                self._page,
                _HEAD + self._table(rows) + self._misses(rows) + self._plot() + _HOW + self._fuzzing() + _CONTROLS + self._controls(rows),
            )

    def _table(self, rows: Sequence[Row]) -> str:
        lines = [
            "| row | fault | what was done | figures | goal | verdict | size | date, program, machine |",
            "|---|---|---|---|---|---|---|---|",
        ]
        for row in rows:
            result = self._rows.get(row.id, {}).get("result")
            if result is None:
                lines.append(f"| {row.id} | {row.fault} | | | {_cell(row.goal)} | **not run** | 0 of {row.sizes[2]} {row.unit} | |")
                continue
            verdict = f"**missed** ({result['misses']})" if result["misses"] else "met"
            verdict += _share(result["count"], row.sizes[2])
            not_judged = [*result["not_judged"], *([_GROWN] if result["goal"] != row.goal else [])]
            if not_judged:
                verdict += f"; **not judged**: {_cell('; '.join(not_judged))}"
            size = f"{result['count']} of {row.sizes[2]} {row.unit}" if row.sizes[2] > 1 else "full"
            program = _short(result.get("program", "of an unrecorded commit"))
            where = f"{result['date']}, {result['seconds']} s; {program}; {result['machine']}"
            where += "; times depend on the load" if result["timed"] else ""
            cells = [row.id, row.fault, result["done"], "; ".join(result["figures"]), row.goal, verdict, size, where]
            lines.append(f"| {' | '.join(_cell(cell) for cell in cells)} |")
        return "\n".join(lines) + "\n"

    def _misses(self, rows: Sequence[Row]) -> str:
        missed = [(row, self._rows[row.id]["result"]) for row in rows if self._rows.get(row.id, {}).get("result", {}).get("misses")]
        open_rows = [row for row in rows if "result" not in self._rows.get(row.id, {})]
        if not missed and not open_rows:
            return ""
        lines = ["\n## What was missed\n"]
        lines += [f"- **{row.id}**: not run ({row.fault})" for row in open_rows]
        for row, result in missed:
            lines += [f"- **{row.id}**: {_cell(miss)}" for miss in result["first_misses"]]
            lines += textwrap.wrap(f"- **{row.id}**, why: {row.note}", 120, subsequent_indent="  ") if row.note else []
            if result["misses"] > len(result["first_misses"]):
                lines.append(f"- **{row.id}**: and {result['misses'] - len(result['first_misses'])} more")
        return "\n".join(lines) + "\n"

    def _plot(self) -> str:
        if not (self._folder / "soak.svg").exists():
            return ""
        picture = "![Memory, descriptors, threads and time per well of the soak](reliability/soak.svg)"
        return f"\n{picture}\n\n*R18: what the daemon used after each larva.*\n"

    def _fuzzing(self) -> str:
        """The figures of the newest `make fuzz`, which are kept by hand."""
        return (self._folder / "fuzzing.md").read_text()

    def _controls(self, rows: Sequence[Row]) -> str:
        lines = ["| row | what was broken | what the row reported | date, program |", "|---|---|---|---|"]
        for row in rows:
            control = self._rows.get(row.id, {}).get("control")
            if control is None:
                lines.append(f"| {row.id} | {_cell(row.control)} | **not run** | |")
                continue
            said, shown = control["first_miss"] or "nothing", re.search(row.control_miss, control["first_miss"] or "")
            said = said if shown else f"**not what was broken**: {said}"
            where = f"{control['date']}, {_short(control.get('program', 'of an unrecorded commit'))}"
            lines.append(f"| {row.id} | {_cell(row.control)} | {_cell(said)} | {where} |")
        return "\n".join(lines) + "\n"
