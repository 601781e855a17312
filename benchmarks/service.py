"""Whether a daemon that is a service keeps its goals: metrics scraped every second, the watchdog of a manager fed.

The benchmarks that measure a running daemon and have a goal, `lateness` and `recorder`, are run as they are and again with
that company, one right after the other: each figure with its own goal, and how it compares with the one without.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from benchmarks import lateness, recorder
from benchmarks.report import Figure, progress
from benchmarks.service_load import ServicedDaemon

COMPARED: dict[str, Callable[..., list[Figure]]] = {"lateness": lateness.measure, "recorder": recorder.measure}


def measure(quick: bool) -> list[Figure]:
    """Each figure with company, and its ratio to the one without."""
    figures: list[Figure] = []
    for name, benchmark in COMPARED.items():
        progress(f"{name}, alone")
        alone = benchmark(quick)
        progress(f"{name}, scraped and watched")
        figures += compared(name, benchmark(quick, ServicedDaemon), alone)
    return figures


def compared(name: str, serviced: list[Figure], alone: list[Figure]) -> Iterator[Figure]:
    """The figures of one benchmark under a service's load, each followed by its ratio where there is one."""
    for figure, other in zip(serviced, alone, strict=True):
        details = {**figure.details, "alone": {"name": other.name, "value": other.value, **other.details}}
        yield Figure(
            f"{name}: {figure.name}", figure.value, figure.unit, figure.goal, figure.bound, figure.peer, details
        )
        if other.value:
            yield Figure("  over that without", figure.value / other.value, "×", peer=f"alone: {other.name}")
