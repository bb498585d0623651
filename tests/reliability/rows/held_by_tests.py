"""R2, R5, R6 and R8: rows that the Rust tests hold, because the faults are injected below or beside the program."""

from __future__ import annotations

import re
from dataclasses import dataclass

from ..kit.row import Context, Observed, Row
from ..kit.rust_tests import Tests, run_tests


@dataclass(frozen=True)
class _Break:
    """What a control run breaks, the test that it runs, and the miss that follows."""

    what: str
    test: str
    miss: str


_NOT_RUN = _Break(
    "a filter that selects no test: this shows only that a test that did not run is noticed",
    "no_such_test",
    "^no test is selected by `no_such_test`",
)


def _row(row_id: str, fault: str, goal: str, what: str, groups: list[Tests], broken: _Break = _NOT_RUN) -> Row:
    def run(context: Context) -> Observed:
        chosen = [Tests(groups[0].arguments, (broken.test,))] if context.control else groups
        return run_tests(context, chosen, what)

    return Row(row_id, fault, goal, (1, 1, 1), "run of the tests", broken.what, broken.miss, run)


R2 = _row(
    "R2",
    "power loss at any write",
    "0 acknowledged lost, no torn view or record accepted",
    "a file layer that drops or tears what was not synced after every operation of a short run, and one that fails at each "
    "operation (`power_loss`, `lines`, `full_disk`)",
    [
        Tests("-p carved-store --lib", ("power_loss::", "lines::")),
        Tests("-p carved --lib", ("full_disk::", "what_the_driver_believes_is_what_its_journal_says")),
    ],
    _Break(
        "the file layer of the test ignores every sync (`CARVED_CONTROL`)",
        "what_was_acknowledged_outlives",
        r"\bwhat_was_acknowledged_outlives\w*: FAILED$",
    ),
)

R5 = _row(
    "R5",
    "garbage, truncated, duplicated, late replies",
    "0 panics, 0 double moves, 0 values in the wrong field; parsers fuzzed",
    "emulated Grbl, TMCL, Zaber, bridge and relay with a fault at each byte or answer; all parsers on the corpus, with what `make fuzz` "
    "added to it, and on mutations",
    [
        Tests(
            "-p carved --test devices",
            (
                "a_bit_that_changes_in_any_byte",
                "late_answer",
                "answers_that_come_twice",
                "noise",
                "stray_bytes",
                "a_flipped_bit_that_parses",
                "missing_or_late",
                "split_and_merged",
                "an_answer_that_is_none",
            ),
        ),
        Tests("-p carved --test commands", ("no_parser_panics",)),
    ],
)

R6 = _row(
    "R6",
    "stall, missed steps, reset without alarm",
    "no view kept at a wrong angle beyond tolerance: encoder or stall where there is one, closure check where not",
    "emulated axes that stall, lose steps or restart in mid-turn",
    [
        Tests(
            "-p carved --test devices",
            (
                "lost_steps_are_a_miss",
                "stalls_limits_and_hands",
                "a_stall_is_named",
                "steps_that_one_motor_lost",
                "a_restart",
                "a_reset_in_the_middle",
                "one_stalled_motor",
            ),
        ),
        Tests("-p carved --test daemon", ("steps_lost_in_a_revolution",)),
    ],
)

_LONGER = re.compile(r"^(\d) % (\w+): turn longer by (-?[\d.]+) %")
_LIMITS = {"1": 10.0, "5": 50.0}


def _run_packets(context: Context) -> Observed:
    name = _NOT_RUN.test if context.control else "lost_doubled_and_swapped_packets"
    what = (
        "turns of the emulated GigE Vision camera with lost, doubled and swapped packets; every view held against the scene pixel by pixel"
    )
    observed = run_tests(context, [Tests("-p carved --test devices", (name, "five_percent_lost_packets"))], what, ignored=True)
    observed.machine_load = True
    found = [match for match in map(_LONGER.match, observed.figures) if match]
    observed.expect(len(found) == 4, f"{len(found)} of 4 times were measured")
    for match in found:
        limit = _LIMITS[match[1]]
        observed.expect(float(match[3]) <= limit, f"{match[1]} % {match[2]}: turn longer by {match[3]} %, the goal is {limit:g} %")
    return observed


R8 = Row(
    "R8",
    "1 % and 5 % packet loss, reorder, duplicates",
    "0 incomplete frames reach the carver, every view there, time +10 % / +50 % at most",
    (1, 1, 1),
    "run of the tests",
    _NOT_RUN.what,
    _NOT_RUN.miss,
    _run_packets,
)
