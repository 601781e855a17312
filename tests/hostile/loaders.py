"""Every door through which a file comes in: what reads it, what it may raise, and what valid files look like."""

from __future__ import annotations

import functools
import random
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from drivers import DriverConfigError
from drivers.canopen.eds import load_eds
from drivers.canopen.profile import FOLDER, load_profile
from hapticd.config import ConfigError, config_digest, config_to_yaml, load_config, parse_yaml
from hapticd.config.presets import PRESETS
from hapticd.record import (
    RecordingError,
    RunFileError,
    RunWriter,
    export,
    import_mcap,
    import_run,
    load_map,
    read_run,
    run_metadata,
    verify,
)
from hapticd.record.flight import FlightRing, dead
from hapticd.record.listing import listed
from hapticd.record.schema import empty_rows
from hapticd.servo.experiment import read_experiment
from sim_hw.script import load_script
from tests.hostile import forging
from tests.hostile.mutation import mutated, mutated_text

ROOT: Final = Path(__file__).parents[2]
_FORGED: Final = 0.3
"""Share of the cases that are forged, where a loader has a forger."""

MAP: Final = """\
# A log of some other controller.
device: rotary
time: {column: t, unit: ms}
position: {column: x, unit: deg, resolution: 0.1, factor: 1.0, offset: 0.5, sign: -1}
current: {column: i, unit: mA}
current_measured: {column: m}
torque_constant: 0.0292
encoder: {counts_per_rev: 8192}
csv: {delimiter: ",", decimal: ".", header: true, skip_lines: 1}
from_s: 0.0
until_s: 0.5
every: 2
"""
_PLAIN_MAP: Final = """\
device: rotary
csv: {skip_lines: 1}
time: {rate_hz: 1000}
position: {column: 1, unit: rad, resolution: 0.001}
current: {column: 2}
"""
_NAMED_MAP: Final = """\
device: linear
csv: {skip_lines: 1}
time: {column: t}
position: {column: x, resolution: 1.0e-6}
force: {column: i}
torque_constant: 2
"""
EXPERIMENT: Final = """\
excitation: chirp
amplitude: 0.4        # A
duration_s: 8
low_hz: 5
high_hz: 200
seed: 3
settings: {spring.stiffness: 0.004, encoder.decimation: 2, dither.target: none}
"""
SCRIPT: Final = """\
start: {position: 0.1, counts_offset: 5}
hand:
  - {at_s: 0.5, force: 0.01}
  - {at_s: 1.0, force: 0}
faults:
  - {kind: drop, at_s: 1, count: 5}
  - {kind: silent, at_s: 2}
"""


@dataclass(frozen=True)
class Loader:
    """One door.

    Attributes:
        name: of it. suffix: of its files. load: reads a file. errors: the project's own classes that it may raise.
        samples: makes valid files. mutate: makes an input of a valid file. forge: makes one that is well formed and lies.
    """

    name: str
    suffix: str
    load: Callable[[Path], Any]
    errors: tuple[type[Exception], ...]
    samples: Callable[[], list[bytes]]
    mutate: Callable[[random.Random, bytes, Sequence[bytes]], bytes] = mutated
    forge: Callable[[random.Random], bytes] | None = None

    def case(self, seed: int, number: int) -> bytes:
        """Input ``number`` of a seed."""
        chance = random.Random(f"{seed} {self.name} {number}")
        samples = _samples(self)
        if self.forge is not None and chance.random() < _FORGED:
            data = self.forge(chance)
            return data if chance.random() < 0.5 else self.mutate(chance, data, samples)
        return self.mutate(chance, chance.choice(samples), samples)


@functools.cache
def _samples(loader: Loader) -> list[bytes]:
    return loader.samples()


def _config(path: Path) -> None:
    """A config that is accepted can be written, and is read as it was."""
    config = load_config(path)
    assert config_digest(parse_yaml(config_to_yaml(config), "its copy")) == config_digest(config)


