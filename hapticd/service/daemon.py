"""The daemon: owns the rig, sends the heartbeat, latches faults, and implements the control API.

The supervisor thread accesses the servo loop only through shared atomics and the mailbox. The API's threads access it only
through the methods below, one at a time, except stops and :meth:`Daemon.status`, which never wait.
"""

from __future__ import annotations

import contextlib
import itertools
import logging
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hapticd.config import LIVE_KEYS, Config, apply_settings, config_digest, load_config, preset_names
from hapticd.config.limits import limits_off
from hapticd.control.endpoints import MOTION_S, PREPARED_MOTION_S, Endpoints, JsonDict
from hapticd.record import RecordingError
from hapticd.service import _metrics, checks, report
from hapticd.service._replacement import Replacement
from hapticd.service.background import Background
from hapticd.service.experiments import Experiments
from hapticd.service.fault_manager import FaultManager
from hapticd.service.flight import heat_left
from hapticd.service.further_starts import FurtherStarts
from hapticd.service.halting import Halt
from hapticd.service.heat import Heat
from hapticd.service.latch import FaultLatch, is_service
from hapticd.service.live import LiveStream
from hapticd.service.notify import Notifier, TickWatchdog
from hapticd.service.recent import RecentTiming
from hapticd.service.reconnect import Reconnector
from hapticd.service.refusals import Refused
from hapticd.service.rendering import ANSWER_S, Rendering
from hapticd.service.rig import Rig
from hapticd.service.self_check import SelfCheck
from hapticd.servo import atomics, layout
from hapticd.servo.authority import Authority, Command
from hapticd.servo.stop_channel import StopChannel
from hapticd.stability.guard import same_loop

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivers.interface import Driver

log = logging.getLogger(__name__)

BEAT_S = 0.05
_BEATS_A_SECOND = 20


