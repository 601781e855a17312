"""Metrics for Prometheus, in its text format, on the API's socket.

They come from the same sources as ``status``, so scraping does not disturb the servo thread.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.core import CounterMetricFamily as Counter
from prometheus_client.core import GaugeMetricFamily as Gauge
from prometheus_client.core import HistogramMetricFamily, Metric
from prometheus_client.registry import Collector

from hapticd.servo import layout
from hapticd.servo.faults import NUMBERS
from hapticd.servo.timing import bucket_edges

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.service.rig import Rig

CONTENT_TYPE: Final = "text/plain; version=0.0.4; charset=utf-8"
BOUNDS_S: Final = (1e-6, 2e-6, 5e-6, 1e-5, 2e-5, 5e-5, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2)
"""Upper bounds of the published histograms [s]; the loop's histograms are finer."""


class RigCollector(Collector):
    """Metrics of a rig at one time.

    Args:
        rig: the rig.
        status: the daemon's status document of the same time.
        faults: number of latched faults per code since the daemon started.
    """

    def __init__(self, rig: Rig, status: dict[str, Any], faults: dict[str, int]) -> None:
        self._rig, self._status, self._faults = rig, status, faults

    def collect(self) -> Iterator[Metric]:
        """The metrics."""
        status, core = self._status, self._rig.core
        timing, recorder, energy = status["timing"], status["recorder"], status["energy"]
        yield Counter("hapticd_ticks", "Servo ticks done", timing["ticks"])
        yield Counter("hapticd_missed_periods", "Servo periods that were skipped", timing["missed"])
        yield Counter("hapticd_missed_exchanges", "Failed exchanges with the device", status["exchanges_missed"])
        yield Counter("hapticd_clamped_commands", "Commands beyond the peak current", status["commands_clamped"])
        yield _histogram("hapticd_lateness_seconds", "How late the loop woke", core.late_histogram)
        yield _histogram("hapticd_execution_seconds", "How long a tick took", core.exec_histogram)
        yield Gauge("hapticd_rate_hertz", "Servo rate", timing["rate_hz"])
        state = Gauge("hapticd_state", "1 for the state that the daemon is in", labels=["state"])
        for name in layout.STATE_NAMES:
            state.add_metric([name], float(status["state"] == name))
        yield state
        faults = Counter("hapticd_faults", "Faults latched since the daemon began", labels=["code"])
        for code in NUMBERS:  # also codes with 0: a rate needs the value before the first fault
            if code:
                faults.add_metric([code], self._faults.get(code, 0))
        yield faults
        yield Gauge("hapticd_current_amperes", "Commanded current", status["current"])
        yield Gauge("hapticd_position", "Position from the spring's origin, rad or m", status["position"])
        yield Counter("hapticd_recorder_rows", "Rows recorded", recorder["rows_total"])
        yield Counter("hapticd_recorder_dropped_rows", "Rows that the recorder lost", recorder["dropped_total"])
        yield Counter(
            "hapticd_log_dropped_lines", "Lines of the log that nobody took in time", status["log_lines_dropped"]
        )
        joules = Gauge(
            "hapticd_energy_joules", "Energies since the last start, estimated through the model", labels=["kind"]
        )
        for kind in ("stored", "dissipated", "generated", "unexplained"):
            joules.add_metric([kind], energy[f"{kind}_J"])
        yield joules
        passivity = Gauge(
            "hapticd_passivity_joules",
            "Energies since the last start as the passivity observer books them; none where it is off",
            labels=["kind"],
        )
        for kind in ("put_out", "generated", "excess", "dissipated"):
            if (value := status["passivity"][f"{kind}_J"]) is not None:
                passivity.add_metric([kind], value)
        yield passivity


def exposition(rig: Rig, status: dict[str, Any], faults: dict[str, int]) -> str:
    """The metrics in Prometheus' text format 0.0.4."""
    registry = CollectorRegistry(auto_describe=False)
    registry.register(RigCollector(rig, status, faults))
    return generate_latest(registry).decode()


def _histogram(name: str, text: str, counts: NDArray[np.int64]) -> Metric:
    """The loop's logarithmic histogram with a few round bounds; a bucket counts by its middle."""
    counts = counts.copy()
    edges = bucket_edges()
    middles = 0.5 * (edges[:-1] + edges[1:]) * 1e-9
    buckets = [(f"{bound:g}", float(counts[middles <= bound].sum())) for bound in BOUNDS_S]
    buckets.append(("+Inf", float(counts.sum())))
    return HistogramMetricFamily(name, text, buckets=buckets, sum_value=float((counts * middles).sum()))
