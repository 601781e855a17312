"""The drive's own log: the columns of docs/reference/simulated-hardware.md, an Arrow stream that is readable as it grows."""

from __future__ import annotations

import time
from pathlib import Path

import pyarrow as pa

from tests.drivers.other_drive.axis import Axis

_SCHEMA = pa.schema(
    [
        ("time_ns", pa.int64()),
        ("event", pa.uint8()),
        *((name, pa.float64()) for name in ("position", "velocity")),
        ("counts", pa.int64()),
        *((name, pa.float64()) for name in ("command_A", "applied_A")),
        *((name, pa.int64()) for name in ("code", "detail")),
    ]
)
_BATCH_S = 0.05


class Book:
    """Rows are kept in memory and written every 50 ms.

    Args:
        path: the file; None: nothing is kept.
    """

    def __init__(self, path: Path | None) -> None:
        self._rows: list[tuple[float, ...]] = []
        self._written_s = time.monotonic()
        self._file = None if path is None else path.open("wb")
        self._stream = None if self._file is None else pa.ipc.new_stream(self._file, _SCHEMA)
        self._flush()

    def write(self, now_ns: int, event: int, axis: Axis, target: float, code: int, detail: int) -> None:
        """One row."""
        if self._stream is None:
            return
        self._rows.append((now_ns, event, axis.angle, axis.speed, axis.true_counts, target, axis.current, code, detail))

    def turn(self) -> None:
        """Write what has been kept for 50 ms."""
        if self._rows and time.monotonic() - self._written_s > _BATCH_S:
            self._flush()

    def _flush(self) -> None:
        if self._stream is None or self._file is None:
            return
        columns = list(zip(*self._rows, strict=True)) or [()] * len(_SCHEMA)
        arrays = [pa.array(column, field.type) for column, field in zip(columns, _SCHEMA, strict=True)]
        self._stream.write_batch(pa.RecordBatch.from_arrays(arrays, schema=_SCHEMA))
        self._file.flush()
        self._rows, self._written_s = [], time.monotonic()

    def close(self) -> None:
        """Write what is left."""
        self._flush()
        if self._stream is not None and self._file is not None:
            self._stream.close()
            self._file.close()
            self._stream = None
