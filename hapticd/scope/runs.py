"""Runs for the page: a file opened again, what is seen saved as one, and the exact simulation of a release.

All of it works on the scope's own temporary files: the process needs no right to read the daemon's recordings.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from hapticd.config import ConfigError, parse_config
from hapticd.control.json_reply import to_json
from hapticd.record import Run, RunWriter, export, read_run, run_metadata
from hapticd.record.frames import PREFIX, Context, decode, encode
from hapticd.record.run import median_period
from hapticd.record.schema import ROW, Rows, empty_rows
from hapticd.scope.forms import read_json
from hapticd.scope.theory import describe

if TYPE_CHECKING:
    from numpy.typing import NDArray

    FloatArray = NDArray[np.floating[Any]]

FRAME_ROWS = 4096
LONGEST_SIMULATION_S = 60.0
SIMULATION_CPU_S = 180
"""The first simulation on a machine compiles the servo loop, which takes a minute."""


class RunError(Exception):
    """A run cannot be opened, saved or simulated; the text is for the page."""


def open_run(content: bytes, name: str) -> bytes:
    """A run file's content as a stream for the page: first its description as JSON, then its frames.

    Args:
        content: the file.
        name: its name, of which only the kind counts.

    Raises:
        RunFileError: it is no run file.
    """
    with tempfile.TemporaryDirectory(prefix="hapticd-scope-") as folder:
        path = Path(folder) / f"run{Path(name).suffix.lower()[:8]}"
        path.write_bytes(content)
        run = read_run(path)
    return _stream(run)


def save_run(stream: bytes, label: str) -> bytes:
    """What the page sees as the content of a run file: a native one, or CSV as `hapticd export` writes it.

    Args:
        stream: first a description, a JSON object of ``format`` (``arrow`` or ``csv``), ``config`` (of the rows; null
            where it is not known), ``model`` (whether a simulation lies over them) and ``events`` (notes and markers among
            them, with the ``row``); then frames; then, with a simulation,
            its positions, a float32 each row, in coarse ticks. Each of them has its length before it.
        label: goes into the metadata.

    Raises:
        RunError: the stream is something else. ConfigError: the config is not valid.
    """
    try:
        first, *blocks = _blocks(stream)
        asked = read_json(first.decode())
        file_format, document, has_model = asked["format"], asked["config"], asked["model"]
        model = np.frombuffer(blocks.pop(), "<f4") if has_model else None
        events = [_noted(event) for event in asked["events"]]
        parts = [decode(frame) for frame in blocks]
    except (ValueError, KeyError, TypeError, IndexError) as error:
        raise RunError(f"cannot save: {error}") from error
    count = sum(len(rows) for rows, _ in parts)
    if file_format not in ("arrow", "csv") or (model is not None and model.size != count):
        raise RunError(f"cannot save: {file_format!r:.20} of {count} rows")
    with tempfile.TemporaryDirectory(prefix="hapticd-scope-") as folder:
        path = Path(folder) / "run.arrow"
        with RunWriter(path, {**_metadata(document, parts), "kind": "scope", "label": label}) as writer:
            for event in events:
                writer.annotate(event)
            for rows, _ in parts:
                writer.write(rows)
        if file_format == "csv":
            path = export(_with_model(read_run(path), model, parts), "csv")
        return path.read_bytes()


def _noted(event: dict[str, Any]) -> dict[str, Any]:
    """A note or a marker, without anything that is neither.

    Raises:
        ValueError, KeyError, TypeError: it is none.
    """
    texts = ("text",) if event["event"] == "note" else ("name", "value")
    kept = {name: event.get(name) for name in ("event", "utc", "row", "tick", *texts)}
    if event["event"] not in ("note", "marker") or not isinstance(kept["row"], int):
        raise ValueError("an event is neither a note nor a marker at a row")
    return kept


def _metadata(document: dict[str, Any] | None, parts: Sequence[tuple[Rows, Context]]) -> dict[str, Any]:
    origin: dict[str, Any] = {"origin_counts": parts[-1][1].origin_counts} if parts else {}
    if document is None:
        return origin
    config = parse_config(document, "the config of what is saved")
    driver = "seen by hapticd scope, values to four bytes"
    return run_metadata(document, linear=config.is_linear, config_digest="", driver=driver, latency_s=0.0, **origin)


def _with_model(run: Run, model: FloatArray | None, parts: Sequence[tuple[Rows, Context]]) -> Run:
    """The columns that frames carry, and the simulation where there is one: no column is empty."""
    columns = {name: values for name, values in run.columns.items() if name != "exec_ns"}
    if np.isnan(columns["current_measured_A"]).all():
        del columns["current_measured_A"]
    units = {name: unit for name, unit in run.units.items() if name in columns}
    if model is not None and parts:
        _, context = parts[-1]
        position = (columns["encoder_counts"] - context.origin_counts) / context.decimation
        columns |= {"model_ticks": model.astype(np.float64), "residual_ticks": position - model}
        units |= {"model_ticks": "ticks", "residual_ticks": "ticks"}
    return replace(run, columns=columns, units=units)


def simulate_release(document: dict[str, Any], deflection: float, duration_s: float) -> bytes:
    """The exact simulation of a release, as a stream like that of `open_run`.

    It runs in a process of its own, at low priority, so that neither its memory nor its compiler stays here.

    Raises:
        RunError: the simulation failed; the text is its own.
    """
    if not 0.0 < duration_s <= LONGEST_SIMULATION_S:
        raise RunError(f"a simulation may last up to {LONGEST_SIMULATION_S:g} s, not {duration_s:g} s")
    with tempfile.TemporaryDirectory(prefix="hapticd-scope-") as folder:
        return _simulated(Path(folder), document, deflection, ["--duration", repr(duration_s)])


def replay_release(stream: bytes) -> bytes:
    """The same, with the ticks of the release as it was recorded: the periods that it missed, and how late each tick was.

    Args:
        stream: as that of `save_run`: a description, a JSON object of ``config`` and ``deflection`` (coarse ticks), then the
            frames of the ticks in which the spring was rendered.

    Raises:
        RunError: it is something else, or the simulation failed. ConfigError: the config is not valid.
    """
    try:
        first, *blocks = _blocks(stream)
        asked = read_json(first.decode())
        document, deflection = asked["config"], float(asked["deflection"])
        parts = [decode(frame) for frame in blocks]
        lasted_s = sum(len(rows) for rows, _ in parts) * parts[0][1].period_s
    except (ValueError, KeyError, TypeError, IndexError) as error:
        raise RunError(f"cannot replay: {error}") from error
    if not 0.0 < lasted_s <= LONGEST_SIMULATION_S:
        raise RunError(f"a simulation may last up to {LONGEST_SIMULATION_S:g} s, not {lasted_s:g} s")
    with tempfile.TemporaryDirectory(prefix="hapticd-scope-") as folder:
        path = Path(folder) / "recorded.arrow"
        with RunWriter(path, {**_metadata(document, parts), "kind": "scope", "label": "release"}) as writer:
            for rows, _ in parts:
                writer.write(rows)
        return _simulated(Path(folder), document, deflection, ["--replay", str(path)])


def _simulated(folder: Path, document: dict[str, Any], deflection: float, times: list[str]) -> bytes:
    config, path = folder / "config.yaml", folder / "run.arrow"
    config.write_text(yaml.safe_dump(document))
    arguments = [sys.executable, "-m", "hapticd.cli", "simulate", str(config), "--json", "-o", str(path)]
    arguments += ["--deflection", repr(deflection), *times]
    # In time of the processor: on a busy machine it waits as long as it must.
    limits = ["prlimit", f"--cpu={SIMULATION_CPU_S}:{SIMULATION_CPU_S + 5}", "nice", "-n", "10"]
    done = subprocess.run([*limits, *arguments], capture_output=True, text=True, check=False)
    if done.returncode == -signal.SIGXCPU:
        raise RunError(f"the simulation took longer than {SIMULATION_CPU_S} s of processor time")
    if done.returncode:
        raise RunError(f"the simulation failed: {done.stderr.strip()[-500:]}")
    return _stream(read_run(path), report=json.loads(done.stdout))


def _stream(run: Run, **more: Any) -> bytes:
    view, more_warnings = _own_view(run)
    description = {
        "rows": run.rows,
        "view": view,
        "truncated": run.truncated,
        "warnings": [*run.warnings, *more_warnings],
        "events": run.events,
        "created_utc": str(run.metadata.get("created_utc", "")),
        **more,
    }
    text = to_json(description)
    return b"".join([PREFIX.pack(len(text)), text, *(PREFIX.pack(len(f)) + f for f in _encoded(run))])


def _own_view(run: Run) -> tuple[dict[str, Any], list[str]]:
    """Units, scales, config and plane of the run's own, as `theory.describe` has them; and what is wrong with them.

    A run without a config is counted in raw counts, with the unit of its force where it says one, and has no plane.
    """
    stored, warnings = run.metadata.get("config"), []
    if stored:
        try:
            latency = run.metadata.get("latency_s")
            found = describe(stored, float(latency) if isinstance(latency, int | float) else 0.0)
            return {key: found[key] for key in ("config", "scales", "units", "plane")}, []
        except ConfigError as error:
            warnings.append(f"its config is not valid: {error.problems[0]}")
    force = run.units.get("force_command") or run.units.get("force") or "N m"
    units = {"position": "counts", "velocity": "counts/s", "current": "A", "force": force}
    scales = {
        "resolution": 1.0,
        "raw_resolution": 1.0,
        "decimation": 1,
        "period_s": median_period(run.columns["time_s"]),
    }
    return {"config": None, "scales": scales, "units": units, "plane": None}, warnings


def _encoded(run: Run) -> Iterator[bytes]:
    rows = _rows(run)
    time_s = rows["time_s"]
    period = float(np.median(np.diff(time_s))) if len(rows) > 1 else 0.0
    config = run.metadata.get("config")
    encoder = config.get("encoder", {}) if isinstance(config, dict) else {}
    decimation, origin = int(encoder.get("decimation") or 1), _origin(run)
    for start in range(0, len(rows), FRAME_ROWS):
        yield encode(rows[start : start + FRAME_ROWS], Context(start, 0, decimation, period, origin, 0.0))


def _origin(run: Run) -> int:
    """Raw count of the spring's origin: what the recorder noted, else the config's, else 0."""
    noted = run.metadata.get("origin_counts")
    if isinstance(noted, int):
        return noted
    try:
        return parse_config(run.metadata.get("config", {}), run.path.name).origin_counts
    except ConfigError:
        return 0


def _rows(run: Run) -> Rows:
    """The run's columns as rows; a foreign file without ticks gets them from its row numbers."""
    rows = empty_rows(run.rows)
    for name in ROW.names or ():
        if name in run.columns:
            rows[name] = run.columns[name]
    if "tick" not in run.columns:
        rows["tick"] = np.arange(run.rows)
    if "encoder_counts" not in run.columns:
        raise RunError("this file has positions instead of encoder counts; 'hapticd import' makes a run file of it")
    if "current_measured_A" not in run.columns:
        rows["current_measured_A"] = np.nan
    return rows


def _blocks(stream: bytes) -> Iterator[bytes]:
    at = 0
    while at < len(stream):
        if at + PREFIX.size > len(stream):
            raise ValueError("it is cut short")
        size = PREFIX.unpack_from(stream, at)[0]
        at += PREFIX.size
        yield stream[at : at + size]
        at += size
