"""``python -m tests.orders SEED OPERATION…``: play one script again, and tell its story."""

from __future__ import annotations

import argparse

from tests.orders.run import OPERATIONS, Run
from tests.orders.trace import Violation

parser = argparse.ArgumentParser(prog="python -m tests.orders", description="Play one order of operations again.")
parser.add_argument("seed")
parser.add_argument("script", nargs="*", choices=OPERATIONS, metavar="OPERATION", help=", ".join(OPERATIONS))
given = parser.parse_args()
run = Run(given.seed)
try:
    run.play(given.script)
except Violation as violation:
    raise SystemExit(f"{run.machine.trace}\n{violation}") from violation
print(f"{run.machine.trace}\nno rule is broken")
