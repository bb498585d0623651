"""Results as pandas tables. Needs the extra `tables`."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any

import pandas as pd


def frame_of(run: Mapping[str, Any]) -> pd.DataFrame:
    """A run's results, indexed by well, with the plate map's entries (compound, concentration, control ...).

    Nested values have names with a dot. Flags are separated by commas.
    """
    planned = {well["well"]: well for well in run["plan"]["plate_map"]}
    rows = [{**planned[row["well"]], **row, "flags": ",".join(row.get("flags") or ())} for row in run["results"]]
    frame = pd.json_normalize(rows)
    frame.insert(0, "run", run["id"])
    indexed: pd.DataFrame = frame.set_index("well")
    return indexed


def frame_of_csv(text: str) -> pd.DataFrame:
    """A table of specimens. Barcodes stay text: `0017` is not 17."""
    frame: pd.DataFrame = pd.read_csv(io.StringIO(text), dtype={"plate_barcode": str, "external_id": str})
    return frame
