"""What can go wrong, for a program (`code`, `scheduler_action`) and for a person (the message)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from .models import SchedulerAction, State


class CarvedError(Exception):
    """Everything that this package raises of its own."""


class Unreachable(CarvedError):
    """The daemon did not answer, however often it was asked."""


class MalformedAnswer(CarvedError):
    """The daemon, or whatever stands in its place, answered something that is not in the contract."""


class TimedOut(CarvedError):
    """What was waited for did not come about in time."""


@dataclass(frozen=True)
class Mistake:
    """One thing wrong with what was sent, and where: a JSON pointer, or a line and a column of a CSV."""

    detail: str
    pointer: str | None = None
    line: int | None = None
    column: str | None = None


@dataclass(frozen=True)
class LeaseStatus:
    """Who alone commands the instrument now, if anybody."""

    holder: str | None = None
    expires_in_s: float | None = None


@dataclass(frozen=True)
class Problem:
    """`application/problem+json` (RFC 9457) as the daemon sends it."""

    status: int
    code: str
    detail: str
    title: str = ""
    scheduler_action: SchedulerAction = "escalate_operator"
    fault_seq: int | None = None
    errors: tuple[Mistake, ...] = ()
    accepted_in: tuple[State, ...] = ()
    lease: LeaseStatus | None = None


class ProblemError(CarvedError):
    """The daemon refused; `problem` says why and what a scheduler does about it."""

    def __init__(self, problem: Problem, request: str) -> None:
        self.problem = problem
        self.request = request
        super().__init__(f"{request}: {problem.status} {problem.code}: {problem.detail}")

    @property
    def code(self) -> str:
        """The stable word to branch on."""
        return self.problem.code

    @property
    def status(self) -> int:
        """The HTTP status."""
        return self.problem.status

    def __reduce__(self) -> tuple[Any, ...]:
        return (type(self), (self.problem, self.request))
