from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from rig import Starter, starter


@pytest.fixture
def start_daemon(tmp_path: Path) -> Iterator[Starter]:
    """Starts `carved simulate` with the given arguments. It is ended with the test."""
    with starter(tmp_path) as start:
        yield start
