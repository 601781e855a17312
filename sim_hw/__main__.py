"""``python -m sim_hw DEVICE …``: one simulated device as a process.

Exit codes: 0 ended by a signal, 2 usage or an invalid plant file or script, 4 the device's interface cannot be opened.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Sequence

from hapticd.config import ConfigError

_DEVICES = ("serial_board", "firmware", "canopen")
"""Packages with a module ``command`` whose ``add_parser(subparsers)`` describes a subcommand and sets its ``run``."""


def build_parser() -> argparse.ArgumentParser:
    """The parser of all subcommands; the function ``run`` of a parsed namespace takes the namespace."""
    parser = argparse.ArgumentParser(
        prog="python -m sim_hw",
        description="Simulated hardware: one device as a process, with the exact plant in real time. When it "
        'is ready it prints one JSON line on stdout: {"ready": true, "device": …, "pid": …}. SIGTERM or Ctrl-C ends it. '
        "Its log has the true motion and current; a script moves the hand and injects faults.",
    )
    devices = parser.add_subparsers(title="devices", dest="device", required=True, metavar="DEVICE")
    for package in _DEVICES:
        importlib.import_module(f"sim_hw.{package}.command").add_parser(devices)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a device; the exit code."""
    options = build_parser().parse_args(arguments)
    if sys.stderr.isatty():
        print(f"{options.device}: starting (the first start compiles, some ten seconds) …", file=sys.stderr)
    try:
        options.run(options)
    except ConfigError as error:
        print(error, file=sys.stderr)
        return 2
    except OSError as error:
        print(f"{options.device}: {error}", file=sys.stderr)
        return 4
    return 0


if __name__ == "__main__":
    sys.exit(main())