def _run(path: Path) -> None:
    listed(path)
    run = read_run(path, salvage=True)
    assert all(values.shape == (run.rows,) for values in run.columns.values())
    assert all(isinstance(event, dict) for event in run.events)
    assert all(isinstance(unit, str) for unit in run.units.values())
    verify(path)


def _table(path: Path) -> None:
    run = read_run(path)
    assert all(values.shape == (run.rows,) for values in run.columns.values())
    assert all(isinstance(event, dict) for event in run.events)


def _mcap(path: Path) -> None:
    import_mcap(path, path.with_name("imported.arrow"), force=True)


def _import_with(text: str) -> Callable[[Path], None]:
    def load(path: Path) -> None:
        mapping = path.with_name("map.yaml")
        if not mapping.exists():
            mapping.write_text(text)
        import_run(path, load_map(mapping), path.with_name("imported.arrow"), force=True)

    return load


def _map(path: Path) -> None:
    table = path.with_name(f"table-of-{path.stem}.csv")
    if not table.exists():
        table.write_bytes(_tables("csv")[0])
    import_run(table, load_map(path), path.with_name("imported.arrow"), force=True)


def _flight(path: Path) -> None:
    with dead(path) as found:
        assert found is not None


def _eds(path: Path) -> None:
    load_eds(path, 5)


def _profile(path: Path) -> None:
    load_profile(str(path))


def _texts(folder: Path, pattern: str) -> list[bytes]:
    return [path.read_bytes() for path in sorted(folder.glob(pattern))]


def _configs() -> list[bytes]:
    return _texts(PRESETS, "*.yaml") + _texts(ROOT / "examples", "*.yaml")


def _models() -> list[bytes]:
    ripple = "{name: torque_ripple, orders: [7, 14], amplitudes: [0.001, 2.0e-4]}"
    effects = f"plant: {{effects: [{{name: stribeck, s: 0.4, omega_s: 3}}, {ripple}]}}\n"
    shipped = _texts(ROOT / "examples/missing_effect", "[ms]*.yaml")
    return [*shipped, effects.encode(), config_to_yaml(load_config(None)).encode()]


def _rows(count: int) -> Any:
    rows = empty_rows(count)
    rows["tick"] = np.arange(count)
    rows["time_s"] = rows["tick"] / 1000.0
    rows["encoder_counts"] = 3 * rows["tick"]
    rows["current_measured_A"] = np.nan
    return rows


def _write_run(folder: Path, count: int = 40) -> Path:
    path = folder / "run.arrow"
    config = load_config(None).model_dump(mode="json")
    with RunWriter(path, run_metadata(config, kind="run", label="sample")) as writer:
        for _batch in range(3):
            writer.annotate({"event": "set", "changed": {"spring.stiffness": 0.01}})
            writer.write(_rows(count))
            writer.flush()
    return path


def _folder() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="hapticd-hostile-")


def _run_file(count: int) -> bytes:
    with _folder() as folder:
        return _write_run(Path(folder), count).read_bytes()


def _runs() -> list[bytes]:
    return [_run_file(count) for count in (1, 40)]


def _old_runs() -> list[bytes]:
    import pyarrow as pa

    table = pa.ipc.open_stream(_run_file(40)).read_all()
    sink = pa.BufferOutputStream()
    schema = table.schema.with_metadata(
        {"hapticd.format_version": "1", "hapticd.linear": "false", "hapticd.kind": '"run"'}
    )
    with pa.ipc.new_stream(sink, schema) as stream:
        for batch in table.to_batches():
            stream.write_batch(batch.replace_schema_metadata(schema.metadata), custom_metadata={"hapticd.events": "[]"})
    return [sink.getvalue().to_pybytes()]


def _exported(kind: str) -> list[bytes]:
    found = []
    for count in (2, 40):
        with _folder() as folder:
            found.append(export(read_run(_write_run(Path(folder), count)), kind).read_bytes())
    return found


