"""An exported MCAP file back into the native run that it was: the same rows, bit for bit, with config and events."""

from __future__ import annotations

from pathlib import Path

from hapticd.config import parse_config
from hapticd.figures.files import refuse_existing
from hapticd.record._importing import Imported, imported
from hapticd.record._reader import read_run
from hapticd.record.errors import RunFileError
from hapticd.record.files import written
from hapticd.record.schema import ROW, empty_rows
from hapticd.record.writer import RunWriter


def import_mcap(source: str | Path, out: str | Path, *, force: bool = False) -> Imported:
    """Read an MCAP file that hapticd exported and write it as a native run.

    Args:
        source: the file. out: the run file to write; it appears whole or not at all. force: replace a file that exists.

    Raises:
        RunFileError: the source is no such file, or lacks columns of a run.
        FileExistsError: ``out`` exists, or is the source.
        RecordingError: the run cannot be written; nothing is left behind.
    """
    target = Path(out)
    refuse_existing(target, force=force, source=Path(source))
    run = read_run(source)
    if missing := [name for name in ROW.names or () if name not in run.columns]:
        raise RunFileError(f"{source} has no column {', '.join(missing)}: it was not exported from a native run")
    if run.rows < 2:
        raise RunFileError(f"{source} has {run.rows} sample(s); a run needs at least 2")
    rows = empty_rows(run.rows)
    for name in ROW.names or ():
        rows[name] = run.columns[name]
    with written(target) as part, RunWriter(part, run.metadata) as writer:
        for event in run.events:
            writer.annotate(event)
        writer.write(rows)
        writer.close(complete=not run.truncated)
    stored = run.metadata.get("config")
    resolution = parse_config(stored, f"config of {run.path.name}").raw_resolution if stored else float("nan")
    return imported(target, run.columns, resolution, is_linear=bool(run.metadata.get("linear")), is_force=False)
