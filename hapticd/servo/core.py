"""The servo's memory and everything Python may do with it: publish parameters, drain rows, read statistics.

One :class:`ServoCore` belongs to one driver. Its compiled loop runs in a thread of its own in real time
(:mod:`hapticd.servo.thread`) or is called for a number of ticks in virtual time (:mod:`hapticd.servo.simulate`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from drivers.interface import new_exchange
from hapticd.jit import atomic_load, atomic_store, fence_release, njit
from hapticd.record.schema import ROW
from hapticd.servo import layout as w
from hapticd.servo.clock import grid_instant
from hapticd.servo.loop import run
from hapticd.servo.timing import BUCKETS, quantiles_us

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from drivers.interface import Driver
    from hapticd.config import Config


PORTION_ROWS = 1024


@njit("void(float64[:,::1], int64[::1], float64[::1])", counted=False)
def _publish(mailbox: NDArray[Any], control: NDArray[Any], params: NDArray[Any]) -> None:
    sequence = control[w.C_SEQUENCE] + 1
    fence_release()  # the number of the set before must be out before its slot is written again
    for word in range(w.PARAMETERS):
        mailbox[sequence & 1, word] = params[word]
    fence_release()
    atomic_store(control, w.C_SEQUENCE, sequence)


@njit("int64(int64[::1], int64)", counted=False)
def _load(control: NDArray[Any], word: int) -> int:
    return atomic_load(control, word)


@njit("void(int64[::1], int64, int64)", counted=False)
def _store(control: NDArray[Any], word: int, value: int) -> None:
    atomic_store(control, word, value)


@dataclass(frozen=True)
class Request:
    """What the supervisor wants besides the config: state, fault clearing, a moved origin, an excitation."""

    state: int = w.OFF
    clear: int = 0
    origin_counts: int | None = None
    """Raw count of the spring's origin; None: the config's."""
    excitation_id: int = 0
    excitation_length: int = 0


def _limit(value: float | None) -> float:
    return math.inf if value is None or value == 0 else float(value)


def i2t_limit(config: Config) -> float:
    """What the motor may take above its continuous current before ``over_current`` trips, A² s.

    ``(peak² - continuous²) peak_time``; without a peak current, three times the continuous one stands in for it.
    """
    amplifier = config.amplifier
    if not amplifier.continuous_current:
        return math.inf
    peak = amplifier.peak_current or 3.0 * amplifier.continuous_current
    return float((peak**2 - amplifier.continuous_current**2) * (amplifier.peak_time_s or 0.0))


def parameters(config: Config, request: Request, *, safety: bool = True) -> NDArray[np.float64]:
    """One whole parameter set for the mailbox, shape (PARAMETERS,); units as the P_* comments say."""
    p = np.zeros(w.PARAMETERS)
    raw = config.raw_resolution
    amplifier, limits, spring = config.amplifier, config.safety, config.spring
    p[w.P_PERIOD_NS] = 1e9 / config.servo.rate_hz
    p[w.P_REQUEST] = request.state
    p[w.P_CLEAR] = request.clear
    p[w.P_FORCE_PER_TICK] = spring.stiffness * config.resolution
    p[w.P_BIAS] = 0.5 if spring.half_tick_bias else 0.0
    p[w.P_SIDE] = {"both": 0.0, "positive": 1.0, "negative": -1.0}[spring.side]
    p[w.P_ORIGIN] = config.origin_counts if request.origin_counts is None else request.origin_counts
    p[w.P_DECIMATION] = config.encoder.decimation
    p[w.P_INVERT] = float(config.encoder.invert)
    p[w.P_TORQUE_CONSTANT] = amplifier.torque_constant
    p[w.P_DITHER_TARGET] = w.DITHER_TARGETS[config.dither.target]
    p[w.P_DITHER_WAVEFORM] = w.DITHER_WAVEFORMS[config.dither.waveform]
    p[w.P_DITHER_AMPLITUDE] = config.dither.amplitude
    p[w.P_DITHER_FREQUENCY] = config.dither.frequency_hz
    p[w.P_DITHER_SEED] = config.dither.seed
    p[w.P_DELAY_NS] = config.delay.computation_s * 1e9
    p[w.P_CONTINUOUS_CURRENT] = _limit(amplifier.continuous_current)
    p[w.P_I2T_LIMIT] = i2t_limit(config)
    bits = amplifier.dac_bits or 0
    full_scale = amplifier.dac_full_scale or 0.0
    p[w.P_DAC_BITS] = bits if full_scale else 0
    p[w.P_DAC_FULL_SCALE] = full_scale if bits else 0.0
    step = 2.0 * full_scale / 2**bits if bits and full_scale else 0.0
    p[w.P_DAC_STEP] = step
    peak = _limit(amplifier.peak_current)
    # The DAC rounds; a clamp that is not on its grid could be rounded up, beyond the peak.
    p[w.P_PEAK_CURRENT] = math.floor(peak / step) * step if step and math.isfinite(peak) else peak
    p[w.P_SAFETY] = float(safety)
    p[w.P_MAX_SPEED] = _limit(limits.max_velocity) / raw
    p[w.P_MAX_EXCURSION] = _limit(limits.max_excursion) / raw
    p[w.P_ENCODER_JUMP] = _limit(limits.encoder_jump)
    p[w.P_MISSED_EXCHANGES] = _limit(limits.missed_exchanges)
    p[w.P_OVERRUN_POLICY] = w.OVERRUN_POLICIES[config.servo.overrun.policy]
    p[w.P_OVERRUN_FAULT_AFTER] = _limit(config.servo.overrun.fault_after)
    p[w.P_HEARTBEAT_NS] = (limits.heartbeat_timeout_s or 0.0) * 1e9
    p[w.P_ENABLE_TIMEOUT_NS] = _limit(limits.enable_timeout_s) * 1e9
    p[w.P_EXCITATION_ID] = request.excitation_id
    p[w.P_EXCITATION_LENGTH] = request.excitation_length
    p[w.P_RAW_RESOLUTION] = raw
    return p


class ServoCore:
    """Shared memory of one servo loop.

    Args:
        driver: an open driver; kept alive by this object.
        ring_rows: rows the ring holds, a power of two (131072 rows are 13 s at 10 kHz).
        keep_truth: keep the simulated device's true state beside each row.
        excitation_rows: longest excitation in ticks.
    """

    def __init__(
        self, driver: Driver, *, ring_rows: int = 131072, keep_truth: bool = False, excitation_rows: int = 1 << 20
    ) -> None:
        self.driver = driver
        self.mailbox = np.zeros((3, w.PARAMETERS))
        self.control = np.zeros(w.CONTROL_WORDS, np.int64)
        self.params = np.zeros(w.PARAMETERS)
        self.snapshot = np.zeros(w.SNAPSHOT_WORDS)
        self.ints = np.zeros(w.WORK_INTS, np.int64)
        self.floats = np.zeros(w.WORK_FLOATS)
        self.late_histogram = np.zeros(BUCKETS, np.int64)
        self.exec_histogram = np.zeros(BUCKETS, np.int64)
        self._fifo_ns = np.zeros(w.FIFO_LENGTH, np.int64)
        self._fifo = np.zeros((2, w.FIFO_LENGTH))
        self.ring = np.zeros(ring_rows, ROW)
        self.truth = np.zeros((ring_rows if keep_truth else 0, 2))
        self.excitation = np.zeros((2, excitation_rows))
        for block in (self._fifo_ns, self._fifo, self.ring, self.truth, self.excitation):
            block.fill(0)  # zeroed memory is not there until it is touched, and the loop must not be the one to do it
        self.exchange = new_exchange()
        self._timespec = np.zeros(2, np.int64)
        addresses = (driver.read_address, driver.write_address, driver.state_address, self.exchange.ctypes.data)
        self._pointers = np.array(addresses, np.int64)

    def publish(self, params: NDArray[np.float64]) -> int:
        """Hand a whole parameter set to the loop; returns its sequence number (one publisher at a time)."""
        _publish(self.mailbox, self.control, params)
        return int(self.control[w.C_SEQUENCE])

    def load(self, word: int) -> int:
        """A control word, with acquire ordering."""
        return int(_load(self.control, word))

    def store(self, word: int, value: int) -> None:
        """A control word of the supervisor's, with release ordering."""
        _store(self.control, word, value)

    def begin(self, start_ns: int, state: int = w.OFF) -> None:
        """Set the time grid's origin and the first state, with the first published parameter set in force."""
        self.params[:] = self.mailbox[self.control[w.C_SEQUENCE] & 1]
        self.ints[w.W_APPLIED] = self.control[w.C_SEQUENCE]
        self.ints[w.W_GRID_NS] = start_ns
        self.ints[w.W_START_NS] = start_ns
        self.ints[w.W_STATE] = state
        self.ints[w.W_CLEAR] = int(self.params[w.P_CLEAR])
        self.ints[w.W_SEED] = self.ints[w.W_RANDOM] = int(self.params[w.P_DITHER_SEED])
        self.control[w.C_STATE] = state

    def run(self, *, real_time: bool, ticks: int = 0) -> int:
        """Run the compiled loop in the calling thread, without the GIL; returns a RETURN_* reason."""
        reason: int = run(
            self.mailbox,
            self.control,
            self.params,
            self.snapshot,
            self.ints,
            self.floats,
            self.late_histogram,
            self.exec_histogram,
            self._fifo_ns,
            self._fifo,
            self.ring,
            self.truth,
            self.excitation,
            self.exchange,
            self.exchange.view(np.float64),
            self._timespec,
            self._pointers,
            real_time,
            ticks,
        )
        return reason

    def drain(self) -> NDArray[Any]:
        """Take all rows that are waiting (a copy); one consumer only."""
        rows, _ = self.drain_with_truth()
        return rows

    def portions(self, rows: int = PORTION_ROWS) -> Iterator[NDArray[Any]]:
        """Take the rows that are waiting now (copies), at least one portion, be it empty; one consumer only.

        However long nobody has drained, what is then worked on fits into a few hundred kilobytes.
        """
        head = self.load(w.C_RING_HEAD)
        while True:
            tail = int(self.control[w.C_RING_TAIL])
            begin = tail & (len(self.ring) - 1)
            taken = self.ring[begin : begin + min(head - tail, rows)].copy()
            self.store(w.C_RING_TAIL, tail + len(taken))
            yield taken
            if tail + len(taken) == head:
                return

    def drain_with_truth(self) -> tuple[NDArray[Any], NDArray[np.float64]]:
        """Rows that are waiting and the simulated device's true (position, velocity) beside them."""
        tail = int(self.control[w.C_RING_TAIL])
        head = self.load(w.C_RING_HEAD)
        begin, end = tail & (len(self.ring) - 1), head & (len(self.ring) - 1)
        if head > tail and end <= begin:
            rows = np.concatenate([self.ring[begin:], self.ring[:end]])
            truth = np.concatenate([self.truth[begin:], self.truth[:end]])
        else:
            rows, truth = self.ring[begin:end].copy(), self.truth[begin:end].copy()
        self.store(w.C_RING_TAIL, head)
        return rows, truth

    def next_instant(self) -> tuple[int, float]:
        """Instant (ns, fraction) at which the next tick is due; in virtual time, the end of what was simulated."""
        steps = int(self.ints[w.W_TICK] - self.ints[w.W_GRID_TICK])
        base, frac = int(self.ints[w.W_GRID_NS]), float(self.floats[w.V_GRID_FRAC])
        ns, rest = grid_instant(base, frac, steps, float(self.params[w.P_PERIOD_NS]))
        return int(ns), float(rest)

    def dropped(self) -> int:
        """Rows lost because nobody drained the ring."""
        return int(self.control[w.C_DROPPED])

    def timing(self) -> dict[str, Any]:
        """``ticks``, ``missed`` and the quantiles ``wake_us`` and ``exec_us`` since the start."""
        return {
            "ticks": self.load(w.C_TICKS),
            "missed": self.load(w.C_MISSED),
            "wake_us": quantiles_us(self.late_histogram.copy(), self.load(w.C_LATE_MAX_NS)),
            "exec_us": quantiles_us(self.exec_histogram.copy(), self.load(w.C_EXEC_MAX_NS)),
        }
