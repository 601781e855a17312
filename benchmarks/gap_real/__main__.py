"""``python -m benchmarks.gap_real``: both measured data sets, brought in as by ``hapticd import``, through the workflow.

The data are not part of the repository: the folder is found through the variable HAPTICD_DATASETS.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from benchmarks.gap_real import emps, odrive
from benchmarks.gap_real.datasets import folder
from benchmarks.report import Figure, print_table, run


def measure(quick: bool) -> list[Figure]:
    """Both data sets; ``quick`` has what nothing is searched for: the usual recipe and the free runs of the first one."""
    data = folder()
    with tempfile.TemporaryDirectory() as name:
        scratch = Path(name)
        if quick:
            recording = emps.record(data, scratch)
            return [*emps.by_recipe(recording), *emps.rigid_free_runs(recording)]
        return [*emps.measure(data, scratch), *odrive.measure(data, scratch)]


if __name__ == "__main__":
    print_table([run("gap_real", quick=False)])
