"""Bring-up of a serial DAC board by an operator: ``hapticd doctor --device CONFIG``.

First the tests without current: identity, round-trip time, and whether the counter follows the knob, with its sign. Then
tests with the output stage on, each after the operator has agreed: the watchdog at zero current, and a current ramp that
shows whether positive current increases the counts.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Protocol

from drivers.serial_dac import messages
from hapticd.doctor._board_session import REPLY_S, Board, NoReplyError, opened
from hapticd.doctor.finding import Finding, Findings, Level

if TYPE_CHECKING:
    from hapticd.config import Config

EXCHANGES: Final = 500
PAUSE_S: Final = 0.002
TURN_S: Final = 8.0
SHOW_S: Final = 0.05
RAMP_S: Final = 1.0
RAMP_STEP_S: Final = 0.005
RAMP_FRACTION: Final = 0.05
"""Default peak of the ramp, as a share of the continuous current."""
MOVED_FRACTION: Final = 0.125
"""The ramp ends after this share of a turn (or of a million counts on a linear scale)."""
_FAULT_NAMES: Final = {
    messages.STATUS_ENCODER_FAULT: "ENCODER_FAULT",
    messages.STATUS_AMPLIFIER_FAULT: "AMPLIFIER_FAULT",
    messages.STATUS_EXTERNAL_STOP: "EXTERNAL_STOP",
}


class Operator(Protocol):
    """The person at the rig; :mod:`hapticd.cli.doctor` asks at the terminal."""

    def agrees(self, question: str) -> bool:
        """Whether the answer is yes; False without an operator."""

    def does(self, request: str) -> bool:
        """Whether it is done; False without an operator."""

    def shows(self, counts: int, rate: float, fastest: float) -> None:
        """Show the counter: counts since the start, present rate in counts/s, and the largest rate."""


@dataclass(frozen=True)
class BringUp(Findings):
    """The findings; ``round_trip_us`` in the order of measurement."""

    round_trip_us: tuple[float, ...] = ()

    @property
    def verdict(self) -> str:
        """One sentence."""
        if not self.fit:
            return f"Not fit to be driven: {self.named(Level.BAD)}."
        if left := self.named(Level.NOTE):
            return f"Nothing wrong; look again at: {left}."
        return "Fit to be driven. 'hapticd check' says what the theory thinks of the spring."

    def document(self) -> dict[str, Any]:
        """The JSON form."""
        p50, p99, largest = (percentile(self.round_trip_us, fraction) for fraction in (0.5, 0.99, 1.0))
        times = {"p50": p50, "p99": p99, "max": largest, "exchanges": len(self.round_trip_us)}
        return {"fit": self.fit, "verdict": self.verdict, "round_trip_us": times, "findings": self.listed()}


def percentile(values: Sequence[float], fraction: float) -> float | None:
    """The value that ``fraction`` of the values do not exceed; None without values."""
    return sorted(values)[max(0, math.ceil(fraction * len(values)) - 1)] if values else None


def bring_up(config: Config, operator: Operator, current: float | None = None) -> BringUp:
    """Test the board step by step.

    Args:
        config: driver, amplifier and encoder of the rig.
        operator: turns the knob, and agrees to currents.
        current: peak of the ramp, A; None: RAMP_FRACTION of the continuous current.

    Raises:
        DriverError: the board does not answer.
    """
    times: list[float] = []
    findings: list[Finding] = []
    with opened(config) as board:
        try:
            findings += identity(board, config)
            times += round_trips(board)
            findings.append(round_trip(times, config))
            findings += inputs(board)
            findings += knob(board, config, operator)
            if any(finding.level is Level.BAD for finding in findings):
                text = "not tested: repair the bad findings above first"
                findings += [Finding(name, Level.NOTE, text) for name in ("watchdog", "polarity")]
            else:
                findings.append(watchdog(board, operator))
                findings.append(ramp(board, config, operator, current))
        except NoReplyError:
            fix = "check the cable, and that driver.baud is the board's"
            findings.append(Finding("answers", Level.BAD, "a SAMPLE was not answered within 250 ms", "", fix))
    return BringUp(tuple(findings), tuple(times))


def identity(board: Board, config: Config) -> Iterator[Finding]:
    """Version and capabilities, compared with the config."""
    found, amplifier = board.capabilities, config.amplifier
    yield Finding(
        "board", Level.GOOD, f"firmware {found.firmware_text}, serial number {found.serial_number}, protocol version 1"
    )
    for name, has, wanted, unit in (
        ("dac_bits", found.dac_bits, amplifier.dac_bits, "bits"),
        ("dac_full_scale", found.full_scale_ua * 1e-6, amplifier.dac_full_scale, "A"),
    ):
        same = wanted is not None and math.isclose(has, wanted, rel_tol=0.0, abs_tol=5e-7)
        fix = "" if same else f"amplifier.{name}: {has:g}"
        text = f"{has:g} {unit}" if same else f"{has:g} {unit}, the config says {wanted} {unit}"
        yield Finding(name, Level.GOOD if same else Level.BAD, text, "" if same else "the daemon refuses to start", fix)
    yield Finding("counter", Level.GOOD, f"{found.counter_bits} bits")
    wanted_ms = board.options.watchdog_ms
    fits = found.watchdog_min_ms <= wanted_ms <= found.watchdog_max_ms
    text = f"{found.watchdog_min_ms} to {found.watchdog_max_ms} ms, driver.watchdog_ms = {wanted_ms} ms"
    fix = "" if fits else f"driver.watchdog_ms between {found.watchdog_min_ms} and {found.watchdog_max_ms}"
    yield Finding("watchdog range", Level.GOOD if fits else Level.BAD, text, "", fix)


def round_trips(board: Board) -> list[float]:
    """Times from SAMPLE to its reply, µs."""
    times = []
    for _ in range(EXCHANGES):
        begin = time.perf_counter()
        board.sample()
        times.append((time.perf_counter() - begin) * 1e6)
        time.sleep(PAUSE_S)
    return times


def round_trip(times_us: Sequence[float], config: Config) -> Finding:
    """Finding: the round-trip times compared with the servo period."""
    p50, p99, largest = (percentile(times_us, fraction) or 0.0 for fraction in (0.5, 0.99, 1.0))
    text = f"{p50:.0f} µs median, {p99:.0f} µs p99, {largest:.0f} µs max, from Python"
    period_us = config.period * 1e6
    if p50 > 0.8 * period_us:
        fix = f"servo.rate_hz at most {0.8e6 / p50:.0f}, a faster driver.baud, or a USB adapter with a shorter latency"
        return Finding("round trip", Level.BAD, text, f"a reply is awaited for {0.8 * period_us:.0f} µs", fix)
    if p99 > 0.8 * period_us:
        return Finding("round trip", Level.NOTE, text, "some exchanges will be missed; 'hapticd latency' counts them")
    return Finding("round trip", Level.GOOD, text)


def inputs(board: Board) -> Iterator[Finding]:
    """Faults and stop input, as reported by the board."""
    board.command(board.middle, enable=False)
    status = board.sample().status
    names = [name for bit, name in _FAULT_NAMES.items() if status & bit]
    if names:
        fix = "encoder supply and wires, the amplifier's fault line, the stop circuit: hapticd help device_fault"
        yield Finding("fault inputs", Level.BAD, ", ".join(names), "the board refuses to enable", fix)
    else:
        yield Finding("fault inputs", Level.GOOD, "none active")


def knob(board: Board, config: Config, operator: Operator) -> Iterator[Finding]:
    """Test the counter while the knob is turned by hand, then its direction."""
    if not operator.does(f"Turn the knob back and forth, slowly, then as fast as you ever will, for {TURN_S:.0f} s"):
        yield Finding("encoder", Level.NOTE, "not tested: nobody to turn the knob")
        return
    least, most, fastest, failed = _turned(board, operator)
    if failed:
        matters = f"an edge came too soon at {fastest:.0f} counts/s, or a wire is broken"
        yield Finding("encoder", Level.BAD, "ENCODER_FAULT while turning", matters, "turn slower, or a faster counter")
    elif most == least:
        yield Finding("encoder", Level.BAD, "the counter did not move", "no position, no spring", "supply, A and B")
    else:
        per_period = fastest * config.period
        limit = config.safety.encoder_jump
        text = f"{most - least} counts from end to end, {fastest:.0f} counts/s at most"
        level = Level.NOTE if limit and per_period > limit else Level.GOOD
        yield Finding("encoder", level, text, "" if level is Level.GOOD else "faster than safety.encoder_jump admits")
    before = board.counts
    if operator.does("Turn the knob a little in the direction that you call positive, and hold it there"):
        board.sample()
        yield direction_of(board.counts - before, config)


def _turned(board: Board, operator: Operator) -> tuple[int, int, float, bool]:
    """Least and most counts since the start, the largest rate in counts/s, and whether ENCODER_FAULT occurred."""
    board.sample()
    start = last = least = most = board.counts
    fastest, failed = 0.0, False
    end = time.monotonic() + TURN_S
    before = time.monotonic()
    while before < end:
        time.sleep(SHOW_S)
        failed |= bool(board.sample().status & messages.STATUS_ENCODER_FAULT)
        now = time.monotonic()
        rate = (board.counts - last) / (now - before)
        fastest = max(fastest, abs(rate))
        least, most = min(least, board.counts), max(most, board.counts)
        operator.shows(board.counts - start, rate, fastest)
        last, before = board.counts, now
    return least - start, most - start, fastest, failed


def direction_of(moved: int, config: Config) -> Finding:
    """Which way the position went when the shaft was turned by so many raw counts."""
    signed = -moved if config.encoder.invert else moved
    if moved == 0:
        return Finding("direction", Level.NOTE, "the knob was not turned")
    if signed > 0:
        return Finding("direction", Level.GOOD, f"positive turns count up ({signed:+d})")
    fix = f"encoder.invert: {str(not config.encoder.invert).lower()}, or change A and B"
    return Finding(
        "direction", Level.NOTE, f"positive turns count down ({signed:+d})", "signs are yours to choose", fix
    )


def watchdog(board: Board, operator: Operator) -> Finding:
    """Enable at zero current, then send nothing, and check that the board switches itself off."""
    name, wanted = "watchdog", board.options.watchdog_ms
    if not operator.agrees("Switch the output stage on, at zero current, to see the watchdog switch it off?"):
        return Finding(name, Level.NOTE, "not tested: it needs the output stage on")
    board.session.configure(wanted, board.capabilities)
    board.command(board.middle, enable=False)
    board.sample()
    board.command(board.middle, enable=True)
    first = board.sample()
    if not first.status & messages.STATUS_ENABLED:
        return Finding(name, Level.BAD, f"the board does not enable (status {first.status:#04x})")
    end = time.monotonic() + 2.0 * wanted * 1e-3 + REPLY_S
    reply = first
    while reply.status & messages.STATUS_ENABLED and time.monotonic() < end:
        reply = board.sample()  # SAMPLEs do not keep it alive
    tripped_ms = ((reply.board_time_us - first.board_time_us) & 0xFFFFFFFF) * 1e-3
    board.off()
    if reply.status & messages.STATUS_ENABLED or not reply.status & messages.STATUS_WATCHDOG:
        fix = "do not connect a motor to this board"
        return Finding(name, Level.BAD, f"the output is still on after {2 * wanted} ms of silence", "", fix)
    return Finding(name, Level.GOOD, f"off and at mid-scale within {tripped_ms:.1f} ms of {wanted} ms")


def ramp(board: Board, config: Config, operator: Operator, current: float | None) -> Finding:
    """Raise the current slowly to a small peak and back, and check the direction of the counter."""
    name = "polarity"
    continuous = config.amplifier.continuous_current
    largest = continuous or board.capabilities.full_scale_ua * 1e-6
    peak = min(RAMP_FRACTION * largest if current is None else current, largest)
    if not operator.agrees(
        f"Raise the current to {peak:.3g} A and back within {RAMP_S:g} s? The shaft may turn; hands off."
    ):
        return Finding(name, Level.NOTE, "not tested: it needs current in the motor")
    board.session.configure(board.options.watchdog_ms, board.capabilities)
    board.command(board.middle, enable=False)
    board.sample()
    start = board.counts
    furthest = MOVED_FRACTION * (config.encoder.counts_per_rev or 1_000_000)
    reached = 0.0
    try:
        begin = time.monotonic()
        while (elapsed := time.monotonic() - begin) < RAMP_S:
            reached = peak * (1.0 - abs(2.0 * elapsed / RAMP_S - 1.0))
            board.command(board.code(reached), enable=True)
            time.sleep(RAMP_STEP_S)
            status = board.sample().status
            if status & (messages.STATUS_FAULTS | messages.STATUS_UNCONFIGURED):
                return Finding(name, Level.BAD, f"the board stopped at {reached:.3g} A (status {status:#04x})")
            if abs(board.counts - start) > furthest:
                break
    finally:
        board.off()
    moved = board.counts - start
    if abs(moved) < 2:
        fix = f"--current above {peak:.3g}, if the motor may have it"
        return Finding(
            name, Level.NOTE, f"no motion up to {peak:.3g} A", "friction holds the shaft, or no current", fix
        )
    if moved < 0:
        fix = "change the motor's two wires, or the encoder's A and B"
        matters = "the spring would push away from its origin, and run away"
        return Finding(name, Level.BAD, f"positive current counts down ({moved:+d})", matters, fix)
    return Finding(name, Level.GOOD, f"positive current counts up ({moved:+d} by {reached:.3g} A)")


def histogram(times_us: Sequence[float], width: int = 40) -> list[str]:
    """Lines of a histogram with buckets of a factor √2, µs."""
    if not times_us:
        return []
    buckets: dict[int, int] = {}
    for value in times_us:
        bucket = math.floor(2.0 * math.log2(max(value, 1.0)))
        buckets[bucket] = buckets.get(bucket, 0) + 1
    most = max(buckets.values())
    return [
        f"{2.0 ** (bucket / 2):8.0f} … {2.0 ** ((bucket + 1) / 2):6.0f} µs "
        f"{'█' * math.ceil(width * buckets.get(bucket, 0) / most):{width}} {buckets.get(bucket, 0)}"
        for bucket in range(min(buckets), max(buckets) + 1)
    ]
