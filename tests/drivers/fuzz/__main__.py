"""``python -m tests.drivers.fuzz NAME [--count N] [--seed S]``: exit 0 when the decoder held, 1 when it did not."""

from __future__ import annotations

import argparse
import faulthandler
import importlib
import sys
import time
from typing import cast

from rich.console import Console
from rich.progress import Progress

from tests.drivers.fuzz import FuzzReport

TARGETS = {"canopen": "tests.drivers.fuzz.canopen", "serial": "tests.drivers.fuzz.serial"}
"""Name of a decoder to the module whose ``fuzz(count, seed, advance)`` attacks it."""
_HANG_S = 60.0


def main() -> int:
    """Attack one decoder and print what came of it."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.drivers.fuzz", description="Random and mutated bytes into a decoder."
    )
    parser.add_argument("decoder", choices=sorted(TARGETS))
    parser.add_argument("--count", type=int, default=1_000_000, help="byte strings (default %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of the random generator (default %(default)s)")
    options = parser.parse_args()
    if options.count < 1:
        parser.error(f"--count {options.count}: must be at least 1")
    fuzz = importlib.import_module(TARGETS[options.decoder]).fuzz
    began = time.monotonic()
    with Progress(console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty()) as progress:
        task = progress.add_task(options.decoder, total=options.count)

        def advance(done: int) -> None:
            progress.update(task, completed=done)
            # A compiled decoder that hangs can only be ended from outside: the process dies with a traceback.
            faulthandler.dump_traceback_later(_HANG_S, exit=True)

        advance(0)
        report = cast(FuzzReport, fuzz(options.count, options.seed, advance))
        faulthandler.cancel_dump_traceback_later()
    print(f"{options.decoder}, seed {options.seed}, {time.monotonic() - began:.1f} s")
    print("\n".join(report.lines()))
    return 1 if report.failed else 0


if __name__ == "__main__":
    sys.exit(main())
