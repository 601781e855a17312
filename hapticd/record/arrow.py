"""Rows to Arrow and back: the schema with its units and metadata, and record batches without a copy per value.

pyarrow is imported in the functions, so that ``import hapticd.record`` stays cheap for the command line.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hapticd.record.metadata import encode_metadata
from hapticd.record.schema import COLUMNS, ROW, Rows
from hapticd.record.stream import METADATA_CHECK, metadata_checksum

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
    schema = pa.schema(fields, metadata=encode_metadata(metadata))
    return schema.with_metadata({**schema.metadata, METADATA_CHECK: metadata_checksum(schema)})


def rows_to_block(rows: Rows) -> NDArray[np.int64]:
    """The rows column by column, shape (columns, n), each value as its eight bytes: one transposing copy."""
    return np.ascontiguousarray(rows).view(np.int64).reshape(rows.size, len(_NAMES)).T.copy()


def block_to_batch(block: NDArray[np.int64], schema: Any) -> Any:
    """``pyarrow.RecordBatch`` of views of a block."""
    import pyarrow as pa

    columns = [
        pa.array(line.view(np.float64) if is_float else line) for line, is_float in zip(block, _IS_FLOAT, strict=True)
    ]
    return pa.RecordBatch.from_arrays(columns, schema=schema)
