"""A run in memory, and what its time stamps are worth."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hapticd.record.metadata import to_plain
from hapticd.record.schema import COLUMNS
from hapticd.record.stream import Damage

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

_LATE = 2.5
"""Periods after which a stamp is late."""
_FEW_STEPS = 20
_AROUND = 5
_TELLS = 4.0
"""Counts by which a motion must differ with a gap and with none."""


@dataclass(frozen=True)
class Run:
    """A run in memory.

    Attributes:
        path: where it was read from.
        columns: name → values, all of shape (rows,); SI units, see ``units``.
        metadata: what the file says of itself (config, model, versions, host…); empty for a foreign file.
        units: unit of each column that is known.
        events: what was noted during the run, each with the ``row`` before which it happened.
        truncated: the recording was not ended properly (killed, disk full); the rows are those up to the cut.
        warnings: what a reader should know before trusting the run, in words.
        damage: rows that did not match their checksum and were left out (``salvage``).
    """

    path: Path
    columns: dict[str, NDArray[Any]]
    metadata: dict[str, Any] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    events: list[dict[str, Any]] = field(default_factory=list)
    truncated: bool = False
    warnings: tuple[str, ...] = ()
    damage: tuple[Damage, ...] = ()

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(next(iter(self.columns.values()), ()))

    def __repr__(self) -> str:
        return f"Run({str(self.path)!r}: {', '.join(text for _, text in self._in_words())})"

    def _repr_html_(self) -> str:
        from hapticd.figures.notebook import card, trace

        lines = [*self._in_words(), *(("warning", text) for text in self.warnings)]
        name = next((name for name in ("position", "encoder_counts", "force") if name in self.columns), None)
        unit = self.units.get(name, "count") if name else ""
        picture = trace(self.columns["time_s"], self.columns[name], unit) if name and "time_s" in self.columns else ""
        return card(str(self.path), lines, picture)

    def _in_words(self) -> list[tuple[str, str]]:
        time_s = self.columns.get("time_s", np.empty(0))
        period = median_period(time_s)
        rate = f" at {1.0 / period:.6g} Hz" if period > 0.0 else ""
        span = f", {time_s[-1] - time_s[0]:.4g} s{rate}" if len(time_s) > 1 else ""
        return [("rows", f"{self.rows} rows{span}"), ("columns", f"{len(self.columns)} columns")]

    def to_pandas(self) -> pd.DataFrame:
        """The rows as a DataFrame over ``time_s``; ``.attrs["units"]`` has the unit of each column."""
        import pandas as pd

        columns = dict(self.columns)
        index = pd.Index(columns.pop("time_s"), name="time_s")
        frame = pd.DataFrame(columns, index)
        frame.attrs = {"units": dict(self.units), "run": str(self.path)}
        return frame

    def to_xarray(self) -> xr.Dataset:
        """The rows as a Dataset over ``time_s``, each variable with ``units`` and ``long_name`` where they are known.

        Raises:
            ImportError: xarray is not installed.
        """
        try:
            import xarray as xr
        except ImportError as error:
            raise ImportError("Run.to_xarray needs xarray: pip install 'hapticd[xarray]'") from error

        known = {name: {"units": unit} for name, unit in self.units.items()}
        for column in COLUMNS:
            known.setdefault(column.name, {})["long_name"] = column.description
        data = {name: ("time_s", values, known.get(name, {})) for name, values in self.columns.items()}
        # netCDF knows text and numbers only: what is nested goes as JSON, as in the run file itself
        texts = {
            key: text if isinstance(text, str) else json.dumps(to_plain(text)) for key, text in self.metadata.items()
        }
        return xr.Dataset(data, attrs={"run": str(self.path), **texts})


def median_period(time_s: NDArray[Any]) -> float:
    """Median of the periods between time stamps, s; NaN where there is none."""
    with np.errstate(over="ignore", invalid="ignore"):
        return float(np.median(np.diff(time_s))) if len(time_s) > 1 else float("nan")


def time_warnings(time_s: NDArray[Any], position: NDArray[Any] | None = None) -> list[str]:
    """What is wrong with time stamps, in words; by the position, in counts, a clock that was set is told from lost rows."""
    found = []
    if not np.all(np.isfinite(time_s)):
        found.append("time_s holds values that are not finite")
    if (back := np.flatnonzero(time_s[1:] <= time_s[:-1])).size:
        found.append(f"time_s does not rise at {back.size} place(s), first at row {back[0] + 1}")
    if position is not None and not found:
        found += [
            f"the clock steps by {1e3 * step:+.3g} ms at row {row}: the motion goes on as in one period"
            for row, step in clock_steps(time_s, position)
        ]
    return found


def clock_steps(time_s: NDArray[Any], position: NDArray[Any]) -> list[tuple[int, float]]:
    """Rows before which the clock was set, and by how much, s: the stamps jump, and the motion goes on as in one period.

    Args:
        time_s: rising stamps, (n,). position: in units of its resolution, or finer, (n,).
    """
    steps = np.diff(time_s)
    period = float(np.median(steps)) if steps.size else 0.0
    late = np.flatnonzero(steps > _LATE * period)
    found = []
    for at in late if late.size <= _FEW_STEPS else ():
        if not _AROUND < at < steps.size - _AROUND:
            continue
        before = (position[at] - position[at - _AROUND]) / (time_s[at] - time_s[at - _AROUND])
        after = (position[at + 1 + _AROUND] - position[at + 1]) / (time_s[at + 1 + _AROUND] - time_s[at + 1])
        speed, moved = 0.5 * (before + after), position[at + 1] - position[at]
        as_gap, as_period = abs(moved - speed * steps[at]), abs(moved - speed * period)
        if abs(speed) * (steps[at] - period) > _TELLS and as_period < 0.25 * as_gap:
            found.append((int(at) + 1, float(steps[at]) - period))
    return found
