"""The faults of the matrix: what is done to which side, and what must come of it."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

from hapticd.config import Config
from hapticd.hil.daemon import DaemonProcess

AT_S: Final = 0.5
"""When a device-side fault strikes, after the first enable."""

SERIAL: Final = "serial_dac"
CANOPEN: Final = "canopen"
BOTH: Final = (SERIAL, CANOPEN)


@dataclass(frozen=True)
class Injection:
    """One row of the matrix."""

    name: str
    what: str
    fault: dict[str, Any] = field(default_factory=dict)
    """What befalls the device, as its script has it, with the serial board's word for the frames."""
    devices: tuple[str, ...] = BOTH
    codes: tuple[str, ...] = ()
    """Fault codes that are right; none: it must be tolerated, and counted."""
    by_watchdog: bool = False
    """The daemon cannot act: the device must, within its watchdog time."""
    act: Callable[[DaemonProcess], None] | None = None
    """What is done to the daemon."""
    script: dict[str, Any] = field(default_factory=dict)
    """What else the device's script says: how it starts, what a hand does."""
    refused: bool = False
    """The daemon must refuse to start on such a device."""
    enable: bool = False
    """The config asks for the enable that a person holds."""
    clock_jump: bool = False
    """The wall clock jumps; needs a C compiler."""


def _signal(number: int) -> Callable[[DaemonProcess], None]:
    return lambda daemon: daemon.signal(number)


def watchdog_s(config: Config) -> float:
    """The device's watchdog time, s: the driver's option, or its default (20 ms on a serial board, 100 ms on CAN)."""
    default = 20 if config.driver.name == SERIAL else 100
    return float(config.driver.options.get("watchdog_ms", default)) * 1e-3


def _stall(daemon: DaemonProcess) -> None:
    daemon.signal(signal.SIGSTOP)
    time.sleep(3.0 * watchdog_s(daemon.config))
    daemon.signal(signal.SIGCONT)


_FOREVER: Final = 1_000_000
_LOST: Final = ("driver_lost", "missed_exchanges", "device_fault")
_PUSH: Final = [
    {"at_s": AT_S, "force": 0.006, "from": "enabled"},
    {"at_s": AT_S + 0.05, "force": 0.0, "from": "enabled"},
]
"""A hand's, N m or N: it must move for the commands to change, and a CAN drive's demand to show that they are lost."""

INJECTIONS: Final = (
    Injection("drop_one_reply", "one reply lost", {"kind": "drop", "frames": "reply", "count": 1}),
    Injection("drop_one_command", "one command lost", {"kind": "drop", "frames": "command", "count": 1}),
    Injection(
        "drop_replies",
        "every reply lost from now on",
        {"kind": "drop", "frames": "reply", "count": _FOREVER},
        codes=_LOST,
    ),
    Injection(
        "drop_commands",
        "every command lost from now on",
        {"kind": "drop", "frames": "command", "count": _FOREVER},
        codes=_LOST,
        by_watchdog=True,
        script={"hand": _PUSH},
    ),
    Injection(
        "corrupt_one", "one reply with a flipped bit", {"kind": "corrupt", "frames": "reply", "count": 1}, (SERIAL,)
    ),
    Injection(
        "corrupt_replies",
        "every reply with a flipped bit",
        {"kind": "corrupt", "frames": "reply", "count": _FOREVER},
        (SERIAL,),
        _LOST,
    ),
    Injection("duplicate", "five replies sent twice", {"kind": "duplicate", "frames": "reply", "count": 5}),
    Injection(
        "delay_one",
        "one reply 2 ms late, a period at least",
        {"kind": "delay", "frames": "reply", "count": 1, "delay_s": 0.002},
    ),
    Injection(
        "delay_replies",
        "every reply 2 ms late, a period at least",
        {"kind": "delay", "frames": "reply", "count": _FOREVER, "delay_s": 0.002},
        codes=_LOST,
    ),
    Injection("reorder", "two replies change places", {"kind": "reorder", "frames": "reply", "count": 1}),
    Injection("garbage", "64 bytes of garbage on the line", {"kind": "garbage", "bytes": 64}, (SERIAL,)),
    Injection(
        "encoder_glitch",
        "the counter jumps by 100000 for one sample",
        {"kind": "encoder_glitch", "counts": 100_000, "count": 1},
        codes=("encoder_jump",),
    ),
    Injection(
        "freeze_counter",
        "the counter stands still for 0.2 s: to the host, a shaft at rest",
        {"kind": "freeze_counter", "duration_s": 0.2},
    ),
    *(
        Injection(kind, what, {"kind": kind}, (SERIAL,), ("device_fault",))
        for kind, what in (
            ("encoder_fault", "the board reports an encoder fault"),
            ("amplifier_fault", "the board reports an amplifier fault"),
            ("external_stop", "the board's stop input opens"),
        )
    ),
    Injection(
        "enable_released",
        "the enable is let go",
        {"kind": "enable_released"},
        codes=("enable_released",),
        enable=True,
    ),
    Injection("encoder_wrap", "the counter wraps around", script={"start": {"counts_offset": 2**32 - 1}}),
    Injection("silent", "the device sends nothing, but still hears", {"kind": "silent"}, codes=_LOST),
    Injection("unplug", "the port disappears", {"kind": "unplug"}, codes=("driver_lost",), by_watchdog=True),
    Injection("reboot", "the device reboots", {"kind": "reboot"}, codes=("device_fault", "amplifier_dropped", *_LOST)),
    Injection("bus_off", "the bus goes off", {"kind": "bus_off"}, (CANOPEN,), _LOST, by_watchdog=True),
    Injection(
        "emcy",
        "emergency message (over-temperature)",
        {"kind": "emcy", "code": 0x4310},
        (CANOPEN,),
        ("device_fault",),
    ),
    Injection(
        "leave_operation_enabled",
        "the drive leaves Operation Enabled by itself",
        {"kind": "leave_operation_enabled"},
        (CANOPEN,),
        ("amplifier_dropped", "device_fault"),
    ),
    Injection(
        "second_node",
        "a second node of the same number answers every SYNC, from 400 counts further on",
        {"kind": "second_node", "counts": 400, "count": _FOREVER},
        (CANOPEN,),
        ("driver_error", "encoder_jump"),
    ),
    Injection(
        "foreign_write",
        "another client writes the drive's largest torque (0x6072) by SDO",
        {"kind": "foreign_sdo", "object": 0x6072, "value": 0x7FFF, "size": 2},
        (CANOPEN,),
        ("driver_lost",),
    ),
    Injection("wrong_version", "protocol or identity of another device", {"kind": "wrong_version"}, refused=True),
    Injection("sigkill", "SIGKILL of the daemon", act=_signal(signal.SIGKILL), by_watchdog=True),
    Injection("sigsegv", "SIGSEGV of the daemon", act=_signal(signal.SIGSEGV), by_watchdog=True),
    Injection("sigstop", "SIGSTOP of the daemon", act=_signal(signal.SIGSTOP), by_watchdog=True),
    Injection(
        "stall",
        "the daemon stands still for three times the watchdog's time, then goes on",
        act=_stall,
        codes=("device_fault", "amplifier_dropped"),
        by_watchdog=True,
    ),
    Injection("sigterm", "SIGTERM of the daemon", act=_signal(signal.SIGTERM)),
    Injection("clock_jump", "the host's clock jumps by an hour and back", clock_jump=True),
)
