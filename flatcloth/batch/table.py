"""The results as one table: ``results.csv`` always, ``results.parquet`` where pyarrow is installed."""

from __future__ import annotations

import csv
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from flatcloth.batch.rows import COLUMNS, Kind
from flatcloth.core.errors import FlatclothError

CSV, PARQUET = "results.csv", "results.parquet"


def write_table(rows: Sequence[Mapping[str, Any]], out: Path) -> list[Path]:
    """Write the table, each file under a temporary name first; return the files.

    Raises
    ------
    FlatclothError
        If it cannot be written.
    """
    files = [out / CSV]
    try:
        _write_csv(rows, out / f".{CSV}.partial")
        os.replace(out / f".{CSV}.partial", out / CSV)
        if _write_parquet(rows, out / f".{PARQUET}.partial"):
            os.replace(out / f".{PARQUET}.partial", out / PARQUET)
            files.append(out / PARQUET)
    except OSError as error:
        raise FlatclothError(f"{out}: the table cannot be written ({error}); make room.") from error
    return files


def _write_csv(rows: Sequence[Mapping[str, Any]], path: Path) -> None:
    names = [column.name for column in COLUMNS]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, names, extrasaction="ignore", restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows({name: _cell(row.get(name)) for name in names} for row in rows)


def _cell(value: Any) -> Any:
    """Return a cell that spreadsheets do not take for a formula."""
    if isinstance(value, str) and value[:1] in ("=", "+", "-", "@", "\t", "\r"):
        return f"'{value}"
    return "" if value is None else value


def _write_parquet(rows: Sequence[Mapping[str, Any]], path: Path) -> bool:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        return False
    kinds: dict[Kind, Any] = {
        "text": pyarrow.string(),
        "number": pyarrow.float64(),
        "count": pyarrow.int64(),
        "flag": pyarrow.bool_(),
    }
    fields = [
        pyarrow.field(column.name, kinds[column.kind], metadata={"meaning": column.meaning})
        for column in COLUMNS
    ]
    columns = [
        pyarrow.array([row.get(column.name) for row in rows], kinds[column.kind]) for column in COLUMNS
    ]
    pyarrow.parquet.write_table(pyarrow.Table.from_arrays(columns, schema=pyarrow.schema(fields)), path)
    return True
