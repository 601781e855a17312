"""``python -m benchmarks.against COMMIT [NAME…]``: benchmarks of the working tree and of a commit in turns, as ratios.

The commit is checked out and runs its own benchmarks with the same Python. Each pair runs both, the other one first in every
second pair, so that what the machine does meanwhile meets both; a ratio is the median over the pairs.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from rich.console import Console
from rich.table import Table

from benchmarks.__main__ import NAMES as KNOWN
from benchmarks.report import BenchmarkError, progress

_ROOT = Path(__file__).parent.parent
NAMES = ("tick", "plant_propagation", "maps", "lateness")


def _figures(tree: Path, name: str, is_quick: bool, scratch: Path) -> dict[str, tuple[float, str]]:
    """Value and unit of each figure of a benchmark, run in a tree; a name ends where it tells its own measured values."""
    command = [sys.executable, "-m", "benchmarks", name, "--json", str(scratch), *(["--quick"] * is_quick)]
    environment = {**os.environ, "PYTHONPATH": str(tree)}
    if subprocess.run(command, cwd=tree, env=environment, stdout=subprocess.DEVNULL, check=False).returncode != 0:
        raise BenchmarkError(f"the benchmark {name} could not be run in {tree}")
    return {
        re.split(r": (?=\d)", figure["name"])[0]: (figure["value"], figure["unit"])
        for figure in json.loads((scratch / f"{name}.json").read_text())["figures"]
    }


def compare(commit: str, names: list[str], pairs: int, is_quick: bool) -> Iterator[Table]:
    """A table for each benchmark, as soon as it is done.

    A row for each figure that both have: the commit's median, this tree's, and the median ratio of the pairs.
    """
    with tempfile.TemporaryDirectory() as folder:
        scratch, other = Path(folder), Path(folder) / "tree"
        add = ["git", "worktree", "add", "--detach", "--quiet", str(other), commit]
        if subprocess.run(add, cwd=_ROOT, check=False).returncode != 0:
            raise BenchmarkError(f"no commit {commit} could be checked out")
        try:
            for name in names:
                table = Table(name, "unit", commit, "here", "ratio", "pairs")
                both: list[dict[Path, dict[str, tuple[float, str]]]] = []
                for pair in range(pairs + 1):  # the first pair compiles, and does not count
                    order = (other, _ROOT) if pair % 2 else (_ROOT, other)
                    both.append({tree: _figures(tree, name, is_quick, scratch) for tree in order})
                    progress(f"{name}: pair {pair} of {pairs}")
                del both[0]
                for figure, (_, unit) in both[0][_ROOT].items():
                    if any(figure not in one[other] for one in both):
                        continue
                    theirs, ours = ([one[tree][figure][0] for one in both] for tree in (other, _ROOT))
                    ratios = [a / b for a, b in zip(ours, theirs, strict=True) if b]
                    if ratios:
                        spread = ", ".join(f"{ratio:.3g}" for ratio in ratios)
                        medians = [f"{statistics.median(values):.4g}" for values in (theirs, ours, ratios)]
                        table.add_row(figure, unit, *medians, spread)
                yield table
        finally:
            subprocess.run(["git", "worktree", "remove", "--force", str(other)], cwd=_ROOT, check=False)


def main() -> int:
    """Run what was asked for and print the table; 1 when a benchmark could not be run."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.against", description=__doc__.splitlines()[0])
    parser.add_argument("commit", metavar="COMMIT", help="what to compare with, as git names it")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"default: {', '.join(NAMES)}")
    parser.add_argument("--pairs", type=int, default=3, metavar="N", help="pairs that count (default: %(default)s)")
    parser.add_argument("--quick", action="store_true", help="short trials: right in kind, wide in scatter")
    options = parser.parse_args()
    if unknown := [name for name in options.names if name not in KNOWN]:
        parser.error(f"no benchmark is called {', '.join(unknown)}; there are {', '.join(KNOWN)}")
    if options.pairs < 1:
        parser.error(f"--pairs {options.pairs}: at least 1")
    try:
        for table in compare(options.commit, options.names or list(NAMES), options.pairs, options.quick):
            Console(width=150).print(table)
    except BenchmarkError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
