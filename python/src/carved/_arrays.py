"""Checks of arrays. Every function names the argument in its errors."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from ._errors import InputError

Bytes = npt.NDArray[np.uint8]
Counts = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]
Floats = npt.NDArray[np.float64]
# The first four pixels of a Bayer mosaic, row by row.
Bayer = Literal["rggb", "grbg", "gbrg", "bggr"]


def picture(name: str, given: object) -> Counts:
    """A frame: uint8 or uint16, `(height, width)` or `(height, width, 3)`, contiguous. A contiguous array is not copied."""
    found = array(name, given)
    if found.dtype not in (np.uint8, np.uint16):
        raise TypeError(f"{name}: the dtype is {found.dtype}, expected uint8 or uint16")
    if found.ndim not in (2, 3) or (found.ndim == 3 and found.shape[2] != 3):
        raise InputError(f"{name}: the shape is {found.shape}, expected (height, width) or (height, width, 3)")
    _not_empty(name, found)
    return np.ascontiguousarray(found)


def bayer(given: Bayer | bool | None, first: Counts) -> Bayer | None:
    """The order of the mosaic of frames like `first`. `True` is `"rggb"`."""
    if given is None or given is False:
        return None
    found: Bayer = "rggb" if given is True else given
    if found not in get_args(Bayer):
        raise InputError(f"bayer: found {given!r}, expected True or one of {', '.join(get_args(Bayer))}")
    if first.ndim == 3:
        raise InputError("bayer: the picture is in colour, expected a grey mosaic (height, width)")
    return found


def eight_bits(pictures: Sequence[Counts]) -> list[Bytes]:
    """Frames of one camera in 8 bits, as the commands read files of 16 bits.

    Cameras of 8, 10, 12 and 14 bits store their counts unscaled in 16 bits: the largest count of all frames shows which it was.
    """
    if len({item.dtype for item in pictures}) > 1:
        raise TypeError("the dtypes are uint8 and uint16, expected the same for all frames, the closure and the empty capillary")
    if pictures[0].dtype == np.uint8:
        return [item.view(np.uint8) for item in pictures]
    largest = max(int(item.max()) for item in pictures)
    bits = next((bits for bits in (8, 10, 12, 14) if largest >> bits == 0), 16)
    return [(item >> (bits - 8)).astype(np.uint8) for item in pictures]


def silhouette(name: str, given: object) -> Bytes:
    """A silhouette: bool, or uint8 as coverage from 0 to 255, `(height, width)`. A contiguous uint8 array is not copied."""
    found = array(name, given)
    if found.ndim != 2:
        raise InputError(f"{name}: the shape is {found.shape}, expected (height, width)")
    _not_empty(name, found)
    if found.dtype == np.bool_:
        return np.where(found, np.uint8(255), np.uint8(0))
    if found.dtype != np.uint8:
        raise TypeError(f"{name}: the dtype is {found.dtype}, expected bool, or uint8 with 255 inside")
    if found.max() == 1:
        raise InputError(f"{name}: the largest value is 1, expected 255 inside, or bool")
    return np.ascontiguousarray(found)


def silhouettes(name: str, stack: object) -> list[Bytes]:
    """A stack `(views, height, width)` or a sequence of silhouettes of one size."""
    found = [silhouette(f"{name}[{at}]", item) for at, item in enumerate(items(name, stack))]
    _one_size(name, found)
    return found


def pictures(name: str, stack: object) -> list[Counts]:
    """A stack `(views, height, width[, 3])` or a sequence of frames of one size."""
    found = [picture(f"{name}[{at}]", item) for at, item in enumerate(items(name, stack))]
    _one_size(name, found)
    return found


def items(name: str, stack: object) -> Sequence[object]:
    """The pictures of a stack, without a copy."""
    if _is_arraylike(stack) and not isinstance(stack, Sequence):
        whole = array(name, stack)
        if whole.ndim < 3:
            raise InputError(f"{name}: the shape is {whole.shape}, expected (views, height, width)")
        found: Sequence[object] = list(whole)
    elif isinstance(stack, Iterable) and not isinstance(stack, (str, bytes)):
        found = list(stack)
    else:
        raise TypeError(f"{name}: found {type(stack).__name__}, expected an array or a sequence of arrays")
    if not found:
        raise InputError(f"{name}: found 0 views, expected at least 1")
    return found


# A turn with its closure view and a start anywhere stays below it. Angles in degrees do not.
MOST_RAD = 3 * math.pi


def angles(values: object, views: int) -> list[float]:
    """Angles in rad, one per view."""
    found = np.asarray(values)
    if found.ndim != 1 or found.dtype.kind not in "fiu":
        raise TypeError(f"angles: found {found.ndim} dimensions of {found.dtype}, expected one list of numbers in rad")
    if len(found) != views:
        raise InputError(f"angles: found {len(found)} angles for {views} views, expected one per view")
    for at, angle in enumerate(found):
        if not math.isfinite(angle):
            raise InputError(f"angles: found {angle} for view {at} (counted from 0), expected a finite number of rad")
        if abs(angle) > MOST_RAD:
            raise InputError(
                f"angles: found {angle:g} for view {at} (counted from 0), which is more than one turn and a half in rad "
                f"({MOST_RAD:.2f}); numpy.radians(angles) converts degrees"
            )
    return [float(angle) for angle in found]


def names(values: Sequence[str] | None, views: int) -> list[str]:
    """Names of the views. Without any, `view_00`, `view_01`, ..."""
    if values is None:
        return [f"view_{at:02d}" for at in range(views)]
    found = list(values)
    if len(found) != views or not all(isinstance(name, str) for name in found):
        raise InputError(f"names: found {len(found)} for {views} views, expected one text per view")
    return found


def _is_arraylike(value: object) -> bool:
    return hasattr(value, "__array__") or hasattr(value, "__array_interface__")


def array(name: str, given: object) -> npt.NDArray[Any]:
    """An array, or what numpy makes one of: xarray, pandas, pictures of Pillow, lists of rows."""
    if isinstance(given, np.ndarray):
        return given if given.dtype.isnative else given.astype(given.dtype.newbyteorder("="))
    if not _is_arraylike(given) and not isinstance(given, (list, tuple)):
        raise TypeError(f"{name}: found {type(given).__name__}, expected an array")
    try:
        found: npt.NDArray[Any] = np.asarray(given)
    except ValueError as error:
        raise InputError(f"{name}: {error}; expected rows of one length") from None
    # Whole numbers of Python and of tables are int64, whatever their size.
    if found.dtype.kind in "iu" and found.dtype.itemsize > 2 and found.size and found.min() >= 0 and found.max() <= 65535:
        return found.astype(np.uint8 if found.max() <= 255 else np.uint16)
    return found


def _not_empty(name: str, array: npt.NDArray[Any]) -> None:
    if 0 in array.shape:
        raise InputError(f"{name}: the shape is {array.shape}, expected at least one pixel")


def _one_size(name: str, found: Sequence[npt.NDArray[Any]]) -> None:
    for at, item in enumerate(found):
        if item.shape != found[0].shape:
            raise InputError(f"{name}[{at}]: the shape is {item.shape}, expected {found[0].shape} as {name}[0]")
