"""A row of the table: what it is asked for and what it observed."""

from __future__ import annotations

import os
import random
import re
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path


class CannotRun(Exception):
    """The row needs something that this machine lacks."""


@dataclass
class Context:
    """What a row gets."""

    binary: Path
    source: Path
    work: Path
    count: int
    control: bool = False
    """Break something on purpose: the row must report a miss."""
    random: random.Random = field(default_factory=lambda: random.Random(1))

    @property
    def version(self) -> str:
        """What the program under test says that it is, with its commit."""
        done = subprocess.run([self.binary, "--version"], capture_output=True, text=True, timeout=60)
        return done.stdout.strip() or f"{self.binary.name}, which names no version"

    def say(self, text: str) -> None:
        """Tells how far the row is."""
        print(f"  {text}", flush=True)


@dataclass
class Observed:
    """What a row saw. The goal is met if nothing contradicts it."""

    done: str
    """What was done, with its size."""
    figures: list[str] = field(default_factory=list)
    misses: list[str] = field(default_factory=list)
    """Every observation that contradicts the goal."""
    not_judged: list[str] = field(default_factory=list)
    """Parts of the goal for which this size is too small."""
    program: str = ""
    """What was measured, with its commit. Empty: the program under test alone."""
    machine_load: bool = False
    """Whether the figures are times, which depend on what else the machine does."""

    def expect(self, holds: bool, otherwise: str) -> None:
        """Records a miss unless `holds`."""
        if not holds:
            self.misses.append(otherwise)

    def add(self, other: Observed) -> None:
        """Adds the figures and misses of a part that was run by other means."""
        self.figures += other.figures
        self.misses += other.misses

    def at_most(self, what: str, found: float | None, limit: float, unit: str) -> None:
        """Adds the figure, and a miss if it is above its limit or if nothing was measured."""
        if found is None:
            self.misses.append(f"{what}: nothing was measured")
            return
        self.figures.append(f"{what} {found:.3g} {unit}")
        self.expect(found <= limit, f"{what} {found:.3g} {unit}, the goal is {limit:g} {unit}")


@dataclass(frozen=True)
class Row:
    """One row of the table."""

    id: str
    fault: str
    goal: str
    sizes: tuple[int, int, int]
    """Counts of the short, the default and the full form."""
    unit: str
    """What is counted."""
    control: str
    """What a control run breaks."""
    control_miss: str
    """Pattern of the miss that the break must cause. No other miss shows that the row can fail."""
    run: Callable[[Context], Observed]
    note: str = ""
    """What explains a known miss, or what of the goal is not tested."""
    known_miss: str | None = None
    """Pattern of the miss that `note` explains. It is reported, and does not fail the run."""

    def control_misses(self, observed: Observed) -> list[str]:
        """The misses that the break of a control run has caused."""
        return [miss for miss in observed.misses if re.search(self.control_miss, miss)]

    def unexplained(self, observed: Observed) -> list[str]:
        """The misses that are not known."""
        return [miss for miss in observed.misses if self.known_miss is None or not re.search(self.known_miss, miss)]


SCALES = ("short", "default", "full")


def percentile(values: Sequence[float], share: float) -> float | None:
    """The value below which `share` of the values are; None without values."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(len(ordered) * share))] if ordered else None


def machine() -> str:
    """Processors, memory, kernel and load of this machine."""
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    name = os.uname()
    return f"{os.cpu_count()} cores, {memory:.0f} GiB, {name.sysname} {name.release}, load {os.getloadavg()[0]:.1f}"
