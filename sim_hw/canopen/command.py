"""``python -m sim_hw canopen``: the simulated CANopen drive as a process."""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import Any

import yaml

from hapticd.config import ConfigError, Problem, load_config
from sim_hw._process import add_common_options, run_device

_SETTING = re.compile(r"(0[xX][0-9a-fA-F]{4})(?::(\d+))?=(-?(?:0[xX][0-9a-fA-F]+|\d+))")


def _node_id(text: str) -> int:
    value = int(text, 0)
    if not 1 <= value <= 127:
        raise argparse.ArgumentTypeError(f"{text} is not a node id: 1 to 127")
    return value


def _index(text: str) -> int:
    value = int(text, 16)
    if not 0x1000 <= value <= 0xFFFF:
        raise argparse.ArgumentTypeError(f"{text} is not an object: 0x1000 to 0xFFFF")
    return value


def _setting(text: str) -> tuple[tuple[int, int], int]:
    match = _SETTING.fullmatch(text)
    if match is None:
        raise argparse.ArgumentTypeError(f"{text}: must be INDEX[:SUB]=VALUE, such as 0x6076=58 or 0x1018:1=5")
    return (int(match[1], 16), int(match[2] or 0)), int(match[3], 0)


def _argument(text: str) -> tuple[str, Any]:
    name, equals, value = text.partition("=")
    if not (equals and name.isidentifier()):
        raise argparse.ArgumentTypeError(f"{text}: must be NAME=VALUE, such as port=43114")
    return name, yaml.safe_load(value)


def add_parser(devices: Any) -> None:
    """Add the subcommand ``canopen`` to an ``argparse`` subparsers action."""
    parser = devices.add_parser(
        "canopen",
        help="CANopen servo drive (CiA 301, CiA 402, torque modes)",
        description="A CANopen servo drive in torque mode, with the object dictionary of sim_hw/canopen/drive.eds: cyclic "
        "synchronous torque (mode 10) and Copley's programmed current, slopes, limits, node guarding, EMCY.",
    )
    bus = parser.add_mutually_exclusive_group(required=True)
    bus.add_argument(
        "--socket",
        metavar="PATH",
        type=Path,
        help="listen here (AF_UNIX SOCK_SEQPACKET, one struct can_frame per message) as the bus for up to 4 clients",
    )
    bus.add_argument(
        "--interface", metavar="NAME", help="python-can interface: socketcan (served compiled), udp_multicast, slcan, …"
    )
    parser.add_argument("--channel", metavar="X", help="channel of --interface, such as vcan0 or 239.74.163.2")
    parser.add_argument(
        "--bus",
        metavar="NAME=VALUE",
        type=_argument,
        action="append",
        default=[],
        help="further argument of python-can's --interface, such as port=43114; may be repeated",
    )
    parser.add_argument("--node-id", metavar="N", type=_node_id, default=1, help="CANopen node id (default: 1)")
    parser.add_argument(
        "--no-cst", action="store_true", help="no cyclic synchronous torque: 0x6502 does not offer mode 10"
    )
    parser.add_argument(
        "--set",
        metavar="INDEX[:SUB]=VALUE",
        type=_setting,
        action="append",
        default=[],
        help="another power-up value of an object, such as 0x6076=0; may be repeated",
    )
    parser.add_argument(
        "--missing",
        metavar="INDEX",
        type=_index,
        action="append",
        default=[],
        help="a missing object; may be repeated",
    )
    add_common_options(parser)
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> None:
    # Imported here, so that --help does not load Numba.
    from sim_hw.canopen.device import WRONG_DEVICE_TYPE, WRONG_VENDOR, Drive
    from sim_hw.canopen.transport import open_transport
    from sim_hw.script import load_script

    script = load_script(options.script, "canopen")
    config = load_config(options.plant)
    override: dict[tuple[int, int], int] = dict(script.override) | dict(options.set)
    if script.wrong_version is not None:
        override |= {(0x1000, 0): WRONG_DEVICE_TYPE, (0x1018, 1): WRONG_VENDOR}
    if options.bus and options.interface in (None, "socketcan"):
        message = "is for interfaces of python-can only; a Unix socket and socketcan take no further arguments"
        raise ConfigError([Problem("command line", "--bus", None, message)])
    transport = open_transport(options.socket, options.interface, options.channel, dict(options.bus))
    try:
        drive = Drive(
            config,
            script,
            options.node_id,
            cyclic_torque=not options.no_cst,
            override=override,
            missing=(*script.missing, *options.missing),
        )
        drive.objects.check("command line", dict(options.set), options.missing)
        drive.objects.check(str(options.script), script.override, script.missing)
        ready: dict[str, object] = {"node_id": options.node_id}
        if options.socket is not None:
            ready["socket"] = str(options.socket)
        else:
            ready |= {"interface": options.interface, "channel": options.channel}
        run_device(drive.machine.sim, lambda: transport.serve(drive), options.log, "canopen", ready)
    finally:
        transport.close()
