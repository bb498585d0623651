"""The errors of this package, for a program (`code`, `scheduler_action`) and for a person (the message)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from .models import SchedulerAction, State


class CarvedError(Exception):
    """Base class of all errors that this package raises."""


class Unreachable(CarvedError):
    """The daemon did not answer any of the attempts."""


class MalformedAnswer(CarvedError):
    """The answer of the daemon, or of a proxy, does not follow the contract."""


class TimedOut(CarvedError):
    """The condition was not met in time."""


@dataclass(frozen=True)
class Mistake:
    """One mistake in a request, with its place: a JSON pointer, or line and column of a CSV."""

    detail: str
    pointer: str | None = None
    line: int | None = None
    column: str | None = None


@dataclass(frozen=True)
class LeaseStatus:
    """The holder of the lease, if there is one."""

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
    run: str | None = None
    lease: LeaseStatus | None = None
    #: `urn:carved:problem:` and the code.
    type: str = ""


class ProblemError(CarvedError):
    """The daemon refused a request; `problem` has the reason and the scheduler's reaction."""

    def __init__(self, problem: Problem, request: str) -> None:
        self.problem = problem
        self.request = request
        super().__init__(f"{request}: {problem.status} {problem.code}: {problem.detail}")

    @property
    def code(self) -> str:
        """The stable code of the problem."""
        return self.problem.code

    @property
    def status(self) -> int:
        """The HTTP status."""
        return self.problem.status

    def __reduce__(self) -> tuple[Any, ...]:
        return (type(self), (self.problem, self.request))
