"""Run files: the rows of the servo loop on disk, and back. Importing this package loads no Arrow."""

from hapticd.record.errors import RecordingError, RunFileError
from hapticd.record.export import export
from hapticd.record.metadata import host_facts, run_metadata, versions
from hapticd.record.reader import Run, read_run
from hapticd.record.recorder import Recorder
from hapticd.record.schema import ROW
from hapticd.record.summary import summary
from hapticd.record.writer import RunWriter

__all__ = [
    "ROW",
    "Recorder",
    "RecordingError",
    "Run",
    "RunFileError",
    "RunWriter",
    "export",
    "host_facts",
    "read_run",
    "run_metadata",
    "summary",
    "versions",
]
