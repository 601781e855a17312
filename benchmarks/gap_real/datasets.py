"""Find the measured data, and bring them in as a user would: by `hapticd import` and a map of the columns."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from benchmarks.report import NotHereError
from hapticd.config import Config
from hapticd.gap.data import load_recording
from hapticd.gap.recording import Recording
from hapticd.record import import_run, parse_map

EMPS = "emps/DATA_EMPS.mat"
COGGING = ("odrive_cogging/nocomp_0.npy", "odrive_cogging/nocomp_1.npy")
COGGING_MAP = "odrive_cogging/cogging_measure_final_a_4_interp.npy"
VARIABLE = "HAPTICD_DATASETS"


def folder() -> Path:
    """The folder with the data sets.

    Raises:
        NotHereError: the variable is not set, or files are missing there.
    """
    named = os.environ.get(VARIABLE)
    if not named:
        raise NotHereError(f"needs measured data that are not part of the repository; name their folder in {VARIABLE}")
    missing = [name for name in (EMPS, *COGGING, COGGING_MAP) if not (Path(named) / name).is_file()]
    if missing:
        raise NotHereError(f"{VARIABLE}={named} lacks {', '.join(missing)}")
    return Path(named)


def imported(source: Path, mapping: dict[str, Any], model: Config, scratch: Path) -> Recording:
    """Import one file into ``scratch`` and load it."""
    run = scratch / f"{source.stem}.arrow"
    import_run(source, parse_map(mapping, f"map of {source.name}"), run, force=True)
    return load_recording(run, model)