class Daemon(Endpoints):
    """`Endpoints` of one rig, with its supervision.

    Args:
        config: resolved configuration.
        source: file or preset of the configuration, for a reload; None: the built-in testbed.
        latch: the fault that survives a restart.
        notifier: the service manager, for its watchdog.
        lines_dropped: returns the number of lost lines of the log.

    Attributes:
        superseded: the daemon that has replaced this one; None otherwise.

    Raises:
        DriverError: the device cannot be opened.
        RealtimeError: real-time scheduling is required, and the system refuses it.
        RuntimeError: a thread cannot be created; all threads are created here.
    """

    def __init__(
        self,
        config: Config,
        source: str | None,
        latch: FaultLatch,
        notifier: Notifier | None = None,
        lines_dropped: Callable[[], int] = int,
    ) -> None:
        self._source = source
        self.superseded: str | None = None
        self._lines_dropped = lines_dropped
        self._lock = threading.RLock()
        self._ending = threading.Event()
        self.live = LiveStream()
        self._recent = RecentTiming()
        self.authority = Authority()
        self.stop_channel = StopChannel(self.authority.words, max(1, config.servo.priority - 1))
        self._heat = Heat(latch.name)
        i2t = self._heat.before(config, heat_left(config, latch.name))
        rig = Rig(config, latch.number, self.live, latch.name, words=self.authority.words, i2t=i2t)
        self._rendering = Rendering(rig, self.authority)
        self._tidying = Background("hapticd-tidy")
        self._faults = FaultManager(latch, self._rendering, lambda: source_name(self._source))
        self._experiments = Experiments(self._rendering, self._faults)
        self._further_starts = FurtherStarts(self._rendering)
        self._replacement = Replacement(self._rendering, self._faults, self._experiments, self.live, self._heat)
        self._watchdog = TickWatchdog(notifier or Notifier(None), lambda: self.rig.core.load(atomics.TICKS))
        self._heat.follow(lambda: self.rig.core.i2t)
        self._reconnector = Reconnector(lambda: self.rig, self._faults.is_latched, self._take_over)
        self._supervisor = threading.Thread(target=self._supervise, name="hapticd-supervisor", daemon=True)
        self.self_check = SelfCheck()
        self.self_check.add("threads", checks.threads(self._threads))
        self.self_check.add("flight_recorder", checks.flight_recorder(lambda: self.rig))
        self.self_check.add("run_file", checks.run_file(lambda: self.rig.recorder))
        self.self_check.add("room", checks.RoomCheck(lambda: self.rig.config, lambda: self.rig.recorder), slow=True)
        self.self_check.add("limits", checks.limits(lambda: limits_off(self.rig.config)))
        self.self_check.add("link", checks.link(lambda: self.rig.driver.remarks()))
        self._supervisor.start()

    @property
    def rig(self) -> Rig:
        """The present rig."""
        return self._rendering.rig

    @property
    def dead(self) -> bool:
        """Whether the process must end: there is no working rig, or another daemon has replaced this one."""
        return self._replacement.dead or self.superseded is not None

    def supersede(self, by: str) -> None:
        """Another daemon has replaced this one: zero current at once, no further start, and the process ends.

        Args:
            by: the other daemon.
        """
        self.authority.end()
        self.superseded = by

    def status(self) -> JsonDict:
        """State, fault, timing, operating point, motion, energies, recorder, experiment."""
        status = report.status(self.rig, self._faults.active(), self.experiment(), self._recent, self._lines_dropped())
        return {**status, "self_check": self.self_check.document()}

    def config(self) -> JsonDict:
        """The present config."""
        return self.rig.config.model_dump(mode="json")

    def metrics(self) -> str:
        """Numbers for Prometheus."""
        return _metrics.exposition(self.rig, self.status(), dict(self._faults.counts))

    def start(self, force: bool = False, *, command: Command | None = None) -> JsonDict:
        """off → ready → running; refused while a fault is latched, or by the guard."""
        command = command or self.authority.arrived(MOTION_S)
        with self._lock:
            command.refuse()
            self._faults.refuse()
            self._experiments.refuse_running()
            self.rig.wait_ticks(1)  # the first tick reads the position
            self._rendering.refuse_place()
            judgement = None
            if self.rig.state != layout.RUNNING:
                config = self.rig.config
                judgement = self._rendering.admit(
                    config,
                    deflection_of(self.rig, config, self.rig.origin_counts),
                    origin_counts=self.rig.origin_counts,
                    force=force,
                )
                self.rig.guard = judgement
                self._rendering.begin_recording("run", command)
                try:
                    self._rendering.run(command, self._faults.refuse_new)
                except BaseException:
                    self._rendering.end_recording()
                    raise
        return {**self.status(), "guard": judgement}

    def stop(self) -> JsonDict:
        """Zero current, then amplifier off; ends a running experiment. The motor is off before it waits for anything."""
        return self.halt("stop").wait()

    def estop(self) -> JsonDict:
        """Zero current in the next tick and a latched fault."""
        return self.halt("estop").wait()

    def halt(self, name: str) -> Halt:
        """Stop at once, by one store that the tick reads; the returned object gives the answer.

        Args:
            name: ``stop`` or ``estop``.
        """
        return Halt(self._rendering, latches=name == "estop", is_tidy=self._is_tidy, status=self.status)

    def log_later(self, write: Callable[[], None]) -> None:
        """Write to the log from another thread."""
        self._tidying.ask(write)

    def _is_tidy(self) -> bool:
        """Whether the experiment and the recording that a stop has ended are closed."""
        return not (self._experiments.is_running() or self._rendering.records_revoked())

    def clear(self, *, command: Command | None = None) -> JsonDict:
        """Clear the latched fault; refused if it returns at once, or was raised after the command arrived."""
        command = command or self.authority.arrived(MOTION_S)
        with self._lock:
            command.refuse()
            if self.rig.state != layout.FAULT:
                return self.status()
            self._experiments.cancel()
            before = self.rig.fault_number
            self.rig.clear(command)
            self.rig.wait(self.rig.applied, ANSWER_S)
            self.rig.wait_ticks(int(self.rig.config.safety.missed_exchanges or 0) + 3)
            self._faults.confirm_cleared(before)
            log.info("fault cleared")
        return self.status()

    def set(self, settings: dict[str, Any], force: bool = False, *, command: Command | None = None) -> JsonDict:
        """Change live settings, all of them between the same two ticks."""
        command = command or self.authority.arrived(MOTION_S)
        with self._lock:
            command.refuse()
            config = apply_settings(self.rig.config, settings, source="settings")
            applied, judgement = self._apply_live(
                config, command, moves_origin="spring.origin" in settings, force=force
            )
            return {"applied": applied, "config_digest": config_digest(config), "guard": judgement}

    def origin(self, force: bool = False, *, command: Command | None = None) -> JsonDict:
        """Move the spring's origin to where the shaft is."""
        here = self.rig.counts * self.rig.config.raw_resolution
        return self.set({"spring.origin": here}, force, command=command)

    def release(
        self, deflection: float, duration_s: float | None = None, force: bool = False, *, command: Command | None = None
    ) -> JsonDict:
        """The Fig. 8 experiment."""
        command = command or self.authority.arrived(PREPARED_MOTION_S)
        with self._lock:
            command.refuse()
            return self._experiments.release(command, deflection, duration_s, force)

    def excite(
        self, name: str = "all", *, force: bool = False, command: Command | None = None, **options: Any
    ) -> JsonDict:
        """Play an identification experiment."""
        given = {key: value for key, value in options.items() if value is not None}
        command = command or self.authority.arrived(PREPARED_MOTION_S)
        with self._lock:
            command.refuse()
            return self._experiments.excite(command, name, given, force)

    def sequence(
        self, steps: list[JsonDict], name: str = "sequence", force: bool = False, *, command: Command | None = None
    ) -> JsonDict:
        """Releases one after another, each with its settings."""
        command = command or self.authority.arrived(PREPARED_MOTION_S)
        with self._lock:
            command.refuse()
            return self._experiments.sequence(command, steps, name, force)

    def experiment(self) -> JsonDict:
        """The newest experiment."""
        return self._experiments.report()

    def record_start(self, path: str | None = None, *, trusted: bool = False) -> JsonDict:
        """Record to a path or to a new file of the run directory."""
        with self._lock:
            if path is not None and not (trusted and not is_service()):
                refuse_outside(Path(path), self.rig.recorder.directory)
            self.rig.recorder.start(path, "record")
            self._rendering.leave_recording()
            return self.rig.recorder.status()

    def record_stop(self) -> JsonDict:
        """Stop recording."""
        with self._lock:
            path = self.rig.recorder.stop()
            if path is None:
                raise Refused("recording", "nothing is being recorded")
            return {**self.rig.recorder.status(), "path": str(path)}

    def note(self, text: str) -> JsonDict:
        """A note in the running recording."""
        return self._noted({"event": "note", "text": text})

    def marker(self, name: str, value: Any = None) -> JsonDict:
        """A marker in the running recording."""
        return self._noted({"event": "marker", "name": name, "value": value})

    def _noted(self, event: JsonDict) -> JsonDict:
        rig = self.rig
        tick = rig.core.load(atomics.TICKS) + rig.core.load(atomics.MISSED_PERIODS)
        path = rig.recorder.note({**event, "tick": tick})
        if path is None:
            raise Refused("recording", "nothing is being recorded; 'hapticd record start' starts a recording")
        return {"path": str(path), "event": event["event"], "tick": tick}

    def reload(
        self, path: str | None = None, force: bool = False, *, trusted: bool = True, command: Command | None = None
    ) -> JsonDict:
        """Read the config again. Live keys change at once; other keys need a new rig, and the motor must be off."""
        command = command or self.authority.arrived(PREPARED_MOTION_S)
        source = path or self._source
        if not trusted:
            refuse_file(path, self._source)
        config = load_config(source)
        with self._lock:
            command.refuse()
            if not trusted and path is not None and path != self._source:
                config = config.model_copy(update={"record": self.rig.config.record})
            fixed = sorted(key for key in changed_keys(self.rig.config, config) if not is_live(key))
            if not fixed:
                _, judgement = self._apply_live(config, command, moves_origin=False, force=force)
            else:
                command.begin(lambda _: None)
                judgement = self._replacement.with_config(config, fixed, force)
            self._source = source
        log.info("configuration %s reloaded", source_name(source))
        return {**self.status(), "guard": judgement}

    def disable(self) -> None:
        """Zero current and amplifier off at once, and no further start: the first step of every shutdown."""
        self.authority.end()
        self.self_check.end()  # first, else it would bind the removed sockets again

    def shutdown(self) -> None:
        """Zero current, amplifier off, all resources released. Safe to call twice."""
        self.disable()
        self._reconnector.end()
        with self._lock:
            self._experiments.cancel()
            self._ending.set()
            self._faults.latch_raised()
            self.rig.close(self._heat.end)
            self._faults.close()
        self.stop_channel.end()
        self._supervisor.join(2.0)

    def _threads(self) -> dict[str, bool]:
        """Name of each thread to whether it runs; without the servo thread, whose end is a fault."""
        return {
            **self.rig.recorder.alive(),
            **self.self_check.alive(),
            self._supervisor.name: self._supervisor.is_alive(),
            "hapticd-stop": self.stop_channel.alive(),
            "hapticd-heat": self._heat.alive(),
            "hapticd-reconnect": self._reconnector.alive(),
            **self._faults.alive(),
            **self._experiments.alive(),
            **self._further_starts.alive(),
            "hapticd-tidy": self._tidying.alive(),
        }

    def _supervise(self) -> None:
        for beat in itertools.count():
            if self._ending.wait(BEAT_S):
                return
            self.rig.servo.beat()
            self._watchdog.look(time.monotonic())
            try:
                self._faults.latch_raised()
                if self._rendering.records_revoked() and not self._tidying.busy():
                    self._tidying.ask(self._tidy)
                self._recent.look(self.rig.core, time.monotonic())
                if beat % _BEATS_A_SECOND == 0:
                    self._further_starts.go_on()
                if not self.rig.servo.alive() and not self._ending.is_set() and self._lock.acquire(blocking=False):
                    try:
                        self._faults.servo_died()
                    finally:
                        self._lock.release()
            except Exception:
                log.exception("the supervisor continues after an error")

    def _tidy(self) -> None:
        """Close the recording of a run that a stop has ended; not in the supervisor's thread, because a disk may hang."""
        if self._rendering.records_revoked():
            self._rendering.end_recording()

    def _apply_live(
        self, config: Config, command: Command, *, moves_origin: bool, force: bool
    ) -> tuple[dict[str, Any], JsonDict | None]:
        """Apply live settings; returns the changed keys, and the guard's judgement if the stability depends on them."""
        changed = changed_keys(self.rig.config, config)
        fixed = sorted(key for key in changed if not is_live(key))
        if fixed:
            raise Refused(
                "restart_needed",
                f"{', '.join(fixed)}: cannot change while the daemon runs; edit the config and restart",
            )
        self._experiments.refuse_sequence()
        if changed.keys() & {"servo.rate_hz", "encoder.decimation", "spring.origin"}:
            self._experiments.refuse_running()
        if "servo.rate_hz" in changed and (reason := self.rig.driver.check_rate(config.servo.rate_hz)):
            raise Refused("driver", f"servo.rate_hz = {config.servo.rate_hz:g} Hz: {reason}; the rate in force stays")
        moves_origin = moves_origin or "spring.origin" in changed
        judgement = self._admit_change(config, moves_origin, force)
        self.rig.change(command, config, **({"origin_counts": None} if moves_origin else {}))
        self.rig.wait(self.rig.applied, ANSWER_S)
        if changed:
            with contextlib.suppress(RecordingError):
                self.rig.recorder.annotate(
                    {"event": "set", "tick": self.rig.core.load(atomics.TICKS), "changed": changed, "guard": judgement}
                )
        return changed, judgement

    def _admit_change(self, config: Config, moves_origin: bool, force: bool) -> JsonDict | None:
        """Judge live settings, with the present shaft position if the spring is rendered. None: no effect on stability."""
        rig = self.rig
        latency_s, rendered = rig.driver.latency_s, rig.state in (layout.READY, layout.RUNNING)
        if same_loop(rig.config, config, latency_s) and not (rendered and moves_origin):
            return None
        origin = config.origin_counts if moves_origin else rig.origin_counts
        rig.guard = self._rendering.admit(
            config,
            deflection_of(rig, config, origin) if rendered else None,
            origin_counts=origin if rendered else None,
            force=force,
        )
        return rig.guard

    def _take_over(self, lost: Rig, driver: Driver) -> None:
        """Use the device that was lost and is open again."""
        with self._lock:
            if self.rig is not lost or self._ending.is_set():
                driver.close()
            else:
                self._replacement.on_device(lost, driver)


