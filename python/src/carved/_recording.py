"""Recordings, as `carved measure` reads them."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from typing import Any, overload

import numpy as np
import numpy.typing as npt

from . import _native
from ._arrays import Bayer
from ._camera import Camera
from ._measure import Measurement, Progress

# The orders of the mosaics, by the formats of the frames.
_ORDERS: dict[str, Bayer] = {"BayerRG8": "rggb", "BayerGR8": "grbg", "BayerGB8": "gbrg", "BayerBG8": "bggr"}


class Frames(Sequence[npt.NDArray[np.uint8]]):
    """The frames of a recording, one per angle. Each is read and verified when it is used; `numpy.asarray` reads all."""

    def __init__(self, found: _native.NativeRecording, places: list[int]) -> None:
        self._found = found
        self._places = places

    def __len__(self) -> int:
        return len(self._places)

    @overload
    def __getitem__(self, at: int) -> npt.NDArray[np.uint8]: ...
    @overload
    def __getitem__(self, at: slice) -> Frames: ...
    def __getitem__(self, at: int | slice) -> npt.NDArray[np.uint8] | Frames:
        """A frame, uint8 `(height, width)` or `(height, width, 3)`, read-only. Bayer frames stay mosaics. A slice has its frames."""
        if isinstance(at, slice):
            return Frames(self._found, self._places[at])
        return self._found.frame(self._places[at])

    def __array__(self, dtype: npt.DTypeLike | None = None, copy: bool | None = None) -> npt.NDArray[Any]:
        if copy is False:
            raise ValueError("the frames of a recording are read from its files; an array of them is always a copy")
        return np.asarray(np.stack(list(self)), dtype=dtype)

    def __repr__(self) -> str:
        return f"<carved.Frames: {len(self)}>"


class Recording:
    """The frames of one specimen with everything that its numbers depend on. Frames are read and verified when they are used.

    Attributes:
        path: the folder, `recording.json` or pack that was given.
        info: the content of `recording.json` (docs/files.md).
        camera: the camera of the rig.
        angles: float64 `(views,)`, angle of the capillary in each view, rad, without the closure view.
        numbers: int `(views,)`, number of each view.
        frames: the frames of these views, uint8 `(height, width)` or `(height, width, 3)` each, read-only; a sequence, of which
            `numpy.asarray` makes one array. Bayer frames stay mosaics.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = os.fspath(path)
        self._found = _native.NativeRecording(self.path)
        self.info: dict[str, Any] = json.loads(self._found.json)
        self.camera = Camera.from_dict(self.info["rig"]["camera"])
        views = self._found.views
        self._places = [place for place, (_, _, closure) in enumerate(views) if not closure]
        self._closure = next((place for place, (_, _, closure) in enumerate(views) if closure), None)
        self.frames = Frames(self._found, self._places)
        self.angles: npt.NDArray[np.float64] = np.array([views[place][1] for place in self._places], dtype=np.float64)
        self.numbers: npt.NDArray[np.int64] = np.array([views[place][0] for place in self._places], dtype=np.int64)

    def __len__(self) -> int:
        return len(self._places)

    @property
    def closure(self) -> npt.NDArray[np.uint8] | None:
        """The frame at 360 deg. `None` where there is none."""
        return None if self._closure is None else self._found.frame(self._closure)

    @property
    def empty(self) -> npt.NDArray[np.uint8] | None:
        """The frame of the empty capillary that frames are compared with. `None` where there is none."""
        return self._found.empty

    @property
    def bayer(self) -> Bayer | None:
        """The order of the frames' Bayer mosaic, as `measure` and `segment` take it. `None` where the frames are no mosaics."""
        return _ORDERS.get(self.info["rig"]["pixel_format"])

    @property
    def stored(self) -> str | None:
        """The text of the stored `measurement.json`. `None` where there is none."""
        return self._found.stored

    def measure(self, views: int | None = None, *, progress: Progress | None = None) -> Measurement:
        """Compute the numbers again from the frames, as `carved measure` does: `json` is the text of `measurement.json`.

        Args:
            views: measure with this number of the captured views, evenly spread. Default: all.
            progress: called with `(done, total)` in this thread after each view. An exception that it raises ends the work.

        Raises:
            InputError: the captured views have no even subset of this number.
            RecordingError: the turn is not finished, or a frame is missing or was altered.
            MeasureError: the frames give no numbers.
        """
        return Measurement(self._found.measure(views, progress))

    def __repr__(self) -> str:
        return f"<carved.Recording: {self.path}, {len(self)} views>"


def read(recording: str | os.PathLike[str]) -> Recording:
    """Open a recording: its folder (`runs/RUN/A01`), its `recording.json`, or its pack (`A01.tar`).

    Raises:
        RecordingError: there is no recording, or it cannot be read, was altered, or is of a newer carved.
    """
    return Recording(recording)
