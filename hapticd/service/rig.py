"""One rig: an open driver, its servo thread, and the recorder that empties its ring.

A reload with another driver replaces the whole rig. It does not depend on experiments or on the network.
"""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import drivers
from hapticd.config import config_digest
from hapticd.record import Recorder, run_metadata
from hapticd.record.frames import Context
from hapticd.record.schema import Rows
from hapticd.service.flight import open_ring
from hapticd.servo import atomics, layout
from hapticd.servo.core import ALONE, Request, parameters
from hapticd.servo.thread import ServoThread
from hapticd.stability.energy_replay import EnergyEstimate

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from drivers.interface import Driver
    from hapticd.config import Config
    from hapticd.record.flight import FlightRing
    from hapticd.service.live import LiveStream
    from hapticd.servo.authority import Command
    from hapticd.servo.realtime import Grant

log = logging.getLogger(__name__)

_POLL_S = 0.002


def opened_driver(config: Config) -> Driver:
    """The driver of a configuration, open.

    Raises:
        DriverError: the device cannot be opened.
    """
    driver = drivers.create(config)
    try:
        driver.open()
    except BaseException:
        driver.close()
        raise
    return driver


class Rig:
    """Driver, servo thread and recorder of one configuration.

    Args:
        config: the present configuration.
        latched_fault: fault number from before a restart, or 0.
        live: the live stream; None for none.
        name: of this daemon, for its flight recorder; empty for no flight recorder.
        driver: an open driver; None: it is opened here.
        position_known: False if the encoder may have restarted since the origin was set.
        words: of the authority over motion (`hapticd.servo.authority`); None: commands are never revoked.
        estops_obeyed: by the previous rig. i2t: of the motor at the start, A² s.

    Raises:
            DriverError: the device cannot be opened.
            RealtimeError: real-time scheduling is required, and the system refuses it.
    """

    def __init__(
        self,
        config: Config,
        latched_fault: int = 0,
        live: LiveStream | None = None,
        name: str = "",
        driver: Driver | None = None,
        *,
        position_known: bool = True,
        words: NDArray[np.int64] | None = None,
        estops_obeyed: int = 0,
        i2t: float = 0.0,
    ) -> None:
        self.config = config
        self.request = Request()
        self.driver = opened_driver(config) if driver is None else driver
        self.flight: FlightRing | None = None
        self.flight_grant: Grant | None = None
        if name:
            self.flight, self.flight_grant = open_ring(config, name)
        self.servo = ServoThread(
            config,
            self.driver,
            self._parameters(),
            latched_fault,
            self.flight,
            words=words,
            estops_obeyed=estops_obeyed,
            i2t=i2t,
        )
        self.closed = False
        """Whether its loop has ended, with zero current and the amplifier off."""
        self.core = self.servo.core
        self._asking = threading.Lock()
        self._live = live
        self._rows_taken = 0
        self.guard: dict[str, Any] | None = None
        """The stability guard's last judgement for this rig; it is stored in every run."""
        self.position_known = position_known
        """If False, nothing is rendered before the origin is set again."""
        self.settings_epoch = 0
        """Number of changes of config and origin since the start of this rig."""
        # Before the servo: when the loop runs, it needs the supervisor's heartbeat soon.
        self.energy = EnergyEstimate(config, self.driver.latency_s, self.origin_counts)
        self._energy_settings = (config, self.origin_counts)
        self._described: Any = None
        self._describe()
        self.recorder = Recorder(
            self._drain,
            self.core.dropped,
            self.core.history,
            self._metadata,
            Path(config.record.directory),
        )
        try:
            self.servo.start()
        except BaseException:
            self.recorder.shutdown()
            self.driver.close()
            if self.flight is not None:
                self.flight.remove()
            raise

    def _parameters(self) -> np.void:
        return parameters(self.config, self.request, latency_s=self.driver.latency_s)

    def _drain(self) -> Iterator[Rows]:
        """Rows for the recorder. Energies are updated with each batch; a changed setting applies within one batch."""
        self._describe()
        for rows in self.core.drain_batches():
            settings = (self.config, self.origin_counts)
            if settings != self._energy_settings:
                self._energy_settings = settings
                self.energy.configure(self.config, self.driver.latency_s, self.origin_counts)
            self.energy.update(rows)
            self._show(rows)
            yield rows

    def _describe(self) -> None:
        """Update the metadata in the flight recorder, if they have changed."""
        if self.flight is not None and self._described != (now := (self.config, self.origin_counts, self.guard)):
            self._described = now
            self.flight.describe(self._metadata())

    def _show(self, rows: Rows) -> None:
        """Pass the rows to the live stream, if it has readers; dropped rows are counted in the row numbers."""
        self._rows_taken += len(rows)
        if self._live is not None and self._live.watched:
            first = self._rows_taken + self.core.dropped() - len(rows)
            decimation, period = self.config.encoder.decimation, self.config.period
            context = Context(first, self.settings_epoch, decimation, period, self.origin_counts, time.time())
            self._live.put(rows, context)

    def _metadata(self) -> dict[str, Any]:
        return run_metadata(
            self.config.model_dump(mode="json"),
            linear=self.config.is_linear,
            config_digest=config_digest(self.config),
            driver=self.driver.describe(),
            latency_s=self.driver.latency_s,
            origin_counts=self.origin_counts,
            guard=self.guard,
        )

    @property
    def grants(self) -> list[Grant]:
        """The requested real-time features, and whether they were granted."""
        return self.servo.grants + ([] if self.flight_grant is None else [self.flight_grant])

    @property
    def origin_counts(self) -> int:
        """Raw count of the spring's origin."""
        moved = self.request.origin_counts
        return self.config.origin_counts if moved is None else moved

    @property
    def state(self) -> int:
        """State of the loop."""
        return self.core.load(atomics.MODE)

    @property
    def fault_number(self) -> int:
        """Number of the latched fault, 0 for none."""
        return self.core.load(atomics.FAULT_CODE)

    @property
    def device_lost(self) -> bool:
        """Whether the driver has reported a lost device, before or after another fault."""
        return self.core.load(atomics.DEVICE_LOST) != 0

    @property
    def held(self) -> bool:
        """Whether the enable input is held, as last reported by the device."""
        return self.core.load(atomics.HELD) != 0

    def position_unknown(self) -> str | None:
        """Why the origin's position is unknown, and what to do; None if it is known."""
        if self.position_known:
            return None
        return (
            "the device was opened again, and its encoder may have begun to count anew: set the spring's origin, "
            "'hapticd origin' for where the shaft is now"
        )

    @property
    def counts(self) -> int:
        """Encoder counts of the last tick."""
        return self.core.load(atomics.COUNTS)

    def ask(self, config: Config | None = None, **changes: Any) -> None:
        """Publish a changed request or config, or both, as one parameter set."""
        with self._asking:
            self._publish(config, changes)

    def switch_off(self) -> None:
        """Request ``off``, without revoking waiting commands. Does not wait."""
        self.ask(state=layout.OFF, **ALONE)

    def run(self, command: Command, **rendered: Any) -> None:
        """Request ``running`` for a command, in the atomic step in which the command begins.

        Args:
            command: the command.
            rendered: fields of the request (`hapticd.servo.core.Request`) that are rendered in addition to the spring;
                earlier requests are discarded.

        Raises:
            Withdrawn: it may not begin any more; nothing is asked.
        """
        with self._asking:
            command.begin(
                lambda ordinal: self._publish(None, {**ALONE, **rendered, "state": layout.RUNNING, "ordinal": ordinal})
            )

    def change(self, command: Command, config: Config, **changes: Any) -> None:
        """Apply another config for a command, in the atomic step in which the command begins.

        Raises:
            Withdrawn: it may not begin any more; nothing is asked.
        """
        with self._asking:
            command.begin(lambda _: self._publish(config, changes))

    @contextlib.contextmanager
    def origin_at(self, counts: int) -> Iterator[None]:
        """Move the origin; restore it if the body fails."""
        before, known = self.request.origin_counts, self.position_known
        self.ask(origin_counts=counts)
        try:
            yield
        except BaseException:
            self.ask(origin_counts=before)
            self.position_known = known
            raise

    def clear(self, command: Command) -> None:
        """Request ``off`` and clear the fault, in the atomic step in which the command begins. Does not wait.

        Raises:
            Withdrawn: it may not begin any more; nothing is asked.
        """
        with self._asking:
            command.begin(lambda ordinal: self._publish(None, {**ALONE, "state": layout.OFF, "clear": ordinal}))

    def fade_out(self, rendered: Request, fault: tuple[int, float, float]) -> None:
        """Fade the force out, then raise a fault in the loop; no effect if another command has begun meanwhile.

        Args:
            rendered: the request to the loop. fault: number, value and limit.
        """
        self._change_rendered(rendered, faded=True)
        fading_s = self.config.safety.soft_start_s or 0.0
        self.wait(lambda: self.state != layout.RUNNING, fading_s + 3.0 * self.config.period)
        self._change_rendered(rendered, fault=fault)

    def _change_rendered(self, rendered: Request, **changes: Any) -> None:
        """Publish changes of a request, if its command is still rendering."""
        with self._asking:
            if (self.request.ordinal, self.request.state) == (rendered.ordinal, layout.RUNNING):
                self._publish(None, changes)

    def _publish(self, config: Config | None, changes: dict[str, Any]) -> None:
        if config is not None or "origin_counts" in changes:
            self.settings_epoch += 1
        if "origin_counts" in changes:
            self.position_known = True
        if config is not None:
            self.config = config
        self.request = replace(self.request, **changes)
        self.core.publish(self._parameters())

    def wait_ticks(self, ticks: int) -> bool:
        """Wait until the loop has done this number of ticks; False on a time-out."""
        target = self.core.load(atomics.TICKS) + ticks
        return self.wait(lambda: self.core.load(atomics.TICKS) >= target, 1.0 + ticks * self.config.period)

    def wait(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Poll until ``condition`` is true; False on a time-out."""
        deadline = time.monotonic() + timeout_s
        while not condition():
            if time.monotonic() > deadline:
                return False
            time.sleep(_POLL_S)
        return True

    def applied(self) -> bool:
        """Whether the loop uses the newest parameter set."""
        return self.core.load(atomics.APPLIED) == self.core.load(atomics.SEQUENCE)

    def close(self, before_removal: Callable[[], None] = lambda: None) -> None:
        """Zero current, amplifier off, thread and recording ended, device released; failures are logged.

        Args:
            before_removal: saves data of the flight recorder; called after the loop has ended, before its removal.
        """
        ended = self.servo.stop()
        if not ended:
            log.error(
                "the servo thread does not answer; the driver is closed anyway, so that the device gets no command"
            )
        try:
            self.driver.close()
        except Exception:
            log.exception("closing the driver failed")
        self.closed = ended
        self.recorder.shutdown()
        if ended:
            before_removal()
            if self.flight is not None:
                self.flight.remove()
