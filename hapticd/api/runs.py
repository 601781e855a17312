"""Recordings: read one, plot one or two."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from typing import TYPE_CHECKING

from hapticd.client import find_run
from hapticd.record import Run, read_run

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def load(run: str | PathLike[str] | Run) -> Run:
    """Read a recording.

    Args:
        run: a run file (``.arrow``) or an export (``.csv``, ``.parquet``, ``.mcap``); ``"@last"`` for the newest recording,
            ``"@last~1"`` for the one before; the bare name of a recording. A `Run` is returned as it is.

    Returns:
        Its columns (SI units), metadata and events.

    Raises:
        RunFileError: it is missing, empty, not a run file, or lacks a column.
    """
    return run if isinstance(run, Run) else read_run(find_run(run))


def plot(
    run: str | PathLike[str] | Run,
    other: str | PathLike[str] | Run | None = None,
    *,
    only: Sequence[str] | None = None,
    duration: float | None = None,
) -> Figure:
    """Plot a run, or two runs and their difference: the figure of ``hapticd plot``.

    Args:
        run: as for `load`.
        other: another run, plotted over it.
        only: some of ``trace phase spectrum energy lateness difference``; all that apply by default.
        duration: only this time from the start of rendering, s.

    Returns:
        A matplotlib figure.

    Raises:
        RunFileError: a run cannot be read or plotted, or two runs have no time or unit in common.
        ValueError: an unknown panel.
    """
    from hapticd.view import first_seconds, run_figure, signals

    runs = [load(each) for each in ((run,) if other is None else (run, other))]
    shown = [signals(first_seconds(each, duration) if duration else each) for each in runs]
    return run_figure(*shown, only=only)
