"""The native part of carved. Use the package `carved`, which checks its arguments."""

import os
from collections.abc import Callable, Sequence
from typing import final

import numpy as np
import numpy.typing as npt

__all__ = [
    "NativeProfile",
    "NativeRecording",
    "Numbers",
    "build",
    "calibrate",
    "measure_frames",
    "measure_silhouettes",
    "projections",
    "segment",
]

@final
class Numbers:
    @property
    def json(self) -> str: ...
    @property
    def doubts(self) -> list[str]: ...
    @property
    def vertices(self) -> npt.NDArray[np.float64]: ...
    @property
    def triangles(self) -> npt.NDArray[np.uint32]: ...
    @property
    def mirrored(self) -> bool: ...
    def voxels(self) -> tuple[npt.NDArray[np.uint8], tuple[float, float, float], float] | None: ...

@final
class NativeProfile:
    @property
    def mask(self) -> npt.NDArray[np.uint8]: ...
    @property
    def outlines(self) -> list[npt.NDArray[np.float64]]: ...
    @property
    def body(self) -> list[npt.NDArray[np.float64]]: ...
    @property
    def contrast(self) -> list[npt.NDArray[np.float64]]: ...
    @property
    def error_px(self) -> list[npt.NDArray[np.float64]]: ...
    @property
    def bounded(self) -> list[npt.NDArray[np.bool_]]: ...
    @property
    def json(self) -> str: ...
    @property
    def blocks(self) -> float | None: ...
    @property
    def mosaic(self) -> float | None: ...

@final
class NativeRecording:
    def __new__(cls, path: str | os.PathLike[str]) -> NativeRecording: ...
    @property
    def json(self) -> str: ...
    @property
    def stored(self) -> str | None: ...
    @property
    def views(self) -> list[tuple[int, float, bool]]: ...
    @property
    def empty(self) -> npt.NDArray[np.uint8] | None: ...
    def frame(self, place: int) -> npt.NDArray[np.uint8]: ...
    def measure(self, asd: int | None, progress: Callable[[int, int], object] | None) -> Numbers: ...

def build() -> tuple[str, str, bool | None]: ...
def segment(image: npt.NDArray[np.uint8], bayer: str | None, settings: str, empty: npt.NDArray[np.uint8] | None) -> NativeProfile: ...
def measure_frames(
    frames: Sequence[npt.NDArray[np.uint8]],
    bayer: str | None,
    angles: Sequence[float],
    closure: npt.NDArray[np.uint8] | None,
    empty: npt.NDArray[np.uint8] | None,
    camera_json: str,
    method: str,
    bead: bool,
    progress: Callable[[int, int], object] | None,
) -> Numbers: ...
def measure_silhouettes(
    silhouettes: Sequence[npt.NDArray[np.uint8]],
    names: Sequence[str],
    angles: Sequence[float],
    camera_json: str | None,
    matrices: npt.NDArray[np.float64] | None,
    options: str,
    progress: Callable[[int, int], object] | None,
) -> Numbers: ...
def calibrate(
    silhouettes: Sequence[npt.NDArray[np.uint8]],
    names: Sequence[str],
    angles: Sequence[float],
    camera_json: str,
    objective: str,
    free: Sequence[str],
    epsilon: float,
    voxel_um: float,
    evaluations: int,
) -> tuple[str, str, list[float], list[float], list[str]]: ...
def projections(camera_json: str, angles: Sequence[float]) -> npt.NDArray[np.float64]: ...
