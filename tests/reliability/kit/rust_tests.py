"""Rows that named Rust tests hold: the tests are run, and the figures that they print are quoted."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

from .row import CannotRun, Context, Observed

_RESULT = re.compile(r"^test (\S+) \.\.\. (ok|FAILED|ignored.*)$", re.MULTILINE)
_FIGURE = re.compile(r"^figure: (.+)$", re.MULTILINE)


@dataclass(frozen=True)
class Tests:
    """Tests of one target, as `cargo test ARGUMENTS -- FILTERS` selects them."""

    arguments: str
    filters: tuple[str, ...]

    def named(self) -> str:
        """How a person runs them."""
        return f"`cargo test {self.arguments} -- {' '.join(self.filters)}`"


def _commit(source: Path) -> str:
    """The commit of the sources whose tests are run, and whether they differ from it."""

    def git(*arguments: str) -> str:
        return subprocess.run(["git", *arguments], cwd=source, capture_output=True, text=True, check=True).stdout.strip()

    changed = git("status", "--porcelain", "--", "src", "crates", "hardware-sim", "config", "tests", ":!tests/reliability", "Cargo.lock")
    return git("rev-parse", "HEAD") + (", with changes" if changed else "")


def run_tests(context: Context, groups: list[Tests], what: str, ignored: bool = False) -> Observed:
    """Runs the tests, with `ignored` also those that are run by name only. Each filter must select a test, and each must
    pass. In a control run the tests are told to break what they check.
    """
    if shutil.which("cargo") is None:
        raise CannotRun("cargo is not installed, and this row is held by Rust tests")
    observed, passed = Observed(what, program=f"the tests of {_commit(context.source)}"), 0
    for group in groups:
        command = [
            "cargo",
            "test",
            "--locked",
            *group.arguments.split(),
            "--",
            "--show-output",
            *(["--include-ignored"] if ignored else []),
            *group.filters,
        ]
        context.say(" ".join(command))
        environment = {**os.environ, **({"CARVED_CONTROL": "1"} if context.control else {})}
        done = subprocess.run(command, cwd=context.source, capture_output=True, text=True, env=environment)
        if "test result:" not in done.stdout:
            raise CannotRun(f"the tests could not be built: {done.stderr[-500:]}")
        results = _RESULT.findall(done.stdout)
        for pattern in group.filters:
            observed.expect(any(pattern in name for name, _ in results), f"no test is selected by `{pattern}`")
        for name, result in results:
            passed += result == "ok"
            observed.expect(result == "ok", f"{name}: {result}")
        observed.figures += _FIGURE.findall(done.stdout)
    observed.figures.insert(0, f"{passed} tests passed")
    return observed
