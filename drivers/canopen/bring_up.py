"""Bring-up: from a drive that was just switched on to one that responds to SYNC and RPDO 1, at zero current and disabled.

Everything that could change a command is written *and read back* before the node is started: mode, slopes, limits, fault
reactions, PDO mapping, watchdog. The units come from objects of the drive.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import canopen

from drivers.canopen import _plausible
from drivers.canopen import layout as w
from drivers.canopen._objects import Objects
from drivers.canopen._pdo import Entry, can_send, map_pdos, set_deadline
from drivers.canopen._units import Rated
from drivers.canopen.bus import (
    Monitor,
    check_sync,
    listen_for_master,
    nobody_answers,
    refuse_other_master,
    stop_node,
)
from drivers.canopen.eds import load_eds
from drivers.canopen.options import Options
from drivers.canopen.profile import Mode, Profile
from drivers.canopen.state_machine import (
    DISABLE_VOLTAGE,
    FAULT,
    FAULT_BIT,
    FAULT_RESET,
    READY,
    SWITCH_ON_DISABLED,
    state_of,
    transition,
)
from drivers.interface import DriverError
from hapticd.config import Config
from hapticd.config.sections import Amplifier

_CIA_402: Final = 402
_WAIT_S: Final = 0.5
_FIRST_SAMPLE_S: Final = 0.5


@dataclass(frozen=True)
class Drive:
    """A drive after bring-up."""

    mode: str
    identity: str
    command_per_ampere: float
    ampere_per_actual: float
    ampere_per_demand: float | None
    """Of the demand in TPDO 2; None: it is not in it."""
    mode_number: int
    """Expected mode of operation, if TPDO 2 contains the mode after the demand; 0: it does not."""
    held_mask: int
    """Bit of TPDO 2 that is 1 while the enable input is held; 0: none is required."""
    objects: Objects
    echoes: bool
    """Whether the interface returns the frames that it sends."""


def bring_up(
    network: canopen.Network,
    monitor: Monitor,
    options: Options,
    profile: Profile,
    eds: Path,
    config: Config,
) -> Drive:
    """Bring the drive up; it is then operational, at zero current and disabled.

    Raises:
        DriverError: another master, no reply, a missing, unmapped or contradictory object, a value that the drive
            refuses, or a missing state transition.
        DriverConfigError: the EDS cannot be read.
    """
    node_id = options.node_id
    dictionary = load_eds(eds, node_id)
    node = canopen.RemoteNode(node_id, dictionary)
    listen_for_master(monitor, node_id)
    network.add_node(node)
    follows = config.servo.clock == "sync"
    echoes = stop_node(network, monitor, node_id)
    objects = Objects(node, eds.name)
    identity = _identify(network, monitor, options, objects, dictionary, profile, eds)
    objects.expect(there=True)

    _set_watchdog(objects, profile, options, 0)
    if objects.present(0x1017, 0, "heartbeat producer time (ms)"):
        objects.set(0x1017, 0, 0, "heartbeat producer time (ms)")
    _disable(objects, profile)
    objects.apply(profile.reactions)
    mode = _choose_mode(objects, profile)
    _set_mode(objects, mode)
    objects.apply(profile.slopes)
    amplifier = config.amplifier
    rated = _rated(objects, profile, options, config)
    _check_what_it_says(objects, profile, rated, config)
    _set_limits(objects, profile, rated, amplifier)
    command = rated.command_per_ampere(mode.target.unit, amplifier.peak_current)
    _plausible.check_step(f"{mode.name}, 0x{mode.target.object:04x}", 1.0 / command, amplifier.peak_current)
    actual = rated.ampere_per_raw(profile.actual.unit)
    objects.set(mode.target.object, 0, 0, f"target of {mode.name}")
    back = _read_back(objects, options, mode)
    inputs = _inputs(objects, profile, options)
    map_pdos(
        objects,
        node_id,
        (
            Entry(profile.statusword, 16, "statusword"),
            Entry(profile.position, 32, "position"),
            Entry(profile.actual.object, 16, "actual current"),
        ),
        (Entry(profile.controlword, 16, "controlword"), Entry(mode.target.object, 16, f"target of {mode.name}")),
        back + inputs,
        options.watchdog_ms,
    )
    _set_watchdog(objects, profile, options, options.guard_ms)
    if follows:
        check_sync(monitor, config.servo.rate_hz)
    _start(network, monitor, node_id, follows)
    if not echoes:
        refuse_other_master(monitor, node_id)
    demand = rated.ampere_per_raw(mode.demand.unit) if back and mode.demand is not None else None
    number = mode.requires_mode if len(back) > 1 and mode.requires_mode is not None else 0
    held = 0 if options.enable_bit is None else 1 << sum(entry.bits for entry in back) + options.enable_bit
    return Drive(mode.name, identity, command, actual, demand, number, held, objects, echoes)


def release(objects: Objects, profile: Profile, options: Options) -> None:
    """After the last exchange: watchdog off, power stage off.

    Raises:
        DriverError: the drive does not reply, or does not switch off.
    """
    objects.expect(there=False)
    _set_watchdog(objects, profile, options, 0)
    set_deadline(objects, 0)
    if not objects.read(profile.statusword, 0, "statusword") & FAULT_BIT:
        _disable(objects, profile)


def _identify(
    network: canopen.Network,
    monitor: Monitor,
    options: Options,
    objects: Objects,
    dictionary: canopen.ObjectDictionary,
    profile: Profile,
    eds: Path,
) -> str:
    try:
        device_type = objects.read(0x1000, 0, "device type")
    except DriverError as error:
        if isinstance(error.__cause__, canopen.SdoCommunicationError):
            raise nobody_answers(network, monitor, options) from error
        raise
    if device_type & 0xFFFF != _CIA_402:
        raise DriverError(
            f"node {options.node_id} is not a drive: its device type 0x1000 is 0x{device_type:08x}, profile "
            f"{device_type & 0xFFFF}; a drive has CiA 402"
        )
    vendor, product, revision, serial = (
        objects.read(0x1018, sub, what) if objects.present(0x1018, sub, what) else 0
        for sub, what in enumerate(("vendor-ID", "product code", "revision number", "serial number"), start=1)
    )
    if profile.vendor_id is not None and vendor != profile.vendor_id:
        raise DriverError(
            f"node {options.node_id} has vendor-ID 0x{vendor:08x}, driver.profile {options.profile!r} is for "
            f"0x{profile.vendor_id:08x} ({profile.name}): choose another profile"
        )
    information = dictionary.device_information
    for what, expected, found in (
        ("vendor-ID", information.vendor_number, vendor),
        ("product code", information.product_number, product),
    ):
        if expected and expected != found:
            raise DriverError(
                f"{what}: the EDS {eds.name} is for 0x{expected:08x}, the drive has 0x{found:08x}: this is not its EDS"
            )
    return f"vendor 0x{vendor:x}, product 0x{product:x}, revision 0x{revision:x}, serial number {serial}"


def _wait_state(objects: Objects, profile: Profile, wanted: tuple[int, ...]) -> None:
    begin = time.monotonic()
    while True:
        statusword = objects.read(profile.statusword, 0, "statusword")
        if int(state_of(statusword)) in wanted:
            return
        if time.monotonic() - begin > _WAIT_S:
            raise DriverError(transition(statusword, _WAIT_S, wanted[0]))
        time.sleep(0.005)


def _disable(objects: Objects, profile: Profile) -> None:
    """Power stage off, from any state; a fault is reset once, by an edge of bit 7."""

    def command(word: int) -> None:
        objects.write(profile.controlword, 0, word, "controlword")

    command(DISABLE_VOLTAGE)
    _wait_state(objects, profile, (SWITCH_ON_DISABLED, READY, FAULT))
    if objects.read(profile.statusword, 0, "statusword") & FAULT_BIT:
        command(FAULT_RESET)
        _wait_state(objects, profile, (SWITCH_ON_DISABLED, READY))
        command(DISABLE_VOLTAGE)


def _choose_mode(objects: Objects, profile: Profile) -> Mode:
    what = "supported drive modes"
    offered = 0
    if objects.present(profile.supported_modes, 0, what):
        offered = objects.read(profile.supported_modes, 0, what)
    for mode in profile.modes:
        if mode.requires_mode is None or offered >> (mode.requires_mode - 1) & 1:
            return mode
    wanted = ", ".join(f"{mode.name} ({mode.requires_mode})" for mode in profile.modes)
    raise DriverError(
        f"the drive offers none of the profile's modes: {what} (0x{profile.supported_modes:04x}) is 0x{offered:08x}, "
        f"wanted {wanted}"
    )


def _set_mode(objects: Objects, mode: Mode) -> None:
    objects.apply(mode.settings)
    if mode.display is None or mode.requires_mode is None:
        return
    begin = time.monotonic()
    while (shown := objects.read(mode.display, 0, "mode of operation display")) != mode.requires_mode:
        if time.monotonic() - begin > _WAIT_S:
            raise DriverError(
                f"{mode.name}: the drive shows mode {shown} (0x{mode.display:04x}) though {mode.requires_mode} was set, "
                f"waited {_WAIT_S:g} s"
            )
        time.sleep(0.005)


def _read_back(objects: Objects, options: Options, mode: Mode) -> tuple[Entry, ...]:
    """The available objects of TPDO 2: the demand, which shows whether commands arrive, and the mode of operation."""
    if mode.demand is None or not options.read_back:
        return ()
    demand = Entry(mode.demand.object, 16, f"demand of {mode.name}")
    if not can_send(objects, demand):
        return ()
    if mode.display is None or mode.requires_mode is None:
        return (demand,)
    display = Entry(mode.display, 8, "mode of operation display")
    return (demand, display) if can_send(objects, display) else (demand,)


def _inputs(objects: Objects, profile: Profile, options: Options) -> tuple[Entry, ...]:
    """The digital inputs, after the objects that are read back, if one of them is the enable input."""
    if options.enable_bit is None:
        return ()
    inputs = Entry(profile.inputs, 32, "digital inputs")
    if not can_send(objects, inputs):
        raise DriverError(
            f"driver.enable_bit = {options.enable_bit}: the drive, or its EDS, has no digital inputs 0x{profile.inputs:04x} "
            "that can be mapped into TPDO 2, so it cannot have an enable input"
        )
    return (inputs,)


def _rated(objects: Objects, profile: Profile, options: Options, config: Config) -> Rated:
    def value(index: int | None, what: str) -> int | None:
        present = index is not None and objects.present(index, 0, what)
        return objects.read(index, 0, what) if present and index is not None else None

    current, torque = (
        value(profile.rated_current, "rated current (mA)"),
        value(profile.rated_torque, "rated torque (mN m)"),
    )
    return _plausible.rated_values(current, torque, options, config)


def _check_what_it_says(objects: Objects, profile: Profile, rated: Rated, config: Config) -> None:
    index, what = profile.encoder_resolution, "position encoder resolution"
    counts_per_rev = config.encoder.counts_per_rev
    if index is not None and counts_per_rev is not None and all(objects.present(index, sub, what) for sub in (1, 2)):
        _plausible.check_encoder(index, objects.read(index, 1, what), objects.read(index, 2, what), counts_per_rev)
    index, what = profile.max_torque, "max torque (‰)"
    if index is not None and rated.torque is not None and objects.present(index, 0, what):
        raw = objects.read(index, 0, what)
        limit = raw * rated.ampere_per_raw("permille_rated_torque")
        _plausible.check_max_torque(index, raw, limit, config.amplifier.peak_current)


def _set_limits(objects: Objects, profile: Profile, rated: Rated, amplifier: Amplifier) -> None:
    for limit in profile.limits:
        asked = getattr(amplifier, limit.key)
        if not asked or (limit.optional and not objects.present(limit.object, 0, limit.what)):
            continue
        scale = 1e3 if limit.unit == "ms" else 1.0 / rated.ampere_per_raw(limit.unit)
        if limit.unit != "ms":
            found = objects.read(limit.object, 0, limit.what)
            _plausible.check_limit(limit.what, limit.object, found, found / scale, limit.key, asked)
        try:
            objects.set(limit.object, 0, round(asked * scale), limit.what)
        except DriverError as error:
            unit = "s" if limit.unit == "ms" else "A"
            raise DriverError(f"amplifier.{limit.key} = {asked:g} {unit}: {error}") from error


def _set_watchdog(objects: Objects, profile: Profile, options: Options, guard_ms: int) -> None:
    """Node guarding (life time = guard time x factor) or heartbeat consumer; 0: off."""
    if profile.guarding == "heartbeat":
        value = profile.master_id << 16 | options.watchdog_ms if guard_ms else 0
        objects.set(0x1016, 1, value, "consumer heartbeat time")
        return
    objects.set(0x100C, 0, guard_ms, "guard time (ms)")
    objects.set(0x100D, 0, w.GUARD_TRIES if guard_ms else 0, "life time factor")


def _start(network: canopen.Network, monitor: Monitor, node_id: int, follows: bool) -> None:
    """NMT start, and a first SYNC, own or of the producer that the loop follows, which must cause a TPDO 1."""
    network.send_message(w.NMT, bytes([0x01, node_id]))
    time.sleep(0.01)
    before = monitor.samples
    if not follows:
        network.send_message(w.SYNC, b"")
    sample = monitor.wait_sample(before, _FIRST_SAMPLE_S)
    if sample is None:
        raise DriverError(
            f"node {node_id} sends no TPDO 1 within {_FIRST_SAMPLE_S:g} s of SYNC, though it is mapped and started"
        )
    if len(sample) != w.TPDO1_BYTES:
        raise DriverError(
            f"TPDO 1 of node {node_id} has {len(sample)} bytes, {w.TPDO1_BYTES} are mapped: is the identifier used twice?"
        )
