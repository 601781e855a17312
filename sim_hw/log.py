"""A device's log: true motion and current, as an Arrow IPC stream.

The compiled service writes rows into a ring in memory (:func:`sim_hw._motion.log_row`); a Python thread writes them to the
file with :class:`LogWriter`. Tests use the log as the truth.
"""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

ROW = np.dtype(
    [
        ("time_ns", np.int64),
        ("event", np.uint8),
        ("position", np.float64),
        ("velocity", np.float64),
        ("counts", np.int64),
        ("command_A", np.float64),
        ("applied_A", np.float64),
        ("code", np.int64),
        ("detail", np.int64),
    ],
    align=True,
)
"""One event. ``time_ns``: CLOCK_MONOTONIC. ``position``, ``velocity``: true, rad or m and per s. ``counts``: the true
encoder count with offset, without wrap or injected fault. ``command_A``: present decoded command. ``applied_A``:
current in the motor. ``code``, ``detail``: see ``docs/reference/simulated-hardware.md``."""

START, SAMPLE, COMMAND, ENABLE, DISABLE, WATCHDOG, FAULT_INJECTED = range(7)
EMCY, HAND, STATE, REBOOT, APPLIED, END = range(7, 13)
EVENTS = (
    *("START", "SAMPLE", "COMMAND", "ENABLE", "DISABLE", "WATCHDOG", "FAULT_INJECTED"),
    *("EMCY", "HAND", "STATE", "REBOOT", "APPLIED", "END"),
)
"""Names of the events, by number."""


class LogWriter:
    """Writes rows to a new Arrow IPC stream, which is readable up to its last complete batch.

    Args:
        path: the file; an older one is replaced.
        metadata: facts about the device, kept in the schema's metadata as text.
    """

    def __init__(self, path: Path, metadata: Mapping[str, str]) -> None:
        import pyarrow as pa

        fields = [pa.field(name, pa.from_numpy_dtype(ROW[name]), nullable=False) for name in ROW.names or ()]
        self._schema = pa.schema(fields, metadata=dict(metadata))
        self._file = path.open("wb")
        self._stream = pa.ipc.new_stream(self._file, self._schema)
        # Arrow writes the schema with the first batch, which makes the file readable.
        self._stream.write_batch(pa.RecordBatch.from_pylist([], schema=self._schema))
        self._file.flush()

    def write(self, rows: NDArray[Any]) -> None:
        """Append rows (structured, dtype ROW) as one batch."""
        import pyarrow as pa

        if rows.size:
            columns = [pa.array(np.ascontiguousarray(rows[name])) for name in ROW.names or ()]
            self._stream.write_batch(pa.RecordBatch.from_arrays(columns, schema=self._schema))
            self._file.flush()

    def close(self) -> None:
        """End the stream and the file."""
        self._stream.close()
        self._file.close()


def read_log(path: str | Path) -> NDArray[Any]:
    """All rows of a log, also of one that is still being written; no rows if nothing is on disk yet.

    Returns:
        Structured array, dtype ROW, shape (rows,), in the order of ``time_ns``.

    Raises:
        OSError: there is no such file.
        pyarrow.ArrowInvalid: it is not an Arrow stream.
    """
    import pyarrow as pa

    batches: list[Any] = []
    if Path(path).stat().st_size == 0:
        return np.zeros(0, ROW)
    with Path(path).open("rb") as file:
        stream = pa.ipc.open_stream(file)
        # The file ends in the middle of a batch: the batches before it are valid.
        with contextlib.suppress(pa.ArrowInvalid, OSError):
            batches.extend(stream)
    rows = np.zeros(sum(batch.num_rows for batch in batches), ROW)
    for name in (ROW.names or ()) if batches else ():
        rows[name] = pa.Table.from_batches(batches).column(name).to_numpy()
    return rows
