"""An exported MCAP file back into the native run that it was: the same rows, bit for bit, with config and events."""

from __future__ import annotations

import os
from pathlib import Path

from hapticd.config import parse_config
from hapticd.record.errors import RunFileError
from hapticd.record.importing import Imported
from hapticd.record.reader import Run, median_period, read_run, time_warnings
from hapticd.record.schema import ROW, empty_rows
from hapticd.record.writer import RunWriter


def import_mcap(source: str | Path, out: str | Path, *, force: bool = False) -> Imported:
    """Read an MCAP file that hapticd exported and write it as a native run.

    Args:
        source: the file. out: the run file to write; it appears whole or not at all. force: replace a file that exists.

    Raises:
        RunFileError: the source is no such file, or lacks columns of a run; ``out`` exists.
        RecordingError: the run cannot be written; nothing is left behind.
    """
    target = Path(out)
    if target.exists() and not force:
        raise RunFileError(f"{target} exists; give another name, or --force to replace it")
    run = read_run(source)
    if missing := [name for name in ROW.names or () if name not in run.columns]:
        raise RunFileError(f"{source} has no column {', '.join(missing)}: it was not exported from a native run")
    if run.rows < 2:
        raise RunFileError(f"{source} has {run.rows} sample(s); a run needs at least 2")
    part = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        _write(run, part)
        part.replace(target)
    except OSError as error:
        raise RunFileError(f"cannot write {target}: {error.strerror or error}") from error
    finally:
        part.unlink(missing_ok=True)
    time_s, stored = run.columns["time_s"], run.metadata.get("config")
    config = parse_config(stored, f"config of {run.path.name}") if stored else None
    resolution = config.raw_resolution if config is not None else float("nan")
    position, current = run.columns["encoder_counts"] * resolution, run.columns["current_command_A"]
    period = median_period(time_s)
    return Imported(
        path=target,
        rows=run.rows,
        duration_s=float(time_s[-1]) - float(time_s[0]),
        rate_hz=1.0 / period if period > 0.0 else float("nan"),
        resolution=resolution,
        position=(float(position.min()), float(position.max())),
        command=(float(current.min()), float(current.max())),
        is_linear=bool(run.metadata.get("linear")),
        is_force=False,
        warnings=tuple(time_warnings(time_s)),
    )


def _write(run: Run, path: Path) -> None:
    rows = empty_rows(run.rows)
    for name in ROW.names or ():
        rows[name] = run.columns[name]
    with RunWriter(path, run.metadata) as writer:
        written = 0
        for event in run.events:
            row = event.get("row")
            until = min(max(row, written), rows.size) if isinstance(row, int) else written
            writer.write(rows[written:until])
            written = until
            writer.annotate({key: value for key, value in event.items() if key != "row"})
        writer.write(rows[written:])
        writer.close(complete=not run.truncated)
