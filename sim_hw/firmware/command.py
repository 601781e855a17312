"""``python -m sim_hw firmware``: the command line of the reference firmware's test bench."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Any

from hapticd.config import load_config
from sim_hw._process import add_common_options, run_device
from sim_hw.firmware._emulator import BOARDS, Emulator


def add_parser(devices: Any) -> None:
    """Add the subcommand ``firmware`` to an ``argparse`` subparsers action."""
    parser = devices.add_parser(
        "firmware",
        help="the reference firmware as a binary, on a pseudo-terminal",
        description="The serial DAC board's reference firmware (firmware/serial_dac, built by 'make firmware') as a "
        "binary in emulation, with the exact plant at its encoder and DAC, on a pseudo-terminal. The faults of the "
        "script act on its line and its inputs.",
    )
    parser.add_argument(
        "--board", choices=sorted(BOARDS), default="mps2-an385", help="which board (default: mps2-an385)"
    )
    parser.add_argument("--image", metavar="FILE", type=Path, help="the binary (default: that of 'make firmware')")
    parser.add_argument(
        "--link", metavar="PATH", type=Path, required=True, help="make a symbolic link to the port here"
    )
    add_common_options(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Run the board until a signal ends it.

    Raises:
        ConfigError: plant file or script. OSError: port, log, image or emulator.
    """
    # Imported here, so that --help does not load compiled code.
    from sim_hw.firmware.device import run_bench, set_up
    from sim_hw.script import load_script
    from sim_hw.serial_board.port import Port

    config, script = load_config(options.plant), load_script(options.script, "firmware")
    with tempfile.TemporaryDirectory(prefix="hapticd-board-") as folder:
        emulator = Emulator(options.board, Path(folder), options.image)
        try:
            sim = set_up(config, script, options.plant or "built-in re35", emulator.board)
            emulator.power_on()
            port = Port(options.link)
            ready = {"link": str(options.link), "port": port.path, "board": options.board}
            try:
                run_device(sim, lambda: run_bench(sim, emulator, port), options.log, "firmware", ready)
            finally:
                port.unplug()
        finally:
            emulator.close()
