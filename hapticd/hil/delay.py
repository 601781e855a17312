"""The delay from sample to current: measured in the device's own log, and judged against what the driver declares."""

from __future__ import annotations

import platform
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hapticd.config.text import significant

if TYPE_CHECKING:
    from numpy.typing import NDArray

SYS_REALTIME = Path("/sys/kernel/realtime")


@dataclass(frozen=True)
class Delay:
    """Measured and declared, s."""

    declared_s: float
    median_s: float
    p99_s: float
    max_s: float
    later: float
    """Share of the commands that took longer than declared."""

    @property
    def within(self) -> bool:
        """Whether the median keeps what the driver declares."""
        return self.median_s <= self.declared_s

    @property
    def excess_s(self) -> float:
        """By how much the median is above the declared delay; negative below it."""
        return self.median_s - self.declared_s


def measured(delays_s: NDArray[np.float64], declared_s: float) -> Delay | None:
    """The delays of a run against the declared one; None where no command followed its sample."""
    if not len(delays_s):
        return None
    median, p99 = np.quantile(delays_s, [0.5, 0.99])
    later = float(np.mean(delays_s > declared_s))
    return Delay(declared_s, float(median), float(p99), float(delays_s.max()), later)


def verdict(delay: Delay, realtime: bool) -> str:
    """The judgement in words, with the next step.

    Args:
        realtime: whether this machine's kernel is a real-time one; without it the tail is the machine's.
    """
    if delay.within:
        text = f"within the declared delay: the median is {-1e6 * delay.excess_s:.0f} µs below it"
    else:
        fraction = f" ({100 * delay.excess_s / delay.declared_s:.0f} %)" if delay.declared_s else ""
        text = (
            f"above the declared delay: the median by {1e6 * delay.excess_s:.0f} µs{fraction}; put driver.latency_s: "
            f"{_rounded_up(delay.median_s)} into the config, and ask 'hapticd check' again"
        )
    text += f"; {significant(100 * delay.later)} % of the commands took longer than declared"
    if not realtime:
        text += (
            ". This kernel is not a real-time one: p99 and maximum are this machine's, and another one's median may "
            "differ too; run it where the rig will run"
        )
    return text


def _rounded_up(delay_s: float) -> str:
    """In steps of 10 µs."""
    return f"{np.ceil(1e5 * delay_s) * 1e-5:.5f}"


def realtime_kernel() -> bool:
    """Whether this machine runs a PREEMPT_RT kernel."""
    announced = SYS_REALTIME.read_text().strip() == "1" if SYS_REALTIME.is_file() else False
    return announced or "PREEMPT_RT" in platform.version()


def document(delay: Delay | None, declared_s: float, realtime: bool) -> dict[str, Any]:
    """The same as data: µs, null where nothing was measured."""
    if delay is None:
        unknown = ("p50_us", "p99_us", "max_us", "within_declared", "excess_us", "later_than_declared")
        return {"declared_us": declared_s * 1e6, **dict.fromkeys(unknown), "realtime_kernel": realtime}
    return {
        "declared_us": declared_s * 1e6,
        "p50_us": delay.median_s * 1e6,
        "p99_us": delay.p99_s * 1e6,
        "max_us": delay.max_s * 1e6,
        "within_declared": delay.within,
        "excess_us": delay.excess_s * 1e6,
        "later_than_declared": delay.later,
        "realtime_kernel": realtime,
    }
