from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from rig import BINARY, Daemon


@pytest.fixture
def start_daemon(tmp_path: Path) -> Iterator[Callable[..., Daemon]]:
    """Starts `carved simulate` with the given arguments. It is ended with the test."""
    if not BINARY.is_file():
        reason = f"there is no daemon at {BINARY}: `cargo build --bin carved`, or set CARVED_BIN"
        if os.environ.get("CARVED_STRICT") == "1":
            pytest.fail(reason)
        pytest.skip(reason)
    started: list[Daemon] = []

    def start(*arguments: str, time_scale: int = 20) -> Daemon:
        folder = tmp_path / f"daemon-{len(started)}"
        folder.mkdir()
        started.append(Daemon(folder, *arguments, time_scale=time_scale))
        return started[-1]

    yield start
    for daemon in started:
        daemon.end()
