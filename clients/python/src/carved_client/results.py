"""Results of past runs: numbers, tables and files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, Literal
from urllib.parse import quote

from .decode import decode
from .errors import MalformedAnswer
from .transport import Transport

if TYPE_CHECKING:
    import pandas as pd


class Results:
    """Reads stored runs through one transport."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def runs(self, **query: str | int) -> Iterator[dict[str, Any]]:
        """The stored runs, newest first, page by page; for example `runs(plate_barcode="P-001", outcome="partial")`."""
        while True:
            page = self._kept("/v1/runs", query)
            yield from page["runs"]
            if page["next"] is None:
                return
            query["cursor"] = page["next"]

    def run(self, run_id: str) -> dict[str, Any]:
        """One run: its plan, its outcome and the results of its wells."""
        return self._kept(_path(run_id))

    def specimen(self, run_id: str, well: str) -> dict[str, Any]:
        """One specimen: its numbers, its quality, and links to its files."""
        return self._kept(_path(run_id, well))

    def results_frame(self, run_id: str) -> pd.DataFrame:
        """The results of a run as a table, one row per well in the order of the plan; units are in the column names.

        Needs the extra `tables` (pandas).
        """
        from .tables import frame_of

        return frame_of(self.run(run_id))

    def table(self, *run_ids: str) -> pd.DataFrame:
        """One table of runs: a row per planned well with plate map, all numbers, flags, checks, versions and hashes.

        `docs/tables.md` lists the columns. Needs the extra `tables` (pandas).
        """
        from .tables import frame_of_csv

        return frame_of_csv(self._transport.request("GET", "/v1/table.csv", params={"runs": ",".join(run_ids)}).text)

    def statistics(self, run_id: str, *, flagged: Literal["sound", "included", "excluded"] = "sound") -> dict[str, Any]:
        """Groups, Z' and dose-response curves of a run, by quantity: `docs/statistics.md`.

        `flagged` says which specimens with flags count: `sound` those whose number is no bound and not doubtful,
        `included` all, `excluded` none.
        """
        return self._kept(f"{_path(run_id)}/statistics", {"flagged": flagged})

    def mesh(self, run_id: str, well: str, kind: Literal["ply", "glb"] = "ply") -> bytes:
        """The surface of the specimen in um: complete as `ply`, or with fewer triangles for display as `glb`."""
        return self._file(f"{_path(run_id, well)}/mesh.{kind}")

    def view(self, run_id: str, well: str, index: int) -> bytes:
        """The raw frame of one view, PNG."""
        return self._file(f"{_path(run_id, well)}/views/{index}.png")

    def profile(self, run_id: str, well: str, index: int) -> bytes:
        """The mask that was used to carve one view, PNG."""
        return self._file(f"{_path(run_id, well)}/profiles/{index}.png")

    def picture(
        self,
        run_id: str,
        well: str,
        aspect: Literal["lateral", "dorsal"] = "lateral",
        kind: Literal["png", "tif"] = "png",
    ) -> bytes:
        """A standard picture of a larva, head to the left: its left side, or its back. The `png` has a scale bar."""
        return self._file(f"{_path(run_id, well)}/{aspect}.{kind}")

    def _kept(self, path: str, query: Mapping[str, str | int] | None = None) -> dict[str, Any]:
        response = self._transport.request("GET", path, params=query)
        try:
            return decode(dict[str, Any], response.json())
        except ValueError as error:
            raise MalformedAnswer(f"GET {path}: not JSON: {response.text[:200]!r}") from error

    def _file(self, path: str) -> bytes:
        return self._transport.request("GET", path).content


def _path(run_id: str, well: str | None = None) -> str:
    run = f"/v1/runs/{quote(run_id, safe='')}"
    return run if well is None else f"{run}/specimens/{quote(well, safe='')}"
