"""Opens the tables of carved with pandas, polars and DuckDB, without options, and compares what they find.

    read_tables.py FOLDER      with table.csv, shape.csv, expected.json and, where carved writes it, table.parquet
"""

import json
import sys
from pathlib import Path

import duckdb
import pandas as pd
import polars as pl

folder = Path(sys.argv[1])
expected = json.loads((folder / "expected.json").read_text())
table, shape, parquet = folder / "table.csv", folder / "shape.csv", folder / "table.parquet"


def check(who, rows, columns, first, kinds):
    """`first` are the cells of the first row by column, `kinds` the kind of each column."""
    assert (rows, columns) == (expected["rows"], expected["columns"]), f"{who}: {rows} x {columns}"
    for name, value in expected["first"].items():
        assert first[name] == value, f"{who}, {name}: {first[name]!r} is not {value!r}"
    for name, kind in expected["kinds"].items():
        assert kinds[name] == kind, f"{who}: {name} is {kinds[name]}, not {kind}"


def pandas_kinds(frame):
    def kind(column):
        values = column.dropna()
        if pd.api.types.is_bool_dtype(values) or set(map(type, values)) == {bool}:
            return "truth"
        return "number" if pd.api.types.is_numeric_dtype(column) else "text"

    return {name: kind(frame[name]) for name in frame.columns}


def polars_kinds(frame):
    kinds = {pl.String: "text", pl.Boolean: "truth", pl.Float64: "number", pl.Int64: "number"}
    return {name: kinds[kind] for name, kind in frame.schema.items()}


def duckdb_kinds(relation):
    kinds = {"VARCHAR": "text", "BOOLEAN": "truth", "DOUBLE": "number", "BIGINT": "number"}
    return dict(zip(relation.columns, (kinds.get(str(kind), str(kind)) for kind in relation.types), strict=True))


def with_pandas(who, frame):
    check(who, len(frame), len(frame.columns), frame.iloc[0].to_dict(), pandas_kinds(frame))


def with_polars(who, frame):
    check(who, frame.height, frame.width, frame.row(0, named=True), polars_kinds(frame))


def with_duckdb(who, relation):
    # Times would need pytz.
    wanted = list(expected["first"])
    first = dict(zip(wanted, relation.project(", ".join(wanted)).limit(1).fetchall()[0], strict=True))
    check(who, relation.count("*").fetchall()[0][0], len(relation.columns), first, duckdb_kinds(relation))


with_pandas("pandas", pd.read_csv(table))
with_polars("polars", pl.read_csv(table))
with_duckdb("DuckDB", duckdb.sql(f"FROM '{table}'"))
if parquet.exists():
    with_pandas("pandas, Parquet", pd.read_parquet(parquet))
    with_polars("polars, Parquet", pl.read_parquet(parquet))
    with_duckdb("DuckDB, Parquet", duckdb.sql(f"FROM '{parquet}'"))
for frame in (pd.read_csv(shape), pl.read_csv(shape).to_pandas(), duckdb.sql(f"FROM '{shape}'").df()):
    assert len(frame) == expected["stations"], len(frame)
    assert frame["area_um2"].sum() > 0 and frame["station"].min() == 1
print("read")
