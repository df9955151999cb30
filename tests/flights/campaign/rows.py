"""Rows of flights as columns of a Parquet file."""

from __future__ import annotations

import json
from typing import Any

from .batch import Row


def schema() -> Any:
    """Columns of `flights.parquet`. faults: a JSON text, since each kind has its own numbers."""
    import pyarrow as pa

    text, number, whole, yes = pa.string(), pa.float64(), pa.int64(), pa.bool_()
    texts = pa.list_(text)
    violation = pa.struct(
        {
            "rule": text, "time_s": number, "value": number, "state": text, "outside": texts,
            "times": whole,
        }
    )  # fmt: skip
    return pa.schema(
        {
            "seed": whole, "code": text, "verdict": text, "error": text, "site": text,
            "vehicle": text, "manner": text, "firmware": text, "authority": text, "lidar": yes,
            "signed": yes, "whole": yes, "wind_mps": number, "kinds": texts, "faults": text,
            "reached": yes, "why": text, "violations": pa.list_(violation),
            "least_clearance_m": number, "least_keep_out_m": number, "greatest_step_mps": number,
            "greatest_error": number, "controlled_s": number, "within_s": number, "states": texts,
            "cpu_s": number,
        }
    )  # fmt: skip


def table_row(row: Row) -> Row:
    """A row with the columns of the schema."""
    faults = row.get("faults", [])
    kinds = [fault["kind"] for fault in faults]
    return {**row, "kinds": kinds, "faults": json.dumps(faults)}
