"""Run by path, with another tree on PYTHONPATH: that tree's workflow on one case, its answer as JSON on stdout.

Imports nothing of this repository, so that only the tree's ``hapticd`` is ever loaded.
"""

from __future__ import annotations

import ctypes
import json
import resource
import signal
import sys
import time
from pathlib import Path

_PR_SET_PDEATHSIG = 1


def main(folder: Path, tree: Path, limit_s: int, excluded: list[str]) -> None:
    """Find, and print. The time is that of the call alone: imports and start are no part of what is compared."""
    if limit_s:
        resource.setrlimit(resource.RLIMIT_CPU, (limit_s, limit_s + 5))
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    import hapticd

    if tree not in Path(hapticd.__file__).parents:
        raise RuntimeError(f"{hapticd.__file__} is not of {tree}")
    from hapticd.config import EFFECT_SLUGS, load_config
    from hapticd.gap import find_gap
    from hapticd.gap.data import load_recording

    begin, processor_begin = time.perf_counter(), time.process_time()
    model = load_config(folder / "model.yaml")
    recording = load_recording(next(folder.glob("run.*")), model)
    candidates = [slug for slug in EFFECT_SLUGS if slug not in excluded] if excluded else None
    found = find_gap([recording], model, candidates=candidates, seed=0, design=False).to_json()
    found["wall_s"] = time.perf_counter() - begin
    found["processor_s"] = time.process_time() - processor_begin
    found["peak_memory_MB"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    print(json.dumps(found))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]), sys.argv[4:])
