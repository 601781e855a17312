"""Loaders under hostile input: ``python -m tests.hostile [--count N] [--seed S] [--loader NAME]``.

Each input is a valid file that was mutated, or a forged one: well formed, and lying. It must end in a result or in one of
the project's own errors, which names the file, within 5 s of processor time and 512 MiB. Anything else is a finding, and
the exit code is 1. ``--case N --keep FILE`` writes one input down.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

# Arrow's own allocators take their memory by the gigabyte, whatever is asked of them: here malloc tells what is needed.
os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")

from tests.hostile import isolation
from tests.hostile.loaders import LOADERS


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.hostile", description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=170_000, help="inputs in all, shared alike by the loaders")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--loader", action="append", choices=[loader.name for loader in LOADERS], help="default: all")
    parser.add_argument("--case", type=int, help="one input of --loader, with its number")
    parser.add_argument("--keep", type=Path, metavar="FILE", help="write that input down")
    options = parser.parse_args()
    loaders = [loader for loader in LOADERS if options.loader is None or loader.name in options.loader]
    if options.keep is not None:
        options.keep.write_bytes(loaders[0].case(options.seed, options.case or 0))
        return 0
    first, count = (0, max(1, options.count // len(loaders))) if options.case is None else (options.case, 1)
    findings = 0
    for loader in loaders:
        found = isolation.run(loader, first, count, options.seed)
        findings += len(found.findings)
        ends = f"{count} inputs, {found.accepted} accepted, {found.refused} refused, {len(found.findings)} findings"
        print(
            f"{loader.name}: {ends}; slowest {found.slowest_ms:.0f} ms, largest {found.largest_MiB:.0f} MiB", flush=True
        )
        for case, words in found.findings:
            print(f"  FOUND in case {case}: {words}", flush=True)
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())