def source_name(source: str | None) -> str:
    """Display name of a configuration's source."""
    return source or "re35 (built in)"


def refuse_outside(path: Path, directory: Path) -> None:
    """Refuse a recording outside the config's directory, with symbolic links resolved.

    Raises:
        Refused: with both paths.
    """
    if not path.parent.resolve().is_relative_to(directory.resolve()):
        raise Refused(
            "outside",
            f"{path} is outside record.directory {directory}; only the daemon's own user may record elsewhere, and nobody "
            "with a daemon that is a service",
        )


def refuse_file(path: str | None, source: str | None) -> None:
    """Refuse to read a file for a caller, who may have no permission to read it: an error message would quote it.

    Args:
        path: from the caller, or the name of a preset. source: of the present config.

    Raises:
        Refused: with the path.
    """
    if path not in (None, source, *preset_names()):
        raise Refused(
            "outside",
            f"{path}: only the daemon's own user or root may name another file than the one it was started with; "
            f"others may name a preset: {', '.join(preset_names())}",
        )


def deflection_of(rig: Rig, config: Config, origin_counts: int) -> float:
    """Distance of the shaft from an origin, in coarse ticks of a config; the shaft is in the middle of its raw count."""
    return (rig.counts - origin_counts + 0.5) / config.encoder.decimation


def changed_keys(old: Config, new: Config) -> dict[str, Any]:
    """Dotted keys whose values differ, with the new values."""
    before, after = _flat(old.model_dump(mode="json")), _flat(new.model_dump(mode="json"))
    return {key: after.get(key) for key in before.keys() | after.keys() if before.get(key) != after.get(key)}


def _flat(section: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in section.items():
        if isinstance(value, dict):
            flat |= _flat(value, f"{prefix}{key}.")
        else:
            flat[f"{prefix}{key}"] = value
    return flat


def is_live(key: str) -> bool:
    """Whether a dotted key may change between two ticks; other keys need a new rig or a restart."""
    return key in LIVE_KEYS or any(pattern.endswith(".*") and key.startswith(pattern[:-1]) for pattern in LIVE_KEYS)
