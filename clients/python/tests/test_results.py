"""Reads the results of a run."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from rig import PATIENCE_S, Daemon, plan

from carved_client import PlannedWell, ProblemError


def test_numbers_tables_and_files_of_a_run(start_daemon: Callable[..., Daemon]) -> None:
    daemon = start_daemon("--no-demo", "--empty", "A02")
    with daemon.ready() as client:
        wells = (PlannedWell("A01", "bead", compound="glass"), PlannedWell("A02", dpf=4.0))
        client.put_run("r1", plan(*wells))
        client.wait_for_outcome("r1", PATIENCE_S)
        assert [run["id"] for run in client.runs(plate_barcode="P-1", limit=1)] == ["r1"]
        assert list(client.runs(plate_barcode="P-2")) == []
        assert client.run("r1")["outcome"] == "succeeded"

        table = client.results_frame("r1")
        assert list(table.index) == ["A01", "A02"]
        assert table.loc["A01", "run"] == "r1"
        assert table["diameter_um"].tolist() == pytest.approx([500.0, float("nan")], rel=0.01, nan_ok=True)
        assert table["outcome"].tolist() == ["succeeded", "skipped"]
        assert {"volume_um3", "volume_sd_um3", "area_um2"} <= set(table.columns)

        whole = client.table("r1")
        assert whole["well"].tolist() == ["A01", "A02"]
        assert whole["plate_barcode"].tolist() == ["P-1", "P-1"]
        assert whole["diameter_um"].tolist()[0] == table["diameter_um"].tolist()[0]
        [diameter] = [q for q in client.statistics("r1")["quantities"] if q["name"] == "diameter_um"]
        assert [(group["n"], group["sd"]) for group in diameter["groups"]] == [(1, None)]

        specimen = client.specimen("r1", "A01")
        assert len(specimen["links"]["views"]) == 21
        assert client.mesh("r1", "A01").startswith(b"ply\nformat binary")
        assert client.mesh("r1", "A01", "glb").startswith(b"glTF")
        for picture in (client.view("r1", "A01", 0), client.profile("r1", "A01", 20)):
            assert picture.startswith(b"\x89PNG")
        for lost in (
            lambda: client.mesh("r1", "A02"),
            lambda: client.run("r2"),
            lambda: client.view("r1", "A01", 99),
            lambda: client.picture("r1", "A01"),  # a bead has no sides
        ):
            with pytest.raises(ProblemError) as missing:
                lost()
            assert missing.value.status == 404
