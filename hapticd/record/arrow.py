"""Rows to Arrow and back: the schema with its units and metadata, and record batches without a copy per value.

pyarrow is imported in the functions, so that ``import hapticd.record`` stays cheap for the command line.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hapticd.record.metadata import encode_metadata
from hapticd.record.schema import COLUMNS, ROW, Rows

END_OF_STREAM = b"\xff\xff\xff\xff\x00\x00\x00\x00"

_NAMES = ROW.names or ()
_IS_FLOAT = tuple(ROW[name].kind == "f" for name in _NAMES)


def arrow_schema(metadata: Mapping[str, Any]) -> Any:
    """``pyarrow.Schema`` of a run file: every field with ``unit`` and ``description``, the run's metadata beside them.

    Args:
        metadata: completed metadata (`metadata.complete_metadata`); its ``linear`` decides the unit of forces.
    """
    import pyarrow as pa

    linear = bool(metadata["linear"])
    fields = [
        pa.field(
            column.name,
            pa.from_numpy_dtype(ROW[column.name]),
            nullable=False,
            metadata={"unit": column.unit_for(linear=linear), "description": column.description},
        )
        for column in COLUMNS
    ]
    return pa.schema(fields, metadata=encode_metadata(metadata))


def rows_to_batch(rows: Rows, schema: Any) -> Any:
    """``pyarrow.RecordBatch`` of the rows: one transposing copy of the block, then views of it."""
    import pyarrow as pa

    block = np.ascontiguousarray(rows).view(np.int64).reshape(rows.size, len(_NAMES)).T.copy()
    columns = [
        pa.array(line.view(np.float64) if is_float else line) for line, is_float in zip(block, _IS_FLOAT, strict=True)
    ]
    return pa.RecordBatch.from_arrays(columns, schema=schema)
