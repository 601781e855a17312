"""What a loaded soak is judged by: every period of many recordings, and counts that must not grow."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Final

import numpy as np

from hapticd.record import read_run
from hapticd.record.schema import FLAG_MISSED_EXCHANGE, FLAG_MISSED_PERIOD

if TYPE_CHECKING:
    from numpy.typing import NDArray

_WINDOW: Final = 0.1
_SUMMARY: Final = re.compile(r"^ticks +(\d+), missed periods (\d+).*?^recorded +(\d+) rows, (\d+) dropped", re.M | re.S)
_KEPT: Final = re.compile(r"the disk is full .*; (\d+) rows are kept in ")


@dataclass(frozen=True)
class Totals:
    """What the daemon says in its last words."""

    ticks: int
    missed: int
    rows: int
    dropped: int

    @classmethod
    def of(cls, words: str) -> Totals:
        """From what it printed."""
        found = _SUMMARY.search(words)
        assert found, f"the daemon did not end as it should; its last words:\n{words[-2000:]}"
        return cls(*(int(number) for number in found.groups()))


@dataclass(frozen=True)
class Segment:
    """One recording of many: its rows against its own tick column and against what the daemon said of it."""

    first: int
    last: int
    rows: int
    missed_in_a_row: int
    unmarked: int
    backwards: int
    dropped: int
    exchanges_missed: int
    rows_differ: int
    settings: int
    """Changes that the file tells of."""

    @property
    def missed(self) -> int:
        """Periods without a row that were not dropped."""
        return self.last - self.first + 1 - self.rows - self.dropped

    @classmethod
    def of(
        cls, tick: NDArray[np.int64], flags: NDArray[np.int64], claimed: int, dropped: int = 0, settings: int = 0
    ) -> Segment:
        """From the columns of a file with one row at least; ``claimed`` rows are in it, as the daemon says.

        The next row after a gap says so, and no other.
        """
        steps = np.diff(tick)
        return cls(
            first=int(tick[0]),
            last=int(tick[-1]),
            rows=len(tick),
            missed_in_a_row=int(steps.max(initial=1)) - 1,
            unmarked=int(np.count_nonzero(((flags[1:] & FLAG_MISSED_PERIOD) != 0) != (steps > 1))),
            backwards=int(np.count_nonzero(steps < 1)),
            dropped=dropped,
            exchanges_missed=int(((flags & FLAG_MISSED_EXCHANGE) != 0).sum()),
            rows_differ=abs(len(tick) - claimed),
            settings=settings,
        )

    @classmethod
    def read(cls, path: Path, claimed: int, dropped: int) -> Segment | None:
        """From a file; None where not one row of it reached the disk, and the daemon says so."""
        run = read_run(path)
        if not run.rows and not claimed:
            return None
        settings = sum(event["event"] == "set" for event in run.events)
        return cls.of(run.columns["tick"], run.columns["flags"], claimed, dropped, settings)


def kept_rows(error: str | None) -> int | None:
    """Rows that a recording kept which a full disk ended, as the daemon says; None where that is not what it says."""
    found = _KEPT.search(error or "")
    return int(found[1]) if found else None


def balance(segments: Sequence[Segment], totals: Totals) -> dict[str, int]:
    """All recordings of one daemon against its last words; the last of them went on to its last tick.

    Returns:
        ``periods`` since the daemon's first tick, tick 0; ``rows`` on record; ``missed`` of the recorded periods;
        ``between`` the recordings, where there is no row: periods that are known by the daemon's counters alone;
        ``missed_in_a_row`` at most. What must be 0: ``unaccounted``, periods that the daemon counted neither as done nor as
        missed, or as missed more or fewer than the recordings leave room for; ``unmarked`` and ``backwards`` of the
        recordings, and recordings that overlap; ``rows_differ``, rows that are not on file as counted.
    """
    between = segments[0].first + sum(after.first - before.last - 1 for before, after in pairwise(segments))
    rows = sum(one.rows for one in segments)
    missed = sum(one.missed for one in segments)
    elsewhere = totals.missed - missed
    return {
        "periods": segments[-1].last + 1,
        "rows": rows,
        "missed": missed,
        "between": between,
        "missed_in_a_row": max(one.missed_in_a_row for one in segments),
        "unaccounted": abs(segments[-1].last + 1 - totals.ticks - totals.missed)
        + max(0, -elsewhere)
        + max(0, elsewhere - between),
        "unmarked": sum(one.unmarked for one in segments),
        "backwards": sum(one.backwards for one in segments)
        + sum(after.first <= before.last for before, after in pairwise(segments)),
        "rows_differ": abs(rows - totals.rows) + sum(one.rows_differ for one in segments),
    }


@dataclass(frozen=True)
class Sample:
    """One look at a daemon's process: resident bytes, open files, threads."""

    at_s: float
    resident: int
    files: int
    threads: int

    @classmethod
    def of(cls, at_s: float, process: int) -> Sample:
        """Look now; memory page by page, since the kernel's cheaper figures lag by hundreds of kilobytes."""
        folder = Path(f"/proc/{process}")
        found = re.search(r"^Rss: +(\d+) kB", (folder / "smaps_rollup").read_text(), re.M)
        assert found is not None
        files, threads = (sum(1 for _ in (folder / name).iterdir()) for name in ("fd", "task"))
        return cls(at_s, int(found[1]) * 1024, files, threads)


def _ends(samples: Sequence[Sample], settled_s: float) -> tuple[Sequence[Sample], Sequence[Sample]]:
    """The first and the last tenth of what comes after the daemon has settled."""
    settled = [one for one in samples if one.at_s >= settled_s]
    count = max(1, round(_WINDOW * len(settled)))
    return settled[:count], settled[-count:]


def growth(samples: Sequence[Sample], settled_s: float) -> dict[str, float]:
    """From the first to the last tenth of a soak, once settled; NaN where it was too short for that.

    Returns:
        By the medians: what an episode has opened is closed again after it, and so is a recording while the next begins.
        ``resident`` is memory in MB, ``files`` and ``threads`` are counts.
    """
    first, last = _ends(samples, settled_s)
    if len(first) + len(last) < 4:
        return dict.fromkeys(("resident", "files", "threads"), float("nan"))
    return {
        "resident": (median(one.resident for one in last) - median(one.resident for one in first)) / 1e6,
        "files": float(median(one.files for one in last) - median(one.files for one in first)),
        "threads": float(median(one.threads for one in last) - median(one.threads for one in first)),
    }


@dataclass
class SeenFault:
    """A fault, from when it was seen until the spring is rendered again."""

    code: str
    cause: str
    seen_s: float
    others: float
    """Share of one processor that others took then; in a burst it is one of them."""
    over_s: float | None = None
    explained_by: str | None = None
