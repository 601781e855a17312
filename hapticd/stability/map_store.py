"""Region maps on disk: one self-describing ``.npz``, updated during the computation, which a later run can continue.

Arrays: ``beta`` (delays, β), ``sigma`` (σ,), ``tau_d`` (delays,), ``xi_dot_0`` (velocities,), and of shape (delays,
velocities, β, σ): ``done`` and the fields of `maps.POINT`. ``metadata`` is a JSON text. Nothing is pickled.
"""

from __future__ import annotations

import contextlib
import json
import time
import zipfile
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np

from hapticd.figures.files import atomic_write
from hapticd.record.metadata import versions
from hapticd.stability.map_engines import Results
from hapticd.stability.maps import POINT, Chunk, Maps, Study
from hapticd.stability.outcome import OUTCOMES
from hapticd.stability.sampled_loop import ESCAPED, HORIZON, LEFT, RECURRED, REST

#: Changes when the meaning of a stored number does; maps of another format are not continued.
FORMAT: Final = 2

_REASONS = {"rest": REST, "recurred": RECURRED, "escaped": ESCAPED, "left": LEFT, "horizon": HORIZON}
# Each write stores the whole study: at most this many seconds of work, or multiples of the writing time, are lost in a power
# cut (nothing on Ctrl-C).
_SAVE_EVERY_S: Final = 5.0
_SAVE_FACTOR: Final = 20.0


class MapFileError(Exception):
    """A file of maps cannot be read, or contains other maps than requested."""


def metadata(study: Study) -> dict[str, Any]:
    """The metadata of the file."""
    return {
        "what": "hapticd region maps",
        "format": FORMAT,
        "study": asdict(study),
        "outcomes": list(OUTCOMES),
        "reasons": _REASONS,
        "units": {"xi": "ticks", "xi_dot": "ticks/period", "amplitude": "ticks", "omega": "rad/period"},
        "versions": versions(),
    }


def save(path: Path, maps: Maps) -> None:
    """Write the maps atomically, through a temporary file in the same folder."""
    study = maps.study
    arrays = {
        "beta": np.array([study.betas(tau_d) for tau_d in study.delays]),
        "sigma": study.sigmas,
        "tau_d": np.array(study.delays),
        "xi_dot_0": np.array(study.velocities),
        "done": maps.done,
        "metadata": np.array(json.dumps(metadata(study), ensure_ascii=False)),
        **{name: maps.points[name] for name in POINT.names or ()},
    }
    with atomic_write(path) as part, part.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)


def load(path: Path) -> Maps:
    """Read maps, finished or not.

    Raises:
        MapFileError: it is not a file of maps, or has another format.
        OSError: it cannot be read.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            found = json.loads(str(file["metadata"]))
            if found["format"] != FORMAT:
                raise MapFileError(f"{path} has maps of format {found['format']}, this version reads {FORMAT}")
            text = found["study"]
            study = Study(**{**text, "delays": tuple(text["delays"]), "velocities": tuple(text["velocities"])})
            maps = Maps(study)
            maps.done[...] = file["done"]
            for name in POINT.names or ():
                maps.points[name] = file[name]
    except (KeyError, ValueError, TypeError, EOFError, zipfile.BadZipFile) as error:
        raise MapFileError(f"{path} is not a file of region maps") from error
    return maps


def begin(path: Path, study: Study, *, force: bool = False) -> Maps:
    """The maps to compute: those of the file if they are of this study, else new ones.

    Raises:
        MapFileError: the file contains something else, and ``force`` is not set.
    """
    if force or not path.exists():
        return Maps(study)
    maps = load(path)
    if maps.study != study:
        asked, has = asdict(study), asdict(maps.study)
        different = ", ".join(f"{name} {has[name]}" for name in asked if asked[name] != has[name])
        raise MapFileError(f"{path} contains maps made with other options ({different})")
    return maps


def fill(
    maps: Maps,
    engine: Callable[[list[Chunk]], Results],
    path: Path | None,
    progress: Callable[[float], None] | None = None,
) -> None:
    """Compute the missing chunks and update the file; after any interruption the finished chunks are in the file.

    Args:
        maps: filled in place.
        engine: takes the missing chunks and yields their results as they arrive.
        path: the file; None keeps the maps in memory only.
        progress: called with the fraction done.
    """
    missing = maps.missing()
    if not missing:
        return
    left = sum(chunk.stop - chunk.start for chunk in missing)
    due, unsaved = time.monotonic() + _SAVE_EVERY_S, False
    try:
        with contextlib.closing(engine(missing)) as results:
            for chunk, points in results:
                maps.put(chunk, points)
                unsaved = True
                left -= chunk.stop - chunk.start
                if progress is not None:
                    progress(1.0 - left / maps.study.size)
                if path is not None and (begun := time.monotonic()) > due:
                    save(path, maps)
                    ended = time.monotonic()
                    due, unsaved = ended + max(_SAVE_EVERY_S, _SAVE_FACTOR * (ended - begun)), False
    finally:
        if path is not None and unsaved:
            save(path, maps)
