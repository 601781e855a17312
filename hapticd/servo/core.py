"""Memory of the servo loop and its access from Python: publish parameters, take rows, read statistics.

One :class:`ServoCore` belongs to one driver. Its compiled loop runs in real time in its own thread
(:mod:`hapticd.servo.thread`), or for a number of ticks in virtual time (:mod:`hapticd.servo.simulate`).
"""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numba
import numpy as np

from hapticd.jit import atomic_load, atomic_store, fence_release, njit
from hapticd.plant.amplifier import converter_grid
from hapticd.record.schema import ROW, joined
from hapticd.servo import atomics, authority, layout
from hapticd.servo.clock import grid_instant
from hapticd.servo.follow import follow_parameters
from hapticd.servo.layout import LAW, PARAMS, SERVO
from hapticd.servo.loop import run
from hapticd.servo.timing import quantiles_us
from hapticd.stability.damping import passive_viscous, velocity_filter

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from drivers.interface import Driver
    from hapticd.config import Config
    from hapticd.record.flight import FlightRing


PORTION_ROWS = 1024


@njit("void(int64[::1], int64, int64)", counted=False)
def _store(shared: NDArray[Any], index: int, value: int) -> None:
    atomic_store(shared, index, value)


@njit("int64(int64[::1], int64)", counted=False)
def _load(shared: NDArray[Any], index: int) -> int:
    return atomic_load(shared, index)


@njit(numba.void(numba.from_dtype(SERVO), numba.int64[::1], numba.from_dtype(PARAMS)), counted=False)
def publish(servo: Any, shared: NDArray[Any], params: Any) -> None:
    """Hand a parameter set over to the loop, which takes it whole in its next tick."""
    sequence = shared[atomics.SEQUENCE] + 1
    fence_release()  # the number of the previous set must be visible before its slot is written again
    servo.mailbox[sequence & 1] = params
    fence_release()
    atomic_store(shared, atomics.SEQUENCE, sequence)


@dataclass(frozen=True)
class Request:
    """Request of the supervisor, in addition to the config: state, fault clearing, a moved origin, an excitation."""

    state: int = layout.OFF
    ordinal: int = authority.FIRST
    """Of the command that requested this state."""
    clear: int = 0
    origin_counts: int | None = None
    """Raw count of the spring's origin; None: the config's."""
    excitation_id: int = 0
    excitation_length: int = 0
    exact: bool = False
    """Running begins without a soft start: for a release. An excitation also has none."""
    faded: bool = False
    """No force of spring and damping; they fade like at a live change."""
    fault: tuple[int, float, float] = (0, 0.0, 0.0)
    """Number, value and limit of a fault to raise, if the loop renders; 0 for none."""


ALONE: Final[dict[str, Any]] = {
    "excitation_id": 0,
    "excitation_length": 0,
    "exact": False,
    "faded": False,
    "fault": (0, 0.0, 0.0),
}
"""Fields of a request for the spring only."""


def i2t_limit(config: Config) -> float:
    """I²t above the continuous current at which ``over_current`` trips, A² s.

    ``(peak² - continuous²) peak_time``; without a peak current, three times the continuous current is used.
    """
    amplifier = config.amplifier
    if not amplifier.continuous_current:
        return math.inf
    peak = amplifier.peak_current or 3.0 * amplifier.continuous_current
    return float((peak**2 - amplifier.continuous_current**2) * (amplifier.peak_time_s or 0.0))


