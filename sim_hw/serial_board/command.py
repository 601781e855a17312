"""``python -m sim_hw serial``: the command line of the serial DAC board."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from hapticd.config import load_config
from sim_hw._process import add_common_options, run_device


def add_parser(devices: Any) -> None:
    """Add the subcommand ``serial`` to an ``argparse`` subparsers action."""
    parser = devices.add_parser(
        "serial",
        help="the serial DAC board, on a pseudo-terminal",
        description="The serial DAC board of docs/protocols/serial-dac.md on a pseudo-terminal, connected to the exact "
        "plant. The converter's bits and full scale are the plant file's amplifier.dac_bits and amplifier.dac_full_scale.",
    )
    parser.add_argument(
        "--link", metavar="PATH", type=Path, required=True, help="make a symbolic link to the port here"
    )
    add_common_options(parser)
    parser.add_argument(
        "--line-baud",
        metavar="N",
        type=_baud,
        default=0,
        help="emulate the transmission time of this baud rate (default: none)",
    )
    parser.add_argument(
        "--counter-bits",
        metavar="N",
        type=int,
        choices=range(16, 33),
        default=32,
        help="width of the encoder counter, 16 to 32 (default: 32)",
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Run the board until a signal ends it.

    Raises:
        ConfigError: plant file or script. OSError: port or log.
    """
    # Imported here, so that --help does not load compiled code.
    from sim_hw.script import load_script
    from sim_hw.serial_board.device import run_board, switch_on
    from sim_hw.serial_board.port import Port

    config, script = load_config(options.plant), load_script(options.script, "serial")
    sim = switch_on(
        config, script, options.plant or "built-in re35", line_baud=options.line_baud, counter_bits=options.counter_bits
    )
    port = Port(options.link)
    try:
        run_device(
            sim, lambda: run_board(sim, port), options.log, "serial", {"link": str(options.link), "port": port.path}
        )
    finally:
        port.unplug()


def _baud(text: str) -> int:
    baud = int(text)
    if not 1200 <= baud <= 100_000_000:
        raise argparse.ArgumentTypeError("must be between 1200 and 100000000 baud")
    return baud
