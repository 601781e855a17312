"""The kernel: preemption, throttling, limits, clock, swap, virtual machine."""

from __future__ import annotations

import os
import platform
import resource
from typing import TYPE_CHECKING, Final

from hapticd.doctor.finding import Finding, Level, Machine

if TYPE_CHECKING:
    from hapticd.config import Config

_RT_PACKAGE: Final = "apt-get install linux-image-rt-amd64 && reboot (linux-image-rt-arm64 on 64-bit Arm)"
_FAST_HZ: Final = 500.0
"""Above this rate, the delays of an ordinary kernel, some milliseconds, are whole periods."""


def preemption(machine: Machine, config: Config) -> Finding:
    """Whether the kernel is PREEMPT_RT."""
    version = machine.read("/proc/version") or platform.version()
    if machine.read("/sys/kernel/realtime") == "1" or "PREEMPT_RT" in version:
        return Finding("preemption", Level.GOOD, "PREEMPT_RT")
    model = next((name for name in ("PREEMPT_DYNAMIC", "PREEMPT") if name in version), "no preemption")
    rate = config.servo.rate_hz
    matters = f"late by milliseconds now and then, a period at {rate:g} Hz is {1e3 / rate:g} ms"
    if config.servo.require_realtime or rate >= _FAST_HZ:
        return Finding("preemption", Level.NOTE, model, matters, _RT_PACKAGE)
    return Finding("preemption", Level.GOOD, model, f"enough at {rate:g} Hz")


def throttling(machine: Machine, config: Config) -> Finding:
    """Share of the time that real-time threads may use."""
    runtime = machine.number("/proc/sys/kernel/sched_rt_runtime_us")
    period = machine.number("/proc/sys/kernel/sched_rt_period_us") or 1_000_000
    if runtime is None:
        return Finding("rt throttling", Level.GOOD, "not throttled by this kernel")
    if runtime < 0:
        return Finding(
            "rt throttling", Level.GOOD, "off", "an endless loop in a real-time thread would hang the machine"
        )
    fraction = runtime / period
    if fraction < 0.5:
        return Finding(
            "rt throttling",
            Level.BAD,
            f"{100 * fraction:.0f} % of the time for real-time threads",
            "the servo thread is stopped when it has used that up",
            "sysctl kernel.sched_rt_runtime_us=950000",
        )
    return Finding("rt throttling", Level.GOOD, f"{100 * fraction:.0f} % of the time for real-time threads")


def group_scheduling(machine: Machine, config: Config) -> Finding:
    """Whether CONFIG_RT_GROUP_SCHED is on, with which a cgroup has no real-time budget by default."""
    text = machine.read(f"/boot/config-{platform.release()}")
    if text is None:
        return Finding("rt group scheduling", Level.GOOD, "not known: no kernel configuration in /boot")
    if "CONFIG_RT_GROUP_SCHED=y" not in text:
        return Finding("rt group scheduling", Level.GOOD, "off")
    return Finding(
        "rt group scheduling",
        Level.BAD,
        "on",
        "SCHED_FIFO is refused in a cgroup without real-time budget, a systemd unit's for one",
        "boot with rt_group_sched=0, or use a kernel without CONFIG_RT_GROUP_SCHED",
    )


def rtprio(machine: Machine, config: Config) -> Finding:
    """Whether this user may have the configured priority."""
    wanted = config.servo.priority
    if os.geteuid() == 0:
        return Finding("real-time priority", Level.GOOD, f"root: {wanted} is granted")
    limit, _ = resource.getrlimit(resource.RLIMIT_RTPRIO)
    if limit == resource.RLIM_INFINITY or limit >= wanted:
        return Finding("real-time priority", Level.GOOD, f"limit {limit}, servo.priority is {wanted}")
    return Finding(
        "real-time priority",
        Level.BAD if config.servo.require_realtime else Level.NOTE,
        f"limit {limit}, servo.priority is {wanted}",
        "without it the servo thread is scheduled like any other; the service has its own limit",
        f"echo '@hapticd - rtprio {wanted}' > /etc/security/limits.d/hapticd.conf, then log in again",
    )


def memlock(machine: Machine, config: Config) -> Finding:
    """Whether all memory may be locked."""
    limit, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    if os.geteuid() == 0 or limit == resource.RLIM_INFINITY:
        return Finding("memory lock", Level.GOOD, "unlimited")
    return Finding(
        "memory lock",
        Level.BAD if config.servo.require_realtime else Level.NOTE,
        f"limit {limit // 1024} KiB",
        "a page that was swapped out delays the loop by milliseconds; the service has its own limit",
        "echo '@hapticd - memlock unlimited' >> /etc/security/limits.d/hapticd.conf, then log in again",
    )


def clock_source(machine: Machine, config: Config) -> Finding:
    """The kernel's clock source."""
    folder = "/sys/devices/system/clocksource/clocksource0"
    current = machine.read(f"{folder}/current_clocksource")
    if current is None:
        return Finding("clock source", Level.GOOD, "not known")
    if current in ("hpet", "acpi_pm", "jiffies"):
        matters = "reading the time costs a system call of some microseconds, several times per tick"
        fix = f"echo tsc > {folder}/current_clocksource, or boot with clocksource=tsc tsc=reliable"
        return Finding("clock source", Level.NOTE, current, matters, fix)
    return Finding("clock source", Level.GOOD, current)


def swap(machine: Machine, config: Config) -> Finding:
    """Swap space."""
    lines = (machine.read("/proc/swaps") or "").splitlines()[1:]
    if not lines:
        return Finding("swap", Level.GOOD, "none")
    return Finding("swap", Level.GOOD, f"{len(lines)} area(s); the daemon's own memory is locked")


def virtual_machine(machine: Machine, config: Config) -> Finding:
    """Whether the machine is virtual, so that its host schedules it."""
    if "hypervisor" in (machine.read("/proc/cpuinfo") or "") or machine.read("/sys/hypervisor/type"):
        matters = "the host may pause the whole machine for milliseconds"
        return Finding("virtual machine", Level.NOTE, "yes", matters, "run on the bare machine for a real motor")
    return Finding("virtual machine", Level.GOOD, "no")


CHECKS: Final = (
    preemption,
    throttling,
    group_scheduling,
    rtprio,
    memlock,
    clock_source,
    swap,
    virtual_machine,
)
