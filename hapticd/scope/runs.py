"""Runs for the page: a file opened again, what is seen saved as one, and the exact simulation of a release.

All of it works on the scope's own temporary files: the process needs no right to read the daemon's recordings.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from hapticd.config import ConfigError, parse_config
from hapticd.control.json_reply import to_json
from hapticd.record import Run, RunWriter, read_run, run_metadata
from hapticd.record.frames import PREFIX, Context, decode, encode
from hapticd.record.reader import median_period
from hapticd.record.schema import ROW, Rows, empty_rows
from hapticd.scope.theory import describe

FRAME_ROWS = 4096
LONGEST_SIMULATION_S = 60.0
SIMULATION_TIMEOUT_S = 180.0
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


def save_run(stream: bytes, document: dict[str, Any], label: str) -> bytes:
    """Frames from the page as the content of a native run file.

    Args:
        stream: frames, each with its length before it.
        document: the config under which they were made.
        label: goes into the metadata.

    Raises:
        RunError: they are no frames.
    """
    try:
        parts = [decode(frame) for frame in _frames(stream)]
    except ValueError as error:
        raise RunError(f"cannot save: {error}") from error
    config = parse_config(document, "the daemon's config")
    origin = parts[-1][1].origin_counts if parts else config.origin_counts
    metadata = run_metadata(
        document,
        linear=config.is_linear,
        config_digest="",
        driver="seen by hapticd scope, values to four bytes",
        latency_s=0.0,
        origin_counts=origin,
    )
    with tempfile.TemporaryDirectory(prefix="hapticd-scope-") as folder:
        path = Path(folder) / "run.arrow"
        with RunWriter(path, {**metadata, "kind": "scope", "label": label}) as writer:
            for rows, _ in parts:
                writer.write(rows)
        return path.read_bytes()


def simulate_release(document: dict[str, Any], deflection: float, duration_s: float) -> bytes:
    """The exact simulation of a release, as a stream like that of `open_run`.

    It runs in a process of its own, at low priority, so that neither its memory nor its compiler stays here.

    Raises:
        RunError: the simulation failed; the text is its own.
    """
    if not 0.0 < duration_s <= LONGEST_SIMULATION_S:
        raise RunError(f"a simulation may last up to {LONGEST_SIMULATION_S:g} s, not {duration_s:g} s")
    with tempfile.TemporaryDirectory(prefix="hapticd-scope-") as folder:
        config, path = Path(folder) / "config.yaml", Path(folder) / "run.arrow"
        config.write_text(yaml.safe_dump(document))
        arguments = [sys.executable, "-m", "hapticd.cli", "simulate", str(config), "--json", "-o", str(path)]
        arguments += ["--deflection", repr(deflection), "--duration", repr(duration_s)]
        try:
            done = subprocess.run(
                ["nice", "-n", "10", *arguments],
                capture_output=True,
                text=True,
                timeout=SIMULATION_TIMEOUT_S,
                check=False,
            )
        except subprocess.TimeoutExpired as error:
            raise RunError(f"the simulation took longer than {SIMULATION_TIMEOUT_S:g} s") from error
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


def _frames(stream: bytes) -> Iterator[bytes]:
    at = 0
    while at < len(stream):
        if at + PREFIX.size > len(stream):
            raise ValueError("a frame is cut short")
        size = PREFIX.unpack_from(stream, at)[0]
        at += PREFIX.size
        yield stream[at : at + size]
        at += size