def _tables(kind: str) -> list[bytes]:
    """Measured data from elsewhere."""
    import io

    import pyarrow as pa
    import pyarrow.parquet as pq
    from scipy.io import savemat

    time_s = np.arange(50) / 1000.0
    columns = {"t": time_s, "x": np.sin(time_s), "i": np.cos(time_s), "m": np.zeros(50)}
    sink = io.BytesIO()
    if kind == "csv":
        rows = zip(*columns.values(), strict=True)
        sink.write(b"a line before\n" + ",".join(columns).encode() + b"\n")
        sink.write("\n".join(",".join(f"{value:.6g}" for value in row) for row in rows).encode() + b"\n")
    elif kind == "npy":
        np.save(sink, np.array(list(columns.values())))
    elif kind == "parquet":
        pq.write_table(pa.table(columns), sink)
    else:
        savemat(sink, {**columns, "s": {"t": time_s}, "text": "words"}, do_compression=kind == "mat")
    return [sink.getvalue()]


def _flights() -> list[bytes]:
    with _folder() as folder:
        ring = FlightRing.create(Path(folder), "sample", 64, words=4)
        ring.describe({"config": {}, "kind": "run"})
        ring.rows[:40] = _rows(40)
        ring.shared[0] = 40
        ring.leave()
        return [ring.path.read_bytes()]


_IMPORT: Final = (RunFileError, ConfigError, RecordingError)
LOADERS: Final = (
    Loader("config", ".yaml", _config, (ConfigError,), _configs, mutated_text),
    Loader("model", ".yaml", _config, (ConfigError,), _models, mutated_text),
    Loader(
        "experiment",
        ".yaml",
        read_experiment,
        (ConfigError,),
        lambda: [EXPERIMENT.encode(), *_texts(ROOT / "examples/missing_effect", "first.yaml")],
        mutated_text,
    ),
    Loader(
        "script",
        ".yaml",
        lambda path: load_script(path, "serial"),
        (ConfigError,),
        lambda: [SCRIPT.encode()],
        mutated_text,
    ),
    Loader("run", ".arrow", _run, (RunFileError,), _runs, forge=forging.run_file),
    Loader("run-v1", ".arrow", _run, (RunFileError,), _old_runs),
    Loader("csv", ".csv", _table, (RunFileError,), lambda: _exported("csv"), mutated_text, forging.csv_file),
    Loader("parquet", ".parquet", _table, (RunFileError,), lambda: _exported("parquet"), forge=forging.parquet_file),
    Loader("mcap", ".mcap", _mcap, _IMPORT, lambda: _exported("mcap")),
    Loader("flight", ".flight", _flight, (RunFileError,), _flights),
    Loader("eds", ".eds", _eds, (DriverConfigError,), lambda: _texts(FOLDER, "*.eds"), mutated_text),
    Loader("profile", ".yaml", _profile, (DriverConfigError,), lambda: _texts(FOLDER, "*.yaml"), mutated_text),
    Loader("map", ".yaml", _map, _IMPORT, lambda: [t.encode() for t in (MAP, _PLAIN_MAP, _NAMED_MAP)], mutated_text),
    Loader("import-csv", ".csv", _import_with(MAP), _IMPORT, lambda: _tables("csv"), mutated_text),
    Loader("import-npy", ".npy", _import_with(_PLAIN_MAP), _IMPORT, lambda: _tables("npy"), forge=forging.npy_file),
    Loader(
        "import-parquet",
        ".parquet",
        _import_with(_NAMED_MAP),
        _IMPORT,
        lambda: _tables("parquet"),
        forge=forging.parquet_file,
    ),
    Loader(
        "import-mat",
        ".mat",
        _import_with(_NAMED_MAP),
        _IMPORT,
        lambda: _tables("mat") + _tables("mat-plain"),
        forge=forging.mat_file,
    ),
)