def parameters(config: Config, request: Request, *, safety: bool = True, latency_s: float = 0.0) -> np.void:
    """One complete parameter set for the mailbox: a new `PARAMS` record, with the units of its comments.

    Args:
        config: the configuration. request: of the supervisor.
        safety: False: no trips, no clamp and no soft start. latency_s: the driver's declared latency, for the passivity
            controller and the expected measured current.
    """
    p: np.void = np.zeros(1, PARAMS)[0]
    raw = config.raw_resolution
    amplifier, dither, limits, spring = config.amplifier, config.dither, config.safety, config.spring
    p["period_ns"] = 1e9 / config.servo.rate_hz
    p["request"] = request.state
    p["ordinal"] = request.ordinal
    p["clear"] = request.clear
    p["fault"], p["fault_value"], p["fault_limit"] = request.fault
    p["force_per_tick"] = 0.0 if request.faded else spring.stiffness * config.resolution
    p["bias"] = 0.5 if spring.half_tick_bias else 0.0
    p["damping"] = 0.0 if request.faded else spring.damping * raw
    p["velocity_periods"], p["velocity_keep"] = velocity_filter(spring, config.period)
    p["passivity"] = layout.PASSIVITY_MODES[limits.passivity]
    p["passivity_stiffest"] = 2.0 * passive_viscous(config, latency_s) / config.period
    p["side"] = layout.SIDES[spring.side]
    p["origin"] = config.origin_counts if request.origin_counts is None else request.origin_counts
    p["decimation"] = config.encoder.decimation
    p["invert"] = config.encoder.invert
    p["torque_constant"] = amplifier.torque_constant
    p["raw_resolution"] = raw
    p["dither_target"] = layout.DITHER_TARGETS[dither.target]
    p["dither_waveform"] = layout.DITHER_WAVEFORMS[dither.waveform]
    p["dither_amplitude"] = dither.amplitude
    p["dither_frequency"] = dither.frequency_hz
    p["dither_seed"] = dither.seed
    p["delay_ns"] = config.delay.computation_s * 1e9
    step, p["dac_max_code"] = converter_grid(amplifier.dac_bits, amplifier.dac_full_scale)
    p["dac_step"] = step
    peak = amplifier.peak_current or math.inf
    # The DAC rounds: a clamp that is not on its grid could be rounded up, above the peak.
    p["peak_current"] = math.floor(peak / step) * step if step and math.isfinite(peak) else peak
    p["continuous_current"] = amplifier.continuous_current or math.inf
    p["i2t_limit"] = i2t_limit(config)
    p["safety"] = safety
    p["max_speed"] = (limits.max_velocity or math.inf) / raw
    p["max_excursion"] = (limits.max_excursion or math.inf) / raw
    p["encoder_jump"] = limits.encoder_jump or math.inf
    p["missed_exchanges"] = limits.missed_exchanges or math.inf
    for name, value in follow_parameters(config, latency_s).items():
        p[name] = value
    p["mismatch"] = limits.current_mismatch or math.inf if safety else math.inf
    p["soft_step"] = config.period / limits.soft_start_s if safety and limits.soft_start_s else 0.0
    p["abrupt"] = request.exact or request.excitation_id != 0
    p["overrun_policy"] = layout.OVERRUN_POLICIES[config.servo.overrun.policy]
    p["overrun_fault_after"] = config.servo.overrun.fault_after or math.inf
    p["enable"] = limits.enable and safety
    p["heartbeat_ns"] = (limits.heartbeat_timeout_s or 0.0) * 1e9
    p["enable_timeout_ns"] = (limits.enable_timeout_s or math.inf) * 1e9
    p["excitation_id"] = request.excitation_id
    p["excitation_length"] = request.excitation_length
    return p


