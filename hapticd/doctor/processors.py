"""The processors: frequency, idle states, hyper-threading, and other users of the servo's CPU."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Final

from hapticd.config.text import significant
from hapticd.doctor.finding import Finding, Level, Machine, cpu_list

if TYPE_CHECKING:
    from hapticd.config import Config

_CPUS: Final = "/sys/devices/system/cpu"
_DMA_LATENCY: Final = "/dev/cpu_dma_latency"


def governor(machine: Machine, config: Config) -> Finding:
    """The frequency governor of the CPUs."""
    found = {path.read_text().strip() for path in machine.glob(f"{_CPUS}/cpu[0-9]*/cpufreq/scaling_governor")}
    if not found:
        return Finding("cpu governor", Level.GOOD, "none: this machine does not let the frequency be set")
    if found == {"performance"}:
        return Finding("cpu governor", Level.GOOD, "performance")
    return Finding(
        "cpu governor",
        Level.NOTE,
        ", ".join(sorted(found)),
        "an idle CPU lowers its frequency, and the next tick takes longer",
        "cpupower frequency-set -g performance",
    )


def idle_states(machine: Machine, config: Config) -> Finding:
    """Wake-up latency of the CPU's idle states, and whether the daemon may disable them."""
    latencies = [
        int(text)
        for path in machine.glob(f"{_CPUS}/cpu0/cpuidle/state*/latency")
        if (text := path.read_text().strip()).isdigit()
    ]
    deepest = max(latencies, default=0)
    if deepest == 0:
        return Finding("idle states", Level.GOOD, "none with a wake-up latency")
    if os.access(machine.path(_DMA_LATENCY), os.W_OK):
        return Finding(
            "idle states", Level.GOOD, f"up to {deepest} µs to wake, and the daemon holds {_DMA_LATENCY} at 0"
        )
    return Finding(
        "idle states",
        Level.NOTE,
        f"up to {deepest} µs to wake",
        f"every tick may be that late, {significant(deepest * config.servo.rate_hz / 1e4, 2)} % of a period",
        "install the udev rule 60-hapticd.rules, and be a member of the group hapticd",
    )


def isolation(machine: Machine, config: Config) -> Finding:
    """Whether the servo's CPU is isolated."""
    isolated = cpu_list(machine.read(f"{_CPUS}/isolated"))
    wanted = config.servo.cpu
    if wanted is None:
        found = f"CPUs {_cpu_text(isolated)} are isolated, servo.cpu is null" if isolated else "no CPU is set apart"
        fix = f"set servo.cpu to {min(isolated)}" if isolated else ""
        return Finding("isolated cpu", Level.NOTE if isolated else Level.GOOD, found, "", fix)
    online = cpu_list(machine.read(f"{_CPUS}/online"))
    if online and wanted not in online:
        fix = f"set servo.cpu to one of {_cpu_text(online)}, or null"
        return Finding("isolated cpu", Level.BAD, f"servo.cpu = {wanted}, online are {_cpu_text(online)}", "", fix)
    if wanted in isolated:
        return Finding("isolated cpu", Level.GOOD, f"servo.cpu = {wanted} is isolated")
    return Finding(
        "isolated cpu",
        Level.NOTE,
        f"servo.cpu = {wanted} is not isolated",
        "other threads and the scheduler's tick share it",
        f"boot with isolcpus={wanted} nohz_full={wanted} rcu_nocbs={wanted}",
    )


def interrupts(machine: Machine, config: Config) -> Finding:
    """Interrupts that may be handled on the servo's CPU."""
    wanted = config.servo.cpu
    if wanted is None:
        return Finding("interrupts", Level.GOOD, "not checked: servo.cpu is null")
    lists = machine.glob("/proc/irq/[0-9]*/smp_affinity_list")
    struck = [path.parent.name for path in lists if wanted in cpu_list(path.read_text())]
    if not struck:
        return Finding("interrupts", Level.GOOD, f"none on CPU {wanted}")
    fix = f"for i in {' '.join(struck[:8])}; do echo {_others(machine, wanted)} > /proc/irq/$i/smp_affinity_list; done"
    return Finding(
        "interrupts",
        Level.NOTE,
        f"{len(struck)} may be handled on CPU {wanted}",
        "each delays a tick by some microseconds",
        fix,
    )


def hyper_threading(machine: Machine, config: Config) -> Finding:
    """SMT: two CPUs that share one core."""
    if machine.read(f"{_CPUS}/smt/active") != "1":
        return Finding("hyper-threading", Level.GOOD, "off or not available")
    matters = "a thread on the other half of the core slows a tick by up to a factor of two"
    return Finding("hyper-threading", Level.NOTE, "on", matters, f"echo off > {_CPUS}/smt/control")


def _cpu_text(cpus: frozenset[int]) -> str:
    return ", ".join(str(cpu) for cpu in sorted(cpus))


def _others(machine: Machine, cpu: int) -> str:
    others = cpu_list(machine.read(f"{_CPUS}/online")) - {cpu}
    return ",".join(str(other) for other in sorted(others)) or "0"


CHECKS: Final = (governor, idle_states, isolation, interrupts, hyper_threading)
