"""The results as one table: ``results.csv`` always, ``results.parquet`` where pyarrow is installed."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from flatcloth.batch.rows import COLUMNS, Kind
from flatcloth.core.errors import FlatclothError, os_errors_as
from flatcloth.core.plain_files import replace_file

CSV, PARQUET = "results.csv", "results.parquet"


def write_table(rows: Sequence[Mapping[str, Any]], out: Path) -> list[Path]:
    """Write the table, each file under a temporary name first; return the files.

    Raises
    ------
    FlatclothError
        If it cannot be written.
    """
    tables = {CSV: _csv(rows), PARQUET: _parquet(rows)}
    with os_errors_as(FlatclothError, f"{out}: the table cannot be written", "Make room."):
        for name, data in tables.items():
            if data is not None:
                replace_file(out / name, data)
    return [out / name for name, data in tables.items() if data is not None]


def _csv(rows: Sequence[Mapping[str, Any]]) -> bytes:
    names = [column.name for column in COLUMNS]
    file = io.StringIO(newline="")
    writer = csv.DictWriter(file, names, extrasaction="ignore", restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: _cell(row.get(name)) for name in names} for row in rows)
    return file.getvalue().encode("utf-8", "surrogateescape")


def _cell(value: Any) -> Any:
    """Return a cell that spreadsheets do not take for a formula."""
    if isinstance(value, str) and value[:1] in ("=", "+", "-", "@", "\t", "\r"):
        return f"'{value}"
    return "" if value is None else value


def _parquet(rows: Sequence[Mapping[str, Any]]) -> bytes | None:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        return None
    kinds: dict[Kind, Any] = {
        "text": pyarrow.string(),
        "number": pyarrow.float64(),
        "count": pyarrow.int64(),
    }
    fields = [
        pyarrow.field(column.name, kinds[column.kind], metadata={"meaning": column.meaning})
        for column in COLUMNS
    ]
    columns = [
        pyarrow.array([row.get(column.name) for row in rows], kinds[column.kind]) for column in COLUMNS
    ]
    file = io.BytesIO()
    pyarrow.parquet.write_table(pyarrow.Table.from_arrays(columns, schema=pyarrow.schema(fields)), file)
    return file.getvalue()
