"""Figures in one line: views with their outlines, a model, a plate. They need matplotlib: `pip install carved[plot]`."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from . import _arrays
from ._errors import InputError
from ._measure import Model, Views
from ._recording import Recording
from ._segment import Profile, segment

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

OUTLINE = "tab:orange"
WELL = re.compile(r"([A-Z]{1,2})0*([1-9][0-9]?)")
# The smallest plate that holds all wells is drawn.
PLATES = ((8, 12), (16, 24), (32, 48))


def plot_views(
    views: Recording | Views,
    *,
    angles: Sequence[float] | npt.NDArray[np.float64] | None = None,
    most: int = 6,
    outlines: bool = True,
    bayer: _arrays.Bayer | bool | None = None,
    columns: int = 3,
) -> Figure:
    """Draw views of a turn, evenly spread, each with its outline.

    Args:
        views: a recording, or frames as `measure` takes them.
        angles: angle of each view, rad, for the titles. Default: those of the recording.
        most: number of views to draw at most.
        outlines: find and draw the outline in each view that is drawn.
        bayer: order of the Bayer mosaic of grey frames, as `segment` takes it. Default: as the recording says.
        columns: pictures side by side.

    Returns:
        The matplotlib figure.

    Raises:
        SegmentError: a view gives no outline.
    """
    import matplotlib.pyplot as plt

    found: Sequence[Any] = views.frames if isinstance(views, Recording) else _arrays.items("views", views)
    if isinstance(views, Recording):
        angles, bayer = views.angles if angles is None else angles, views.bayer
    if most < 1 or columns < 1:
        raise InputError(f"most is {most} and columns is {columns}, expected 1 or more")
    radians = None if angles is None else _arrays.angles(angles, len(found))
    count = min(most, len(found))
    chosen = [at * len(found) // count for at in range(count)]
    rows = math.ceil(count / columns)
    frames = _arrays.eight_bits([_arrays.picture(f"views[{at}]", found[at]) for at in chosen])
    wide = min(columns, count)
    height, width = frames[0].shape[:2]
    figure, axes = plt.subplots(rows, wide, figsize=(4.2 * wide, 0.5 * rows + 4.2 * rows * height / width), squeeze=False)
    for place in axes.flat[count:]:
        place.set_axis_off()
    for place, at, frame in zip(axes.flat, chosen, frames, strict=False):
        place.imshow(frame, cmap="gray", vmin=0, vmax=255)
        title = f"view {at}" if radians is None else f"view {at}, {math.degrees(radians[at]):.1f} deg"
        if outlines:
            # As in a turn, where other views decide what is a fin.
            profile = segment(frame, bayer=bayer, settings={"faint_sure": 1.0})
            _outline(place, profile)
            title += f": {profile.kind}"
        place.set_title(title, fontsize="small")
        place.set(xticks=[], yticks=[])
    figure.tight_layout()
    return figure


def plot_model(model: Model) -> Figure:
    """Draw a model from two sides: how thick it is along the line of sight, um.

    Args:
        model: what `measure` or `carve` returned.

    Returns:
        The matplotlib figure: seen along z as the camera does at 0 deg, with y down, and along y.

    Raises:
        InputError: the capillary was empty.
    """
    import matplotlib.pyplot as plt

    volume = model.volume()
    if volume is None:
        raise InputError("model: the capillary was empty, expected a model with voxels")
    edge = volume.voxel_um
    # The origin is the centre of the first voxel, and a picture begins at its edge.
    low = np.array(volume.origin_um) - edge / 2
    high = low + np.array(volume.inside.shape) * edge
    sides = [(1, 2, "y"), (2, 1, "z")]
    thickness = [volume.inside.sum(axis=along).T * edge for _, along, _ in sides]
    figure, axes = plt.subplots(2, 1, sharex=True, figsize=(9, 5), layout="constrained")
    for place, picture, (across, _, name) in zip(axes, thickness, sides, strict=True):
        extent = (low[0], high[0], high[across], low[across])
        shown = place.imshow(picture, extent=extent, cmap="viridis", vmin=0, vmax=max(t.max() for t in thickness))
        place.set_ylabel(f"{name}, um")
    axes[0].set_title(
        f"{model.volume_um3 / 1e6:.2f} nl, {model.area_um2 / 1e6:.3f} mm$^2$" + (": " + ", ".join(model.flags) if model.flags else "")
    )
    axes[1].set_xlabel("x along the capillary, um")
    figure.colorbar(shown, ax=axes, label="thickness, um")
    return figure


def plot_plate(
    table: pd.DataFrame | Mapping[str, float],
    column: str = "volume_um3",
    *,
    label: str | None = None,
    limits: tuple[float, float] | None = None,
) -> Figure:
    """Draw a plate with the number of each well as a colour. Wells with flags have an orange border.

    Args:
        table: the rows of one run from `carved export table` (columns `well`, `flags` and `column`), or numbers by well.
        column: the column to draw.
        label: words at the scale. Default: `column`.
        limits: ends of the scale. Default: the least and the largest number.

    Returns:
        The matplotlib figure.

    Raises:
        InputError: the table has no such column, several runs, a well twice, or no number.
    """
    import matplotlib.pyplot as plt
    from matplotlib.patches import Rectangle

    numbers, flagged = _wells(table, column)
    places = {well: _place(well) for well in numbers}
    plate = next((p for p in PLATES if all(row < p[0] and at < p[1] for row, at in places.values())), None)
    if plate is None:
        raise InputError(f"table: the wells {', '.join(sorted(numbers)[:3])}, ... are on no plate of 96, 384 or 1536 wells")
    grid = np.full(plate, np.nan)
    for well, at in places.items():
        grid[at] = numbers[well]
    low, high = (None, None) if limits is None else limits
    figure, place = plt.subplots(figsize=(9, 9 * plate[0] / plate[1] + 0.6), layout="constrained")
    shown = place.imshow(grid, cmap="viridis", vmin=low, vmax=high)
    for well in flagged & numbers.keys():
        row, column_at = places[well]
        place.add_patch(Rectangle((column_at - 0.45, row - 0.45), 0.9, 0.9, fill=False, edgecolor=OUTLINE, linewidth=2))
    place.set_xticks(range(plate[1]), [str(at + 1) for at in range(plate[1])], fontsize="small")
    place.set_yticks(range(plate[0]), [_row_name(row) for row in range(plate[0])], fontsize="small")
    place.xaxis.tick_top()
    figure.colorbar(shown, ax=place, label=column if label is None else label, shrink=0.8)
    return figure


def _outline(place: Axes, profile: Profile) -> None:
    for outline in profile.outlines:
        place.plot(*np.vstack([outline, outline[:1]]).T, color=OUTLINE, linewidth=1)


def _wells(table: pd.DataFrame | Mapping[str, float], column: str) -> tuple[dict[str, float], set[str]]:
    if isinstance(table, Mapping):
        found = {str(well): float(value) for well, value in table.items()}
        flagged: set[str] = set()
    else:
        for name in ("well", column):
            if name not in table.columns:
                raise InputError(f"table: it has no column {name!r}; carved export table writes it")
        if "run" in table.columns and table["run"].nunique() > 1:
            raise InputError(f"table: it has {table['run'].nunique()} runs, expected one: table[table.run == RUN]")
        wells = [str(well) for well in table["well"]]
        twice = next((well for well in wells if wells.count(well) > 1), None)
        if twice is not None:
            raise InputError(f"table: the well {twice} has several rows, expected one per well")
        found = dict(zip(wells, _numbers(column, table[column]), strict=True))
        flags = table["flags"].fillna("") if "flags" in table.columns else [""] * len(wells)
        flagged = {well for well, flag in zip(wells, flags, strict=True) if flag}
    found = {well: value for well, value in found.items() if not math.isnan(value)}
    if not found:
        raise InputError(f"table: no well has a number in {column!r}")
    return found, flagged


def _numbers(column: str, values: Iterable[Any]) -> list[float]:
    try:
        return [math.nan if value is None else float(value) for value in values]
    except (TypeError, ValueError) as error:
        raise InputError(f"table: {column!r} holds no numbers: {error}") from None


def _place(well: str) -> tuple[int, int]:
    match = WELL.fullmatch(well.strip().upper())
    if match is None:
        raise InputError(f"table: {well!r} is no well, expected a row letter and a column number such as A01")
    row = 0
    for letter in match[1]:
        row = 26 * row + ord(letter) - ord("A") + 1
    return row - 1, int(match[2]) - 1


def _row_name(row: int) -> str:
    return ("" if row < 26 else chr(ord("A") + row // 26 - 1)) + chr(ord("A") + row % 26)
