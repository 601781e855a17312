"""The simulated device's own log, read as plain Arrow: it shares no code with what wrote it.

Columns: ``docs/reference/simulated-hardware.md``.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import pyarrow as pa

from hapticd.hil.errors import HilError

if TYPE_CHECKING:
    from numpy.typing import NDArray

SAMPLE: Final = 1
COMMAND: Final = 2
FAULT_INJECTED: Final = 6


@dataclass(frozen=True)
class DeviceLog:
    """What happened at the device, row by row; times are ns of CLOCK_MONOTONIC."""

    time_ns: NDArray[np.int64]
    event: NDArray[np.uint8]
    command_A: NDArray[np.float64]
    applied_A: NDArray[np.float64]
    position: NDArray[np.float64]

    @classmethod
    def read(cls, path: Path) -> DeviceLog:
        """Read a log, as far as it was written.

        Raises:
            HilError: there is none, or nothing in it.
        """
        batches = []
        try:
            with pa.memory_map(str(path)) as source, pa.ipc.open_stream(source) as reader:
                while True:
                    try:
                        batches.append(reader.read_next_batch())
                    except (StopIteration, pa.ArrowInvalid, OSError):
                        break
                table = pa.Table.from_batches(batches, reader.schema)
                columns = {name: table[name].to_numpy() for name in cls.__dataclass_fields__}
        except (OSError, pa.ArrowInvalid, KeyError) as error:
            raise HilError(f"the simulated device's log {path} cannot be read: {error}") from error
        return cls(**columns)

    def until(self, ns: int) -> DeviceLog:
        """What was written down before an instant."""
        kept = self.time_ns < ns
        return DeviceLog(*(getattr(self, name)[kept] for name in self.__dataclass_fields__))

    def injected_ns(self) -> int | None:
        """When the first scripted fault struck, ns."""
        times = self.time_ns[self.event == FAULT_INJECTED]
        return int(times[0]) if len(times) else None

    def flows_at(self, ns: int) -> bool:
        """Whether current flowed in the motor just before an instant."""
        before = self.applied_A[self.time_ns < ns]
        return bool(len(before) and before[-1] != 0.0)

    def zero_current_after(self, ns: int) -> int | None:
        """Since when, counted from an instant, the motor's current has been zero for good; None while it flows at the end.

        The instant itself when nothing flowed after it.
        """
        flowing = np.flatnonzero(self.applied_A != 0.0)
        if len(flowing) == 0:
            return ns
        last = int(flowing[-1])
        if last + 1 == len(self.time_ns):
            return None
        return max(ns, int(self.time_ns[last + 1]))

    def sample_to_current_s(self) -> NDArray[np.float64]:
        """From each sample to the arrival of the command computed from it, s; one value for each command so answered.

        A command that does not follow a sample of its own (repeats, drops) is left out.
        """
        kept = (self.event == SAMPLE) | (self.event == COMMAND)
        event, time_ns = self.event[kept], self.time_ns[kept]
        pair = np.flatnonzero((event[:-1] == SAMPLE) & (event[1:] == COMMAND))
        return np.asarray((time_ns[pair + 1] - time_ns[pair]) * 1e-9)