class ServoCore:
    """Shared memory of one servo loop.

    Args:
        driver: an open driver; this object holds a reference.
        ring_rows: rows of the ring, a power of two (131072 rows are 13 s at 10 kHz).
        flight: a file whose memory is ring and shared atomics, so that they survive the process; None: ordinary memory.
        keep_truth: store the simulated device's true state with each row.
        excitation_rows: longest excitation in ticks.
        words: of the authority (`hapticd.servo.authority`); None: no command is revoked.
    """

    def __init__(
        self,
        driver: Driver,
        *,
        ring_rows: int = 131072,
        flight: FlightRing | None = None,
        keep_truth: bool = False,
        excitation_rows: int = 1 << 20,
        words: NDArray[np.int64] | None = None,
    ) -> None:
        self.driver = driver
        self.memory = np.zeros(1, SERVO)
        self.shared = np.zeros(atomics.SIZE, np.int64) if flight is None else flight.shared
        self.words = authority.new_words() if words is None else words
        self.ring = np.zeros(ring_rows, ROW) if flight is None else flight.rows
        self.truth = np.zeros((ring_rows if keep_truth else 0, 2))
        self.excitation = np.zeros((2, excitation_rows))
        for block in (self.memory, self.ring, self.truth, self.excitation):
            # The kernel allocates zeroed pages at the first access, which must not happen in the loop.
            block.view(np.uint8).fill(0)
        self.params: np.void = self.memory[0]["params"]
        """The present parameter set."""
        self.snapshot: np.void = self.memory[0]["snapshot"]
        self.exchange: NDArray[np.int64] = self.memory["exchange"].view(np.int64)
        """Memory shared with the driver; ``exchange.view(float64)`` is its floating-point view."""
        self.late_histogram: NDArray[np.int64] = self.memory["late_histogram"][0]
        self.exec_histogram: NDArray[np.int64] = self.memory["exec_histogram"][0]
        self._state: np.void = self.memory[0]["state"]
        functions = (driver.read_address, driver.write_address, driver.wait_address)
        self.memory["driver"] = (*functions, driver.state_address, self.exchange.ctypes.data)

    def publish(self, params: np.void) -> int:
        """Publish a complete parameter set to the loop; returns its sequence number (one publisher at a time)."""
        publish(self.memory[0], self.shared, params)
        return int(self.shared[atomics.SEQUENCE])

    def load(self, index: int) -> int:
        """A shared atomic, with acquire ordering."""
        return int(_load(self.shared, index))

    def store(self, index: int, value: int) -> None:
        """Set a shared atomic of the supervisor, with release ordering."""
        _store(self.shared, index, value)

    @property
    def fault_numbers(self) -> tuple[float, float]:
        """The value that tripped the fault, and its limit, in the units of `hapticd.servo.faults`."""
        return atomics.fault_numbers(self.shared)

    @property
    def i2t(self) -> float:
        """Present I²t above the continuous current, A² s."""
        return float(self._state["i2t"])

    @property
    def estops_obeyed(self) -> int:
        """Number of software stops that the loop has executed (requested: `authority.ESTOPS`)."""
        return int(self._state["estops"])

    @property
    def ordinal(self) -> int:
        """Ordinal of the command whose request is active."""
        return int(self.params["ordinal"])

    def begin(self, start_ns: int, mode: int = layout.OFF, estops_obeyed: int = 0, i2t: float = 0.0) -> None:
        """Set the origin of the time grid and the first mode, and apply the first published parameter set.

        Args:
            start_ns: of CLOCK_MONOTONIC, or of virtual time. mode: OFF, RUNNING or FAULT.
            estops_obeyed: by the previous loop; later requests are executed in the first tick.
            i2t: of the earlier current, A² s.
        """
        sequence = self.shared[atomics.SEQUENCE]
        self.memory["params"] = self.memory["mailbox"][0, sequence & 1]
        for name in LAW.names or ():
            self.memory["law"][name] = self.params[name]
        self._state["held_share"] = layout.NO_RAMP
        self._state["applied"] = sequence
        self._state["grid_ns"] = self._state["start_ns"] = start_ns
        self._state["mode"] = mode
        self._state["estops"] = estops_obeyed
        self._state["i2t"] = self.shared.view(np.float64)[atomics.I2T] = i2t
        self._state["cleared"] = self.params["clear"]
        self._state["seed"] = self._state["random"] = self.params["dither_seed"]
        self.shared[atomics.MODE] = mode

    def run(self, *, real_time: bool, ticks: int = 0) -> int:
        """Run the compiled loop in the calling thread, without the GIL; returns a RETURN_* reason."""
        self.memory["real_time"] = real_time
        blocks = (self.memory[0], self.shared, self.words, self.ring, self.truth, self.excitation)
        reason: int = run(*blocks, ticks)
        return reason

    def replay(self, skip: int, late_ns: int) -> None:
        """Give the next tick in virtual time the timing of a recorded one.

        Args:
            skip: periods missed before it. late_ns: its lateness, ns.
        """
        self._state["replayed_skip"], self._state["replayed_late_ns"] = skip, late_ns

    def drain(self) -> NDArray[Any]:
        """Take all waiting rows (a copy); one consumer only."""
        return joined(*self.drain_batches(len(self.ring)))

    def drain_batches(self, rows: int = PORTION_ROWS) -> Iterator[NDArray[Any]]:
        """Take the rows that are waiting now (copies), in at least one batch, which may be empty; one consumer only.

        Each batch fits into a few hundred kilobytes, however many rows are waiting.
        """
        head = self.load(atomics.RING_HEAD)
        while True:
            tail = int(self.shared[atomics.RING_TAIL])
            begin = tail & (len(self.ring) - 1)
            taken = joined(self.ring[begin : begin + min(head - tail, rows)])
            self.store(atomics.RING_TAIL, tail + len(taken))
            yield taken
            if tail + len(taken) == head:
                return

    def history(self, seconds: float) -> NDArray[Any]:
        """Copy of the rows of the last ``seconds``, taken or not, oldest first; from any thread, while the loop runs."""
        size = len(self.ring)
        head = self.load(atomics.RING_HEAD)
        # The slot after the newest row may be half written.
        oldest = max(0, head - size + 1)
        if head == oldest:
            return self.ring[:0].copy()
        mask, times = size - 1, self.ring["time_s"]
        since = float(times[(head - 1) & mask]) - seconds
        first = bisect_right(range(oldest, head), since, key=lambda row: float(times[row & mask])) + oldest
        begin, end = first & mask, head & mask
        rows = joined(self.ring[begin:end]) if begin < end else joined(self.ring[begin:], self.ring[:end])
        overwritten = self.load(atomics.RING_HEAD) - size + 1 - first
        return rows[max(0, overwritten) :]

    def next_instant(self) -> tuple[int, float]:
        """Instant (ns, fraction) of the next tick; in virtual time, the end of the simulated time."""
        state = self._state
        steps = int(state["next_tick"] - state["grid_tick"])
        period_ns = float(self.params["period_ns"])
        ns, rest = grid_instant(int(state["grid_ns"]), float(state["grid_frac"]), steps, period_ns)
        return int(ns), float(rest)

    def dropped(self) -> int:
        """Rows lost because the ring was full."""
        return int(self.shared[atomics.DROPPED])

    def passivity(self) -> dict[str, float]:
        """Energies of the passivity observer since the start, in J, and the controller's current in A."""
        energies = {
            f"{name}_J": float(self.snapshot[name]) for name in ("put_out", "generated", "excess", "dissipated")
        }
        return {**energies, "current": float(self.snapshot["passivity_current"])}

    def timing(self) -> dict[str, Any]:
        """``ticks``, ``missed`` and the quantiles ``wake_us`` and ``exec_us`` since the start."""
        return {
            "ticks": self.load(atomics.TICKS),
            "missed": self.load(atomics.MISSED_PERIODS),
            "wake_us": quantiles_us(self.late_histogram.copy(), self.load(atomics.LATE_MAX_NS)),
            "exec_us": quantiles_us(self.exec_histogram.copy(), self.load(atomics.EXEC_MAX_NS)),
        }
