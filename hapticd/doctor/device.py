"""The connection to the device: serial port or CAN interface."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from typing import TYPE_CHECKING, Any, Final

from hapticd.doctor.finding import Finding, Level, Machine

if TYPE_CHECKING:
    from collections.abc import Iterator

    from hapticd.config import Config

_QUEUE: Final = 64
"""Longest transmit queue [frames]: with a longer one, commands would be too old."""


def device(machine: Machine, config: Config) -> Iterator[Finding]:
    """Checks of the configured driver's connection; none for a driver without one."""
    options = config.driver.options
    if config.driver.name == "serial_dac":
        yield from _serial(machine, config, str(options.get("port", "")))
    elif config.driver.name == "canopen" and options.get("interface", "socketcan") == "socketcan":
        yield from _can(machine, config, str(options.get("channel", "can0")), int(options.get("bitrate", 1_000_000)))
    else:
        yield Finding("device", Level.GOOD, f"driver {config.driver.name} needs no port of this machine")


def _serial(machine: Machine, config: Config, port: str) -> Iterator[Finding]:
    path = machine.path(port)
    if not port or not path.exists():
        fix = "plug it in, and see 'ls -l /dev/serial/by-id' for its name"
        yield Finding("serial port", Level.BAD, f"driver.port = {port!r} does not exist", "no device, no loop", fix)
        return
    if not path.is_char_device():
        fix = "ls -l /dev/serial/by-id, and set driver.port to one of these"
        yield Finding("serial port", Level.BAD, f"driver.port = {port!r} is a file or folder, no serial port", "", fix)
        return
    if not os.access(path, os.R_OK | os.W_OK):
        owner = path.stat()
        fix = f"adduser {os.environ.get('USER', 'you')} dialout, then log in again"
        yield Finding("serial port", Level.BAD, f"{port}: no permission (group {owner.st_gid})", "", fix)
        return
    yield Finding("serial port", Level.GOOD, f"{port} can be opened")
    name = path.resolve().name
    timer = machine.number(f"/sys/bus/usb-serial/devices/{name}/latency_timer")
    if timer is None:
        yield Finding("latency timer", Level.GOOD, "this port has none")
    elif timer > 1:
        fraction = timer * 1e-3 * config.servo.rate_hz
        fix = f"echo 1 > /sys/bus/usb-serial/devices/{name}/latency_timer, or the udev rule 60-hapticd.rules"
        level = Level.BAD if fraction >= 1.0 else Level.NOTE
        yield Finding("latency timer", level, f"{timer} ms", f"replies wait for it: {fraction:.3g} periods", fix)
    else:
        yield Finding("latency timer", Level.GOOD, f"{timer} ms")


def _can(machine: Machine, config: Config, channel: str, bitrate: int) -> Iterator[Finding]:
    bring_up = f"ip link set {channel} type can bitrate {bitrate} && ip link set {channel} txqueuelen 16 up"
    if machine.read(f"/sys/class/net/{channel}/ifindex") is None:
        fix = f"modprobe can can_raw, plug the adapter in, then: {bring_up}"
        yield Finding("can interface", Level.BAD, f"driver.channel = {channel!r} does not exist", "", fix)
        return
    if machine.read(f"/sys/class/net/{channel}/operstate") == "down":
        yield Finding("can interface", Level.BAD, f"{channel} is down", "", bring_up)
        return
    link = _ip_link(channel)
    data = link.get("linkinfo", {}).get("info_data", {})
    state = str(data.get("state", "up"))
    level = Level.GOOD if state in ("up", "ERROR-ACTIVE") else Level.BAD
    fix = "" if level is Level.GOOD else f"check wiring and termination, then: ip link set {channel} down && {bring_up}"
    counters = data.get("berr_counter", {})
    errors = f", {counters['tx']} transmit and {counters['rx']} receive errors" if counters else ""
    yield Finding("can interface", level, f"{channel} is {state.lower()}{errors}", "", fix)
    found = data.get("bittiming", {}).get("bitrate")
    if found is not None and found != bitrate:
        yield Finding(
            "can bit rate",
            Level.BAD,
            f"{found} bit/s, driver.bitrate = {bitrate}",
            "no communication on the bus",
            f"ip link set {channel} down && {bring_up}",
        )
    elif found is not None:
        yield Finding("can bit rate", Level.GOOD, f"{found} bit/s")
    queue = machine.number(f"/sys/class/net/{channel}/tx_queue_len") or 0
    if queue > _QUEUE:
        matters = f"a blocked bus would later play {queue / 2 / config.servo.rate_hz * 1e3:.3g} ms of old commands"
        fix = f"ip link set {channel} txqueuelen 16"
        yield Finding("can queue", Level.NOTE, f"{queue} frames", matters, fix)
    else:
        yield Finding("can queue", Level.GOOD, f"{queue} frames")


def _ip_link(channel: str) -> dict[str, Any]:
    """Properties of an interface from iproute2; empty if it is not installed."""
    ip = shutil.which("ip") or shutil.which("ip", path="/sbin:/usr/sbin")
    if ip is None:
        return {}
    arguments = [ip, "-details", "-json", "link", "show", channel]
    found = subprocess.run(arguments, capture_output=True, text=True, timeout=5, check=False)
    try:
        links = json.loads(found.stdout)
        return dict(links[0]) if links else {}
    except (ValueError, IndexError, TypeError):
        return {}
