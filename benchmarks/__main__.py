"""``python -m benchmarks [NAME…] [--quick] [--json DIR]``: run benchmarks, print one table, write one JSON file each.

Each runs in a process of its own, so that what one leaves behind (locked memory, threads, warm caches) cannot help or
hurt the next. A missed goal is shown and does not fail; a benchmark that could not be run, twice, does. One that needs
what this machine lacks is left out, with the reason.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path

from benchmarks.report import print_table, progress

NAMES = (
    "lateness", "flood", "tick", "guard", "estop", "simulate", "plant_propagation", "maps", "cycles", "recorder",
    "ring_store", "scope", "serial_roundtrip", "hold", "gap_speed", "gap_real", "identify",
)  # fmt: skip
_CHILD = "import sys; from benchmarks.report import run_to_file; run_to_file(sys.argv[1:])"


def main() -> int:
    """Run what was asked for; 1 when one of them could not be run."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(NAMES)}; default: all")
    parser.add_argument("--quick", action="store_true", help="short trials: right in kind, wide in scatter")
    parser.add_argument("--json", type=Path, metavar="DIR", default=Path(__file__).parent / "results")
    options = parser.parse_args()
    if unknown := [name for name in options.names if name not in NAMES]:
        parser.error(f"no benchmark is called {', '.join(unknown)}; there are {', '.join(NAMES)}")

    folder = options.json.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    done, failed = [], []
    for name in options.names or NAMES:
        begin = time.monotonic()
        path = folder / f"{name}.json"
        command = [sys.executable, "-c", _CHILD, name, str(path), *(["quick"] * options.quick)]
        progress(f"── {name}")
        # A machine that was busy for a moment is no benchmark that cannot be run: twice is.
        if any(
            subprocess.run(command, cwd=Path(__file__).parent.parent, check=False).returncode == 0 for _ in range(2)
        ):
            done.append(json.loads(path.read_text()))
        else:
            failed.append(name)
        progress(f"   {time.monotonic() - begin:.0f} s")
    print_table(one for one in done if one["figures"])
    for one in done:
        if "skipped" in one:
            progress(f"left out: {one['benchmark']}: {one['skipped']}")
    if failed:
        progress(f"could not be run: {', '.join(failed)}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
