"""The rows, in the order of the table."""

from __future__ import annotations

from ..kit.row import Row
from . import (
    access,
    bad_data,
    bad_files,
    cables,
    held_by_tests,
    r01_kill,
    r03_disk,
    r09_bits,
    r10_signals,
    r11_panic,
    r12_clock,
    r13_pollers,
    r14_slow,
    r15_http,
    r18_soak,
    r19_stop,
    r20_unit,
)

ROWS: tuple[Row, ...] = (
    r01_kill.ROW,
    held_by_tests.R2,
    r03_disk.ROW,
    cables.R4,
    held_by_tests.R5,
    held_by_tests.R6,
    cables.R7,
    held_by_tests.R8,
    r09_bits.ROW,
    r10_signals.ROW,
    r11_panic.ROW,
    r12_clock.ROW,
    r13_pollers.ROW,
    r14_slow.ROW,
    r15_http.ROW,
    access.R16,
    access.R17,
    r18_soak.ROW,
    r19_stop.ROW,
    r20_unit.ROW,
    bad_files.ROW,
    bad_data.ROW,
)
