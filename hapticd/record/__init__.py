"""Run files: the rows of the servo loop on disk, and back. Importing this package loads no Arrow."""

from hapticd.record._importing import Imported, import_run
from hapticd.record._importing_mcap import import_mcap
from hapticd.record._reader import read_run, verify
from hapticd.record.errors import RecordingError, RunFileError
from hapticd.record.export import export
from hapticd.record.importing_map import ImportMap, load_map, parse_map
from hapticd.record.metadata import host_facts, run_metadata, versions
from hapticd.record.recorder import Recorder
from hapticd.record.run import Run
from hapticd.record.schema import FLAG_MISSED_EXCHANGE, ROW
from hapticd.record.writer import RunWriter

__all__ = [
    "FLAG_MISSED_EXCHANGE",
    "ROW",
    "ImportMap",
    "Imported",
    "Recorder",
    "RecordingError",
    "Run",
    "RunFileError",
    "RunWriter",
    "export",
    "host_facts",
    "import_mcap",
    "import_run",
    "load_map",
    "parse_map",
    "read_run",
    "run_metadata",
    "verify",
    "versions",
]
