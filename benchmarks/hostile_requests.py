"""The control API under generated requests: ``python -m benchmarks.hostile_requests [--count N] [--seed S]``.

A daemon on the loopback, in real time, answers on its Unix socket. No reply may be 5xx, none may differ from what the
OpenAPI document says, and a request that is refused may have changed nothing. Anything else is a finding, and the exit code
is 1.
"""

from __future__ import annotations

import argparse
import json
import logging
import os
import sys
import tempfile
from pathlib import Path

from benchmarks.hostile.api import Attack, Report
from benchmarks.report import Figure, document, print_table, progress
from hapticd.config import config_to_yaml, parse_config
from hapticd.service.api import ApiServer
from hapticd.service.daemon import Daemon
from hapticd.service.latch import FaultLatch
from hapticd.service.socket import bind

_EVERY = 5000


def attack(count: int, seed: int, folder: Path) -> Report:
    """A daemon of its own, and the requests.

    Args:
        count, seed: of the requests. folder: for socket, recordings and state.
    """
    # As a service, so that a request with a path of its own can write nowhere else.
    os.environ["STATE_DIRECTORY"] = str(folder)
    socket, source = folder / "h.sock", folder / "rig.yaml"
    wanted = {
        "servo": {"overrun": {"fault_after": None}},
        "safety": {"heartbeat_timeout_s": 10},
        "record": {"directory": str(folder / "runs"), "enabled": False},
        "api": {"socket": str(socket)},
    }
    config = parse_config(wanted, "the benchmark's config")
    source.write_text(config_to_yaml(config))
    logging.getLogger("hapticd").setLevel(logging.CRITICAL)
    daemon = Daemon(config, str(source), FaultLatch(socket))
    server = ApiServer(daemon, bind(socket))
    server.start()
    told = 0

    def advance(done: int) -> None:
        nonlocal told
        if done >= told + _EVERY:
            told = done
            progress(f"{done} of {count} requests")

    try:
        return Attack(daemon, socket, seed).run(count, advance)
    finally:
        server.stop()
        daemon.shutdown()


def figures(report: Report) -> list[Figure]:
    """The sums."""
    answers = ", ".join(f"{count} × {status}" for status, count in sorted(report.answers.items()))
    kinds = f"{report.generated} by schemathesis, {report.mutants} mutants, {report.settings} settings"
    return [
        Figure(f"requests: {kinds}", report.requests, "", details=vars(report)),
        Figure(f"answers: {answers}", len(report.answers), "kinds"),
        Figure("answers of 5xx", sum(n for status, n in report.answers.items() if status >= 500), "", goal=0),
        Figure("findings", len(report.findings), "", goal=0),
    ]


def main(argv: list[str] | None = None) -> int:
    """Run it; 1 where something was found."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.hostile_requests", description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=100_000, help="requests (default %(default)s)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--quick", action="store_true", help="2000 requests")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here instead of a table")
    options = parser.parse_args(argv)
    with tempfile.TemporaryDirectory(prefix="hapticd-requests-") as folder:
        report = attack(2000 if options.quick else options.count, options.seed, Path(folder))
    for what, count in report.findings.items():
        progress(f"FINDING {what} ({count} times): {report.examples[what]}")
    found = document("hostile_requests", figures(report), options.quick)
    if options.json:
        options.json.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n")
    else:
        print_table([found])
    return 1 if report.findings else 0


if __name__ == "__main__":
    sys.exit(main())
