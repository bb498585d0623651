"""Rows that named Rust tests hold: the tests are run, and the figures that they print are quoted."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import dataclass

from .row import CannotRun, Context, Observed

_RESULT = re.compile(r"^test (\S+) \.\.\. (ok|FAILED|ignored.*)$", re.MULTILINE)
_FIGURE = re.compile(r"^figure: (.+)$", re.MULTILINE)


@dataclass(frozen=True)
class Tests:
    """Tests of one target, as `cargo test ARGUMENTS -- FILTERS` selects them."""

    arguments: str
    filters: tuple[str, ...]


def run_tests(context: Context, groups: list[Tests], what: str, ignored: bool = False) -> Observed:
    """Runs the tests, with `ignored` also those that are run by name only. Each filter must select a test, and each must pass."""
    if shutil.which("cargo") is None:
        raise CannotRun("cargo is not installed, and this row is held by Rust tests")
    observed, passed = Observed(what), 0
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
        done = subprocess.run(command, cwd=context.source, capture_output=True, text=True)
        results = _RESULT.findall(done.stdout)
        for pattern in group.filters:
            observed.expect(any(pattern in name for name, _ in results), f"no test is selected by `{pattern}`: {done.stderr[-300:]}")
        for name, result in results:
            passed += result == "ok"
            observed.expect(result == "ok", f"{name}: {result}")
        observed.figures += _FIGURE.findall(done.stdout)
    observed.figures.insert(0, f"{passed} tests passed")
    return observed
