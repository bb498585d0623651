"""The sources that this module was built from."""

from __future__ import annotations

from typing import NamedTuple

from . import _native


class Build(NamedTuple):
    """The sources of a program.

    Attributes:
        version: version of carved.
        commit: commit of its sources; `unknown` where it was not known.
        dirty: whether the sources had changes that were not committed. `None` where this is not known.
    """

    version: str
    commit: str
    dirty: bool | None


build = Build(*_native.build())
