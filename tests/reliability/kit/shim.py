"""Faults below the program: clocks that jump, a disk that fails, a thread that panics, stop bytes on the motor's wire."""

from __future__ import annotations

import mmap
import os
import struct
import subprocess
from pathlib import Path

_WALL, _MONOTONIC, _ERRNO, _PASS, _FAILS, _PANIC, _FAILED, _FIRST = range(8)
_SIZE = 64


def compile_shim(work: Path) -> Path:
    """Compiles `shim.c` into `work`, once."""
    library = work / "shim.so"
    if not library.exists():
        source = Path(__file__).with_name("shim.c")
        subprocess.run(["cc", "-O2", "-Wall", "-shared", "-fPIC", "-o", library, source, "-ldl"], check=True)
    return library


class Shim:
    """The control of one shim. Pass `environment` to the program."""

    def __init__(self, work: Path, name: str = "shim", under: Path | None = None) -> None:
        work.mkdir(parents=True, exist_ok=True)
        control = work / f"{name}.control"
        control.write_bytes(b"\0" * _SIZE)
        self.tty = work / f"{name}.tty"
        self.tty.write_bytes(b"")
        descriptor = os.open(control, os.O_RDWR)
        self._words = mmap.mmap(descriptor, _SIZE)
        os.close(descriptor)
        self.environment = {
            "LD_PRELOAD": str(compile_shim(work)),
            "SHIM_CONTROL": str(control),
            "SHIM_TTY": str(self.tty),
        }
        if under is not None:
            self.environment["SHIM_UNDER"] = str(under)

    def _put(self, word: int, value: int) -> None:
        self._words[8 * word : 8 * word + 8] = struct.pack("q", value)

    def _get(self, word: int) -> int:
        return int(struct.unpack("q", self._words[8 * word : 8 * word + 8])[0])

    def wall_clock(self, seconds: float) -> None:
        """Sets the wall clock off by `seconds`."""
        self._put(_WALL, int(seconds * 1e9))

    def monotonic_clock(self, seconds: float) -> None:
        """Sets the monotonic clock off by `seconds`, which no operating system does: for controls."""
        self._put(_MONOTONIC, int(seconds * 1e9))

    def fail(self, errno: int, after: int, count: int) -> None:
        """Lets `after` changes of files pass, then fails `count` of them, or all of them with -1."""
        self._put(_FAILED, 0)
        self._put(_PASS, after)
        self._put(_FAILS, count)
        self._put(_ERRNO, errno)

    def heal(self) -> None:
        """Lets all changes of files pass."""
        self._put(_ERRNO, 0)

    @property
    def failed(self) -> int:
        """How many changes of files have failed."""
        return self._get(_FAILED)

    @property
    def first_failure_ns(self) -> int:
        """When the first change of a file failed, by the monotonic clock."""
        return self._get(_FIRST)

    def panic(self, thread: int) -> None:
        """Makes the thread with this id panic when it next reads the monotonic clock."""
        self._put(_PANIC, thread)

    @property
    def panic_is_due(self) -> bool:
        """Whether the thread has not read the clock yet."""
        return self._get(_PANIC) != 0

    def _written(self, *bytes_: str) -> list[int]:
        times = (line.split() for line in self.tty.read_text().splitlines())
        return [int(t) for t, byte in times if byte in bytes_]

    def stops(self, since: int) -> list[int]:
        """When stop bytes were written to the motor's wire, in ns of the monotonic clock, from `since` on."""
        return [t for t in self._written("21", "18", "85") if t >= since]

    def last_move(self, until: int) -> int | None:
        """When the last move before `until` was written to the motor's wire, in ns of the monotonic clock."""
        return max((t for t in self._written("47") if t <= until), default=None)
