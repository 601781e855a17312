"""The daemon's life: it owns the rig, beats the heart, latches faults, and answers the control API.

The supervisor thread touches the servo loop only through shared atomics and the mailbox; the API's threads touch it only
through the methods below, one at a time, except :meth:`Daemon.estop` and :meth:`Daemon.status`, which never wait.
"""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from pathlib import Path
from typing import Any

import drivers
from drivers import DriverError
from hapticd.config import Config, apply_settings, config_digest, load_config
from hapticd.record import RecordingError
from hapticd.service import metrics, report
from hapticd.service.control import JsonDict
from hapticd.service.experiments import Experiments
from hapticd.service.fault_manager import FaultManager
from hapticd.service.latch import FaultLatch, is_service
from hapticd.service.live import LiveStream
from hapticd.service.notify import Notifier, TickWatchdog
from hapticd.service.refusals import DriverFailure, Refused
from hapticd.service.rig import Rig
from hapticd.service.settings import changed_keys, is_live
from hapticd.servo import atomics, faults
from hapticd.servo import layout as w
from hapticd.stability.guard import Judgement, judge
from hapticd.stability.numbers import from_config

log = logging.getLogger(__name__)

_BEAT_S = 0.05
_ANSWER_S = 1.0


class Daemon:
    """Satisfies :class:`hapticd.service.control.Control`.

    Args:
        config: resolved configuration.
        source: where it came from, for a reload; None: the built-in testbed.
        latch: the fault that survives a restart.
        notifier: the service manager whose watchdog wants to be fed.

    Raises:
        DriverError: the device cannot be opened.
        RealtimeError: real time is required and refused.
    """

    def __init__(self, config: Config, source: str | None, latch: FaultLatch, notifier: Notifier | None = None) -> None:
        self.dead = False
        """True when there is no working rig left; the process must end."""
        self._source = source
        self._lock = threading.RLock()
        self._estops = 0
        self._ending = threading.Event()
        self._auto_recording = False
        self._faults = FaultManager(latch, lambda: self._rig, self._end_recording)
        self.live = LiveStream()
        self._experiments = Experiments(
            lambda: self._rig, self._admit_experiment, self._prepare_experiment, self._run_loop
        )
        self._name = latch.name
        self._rig = Rig(config, self._faults.number, self.live, self._name)
        self._watchdog = TickWatchdog(notifier or Notifier(None), lambda: self._rig.core.load(atomics.TICKS))
        self._supervisor = threading.Thread(target=self._supervise, name="hapticd-supervisor", daemon=True)
        self._supervisor.start()

    @property
    def rig(self) -> Rig:
        """The rig in force."""
        return self._rig

    def status(self) -> JsonDict:
        """State, fault, timing, operating point, motion, energies, recorder, experiment."""
        return report.status(self._rig, self._faults.now(), self.experiment())

    def config(self) -> JsonDict:
        """The config in force."""
        return self._rig.config.model_dump(mode="json")

    def metrics(self) -> bytes:
        """Numbers for Prometheus."""
        return metrics.exposition(self._rig, self.status(), dict(self._faults.counts))

    def start(self, force: bool = False) -> JsonDict:
        """off → ready → running; refused while a fault is latched, or by the guard."""
        with self._lock:
            token = self._rig.run_token()
            self._faults.refuse()
            self._experiments.refuse_running()
            self._rig.wait_ticks(1)  # until then nobody knows where the shaft is
            self._refuse_far_start()
            judgement = None
            if self._rig.state != w.RUNNING:
                config = self._rig.config
                judgement = self._admit(config, deflection_of(self._rig, config, self._rig.origin_counts), force=force)
                self._rig.guard = judgement
                self._begin_recording("run")
                try:
                    self._run_loop(token)
                except BaseException:
                    self._end_recording()
                    raise
        return {**self.status(), "guard": judgement}

    def stop(self) -> JsonDict:
        """Zero current, then amplifier off; ends a running experiment. The motor is off before anything is waited for."""
        self._rig.halt()
        with self._lock:
            self._rig.halt()
            self._experiments.cancel()
            stopped = self._rig.wait(lambda: self._rig.state in (w.OFF, w.FAULT), _ANSWER_S) and self._rig.wait_ticks(2)
            self._end_recording()
        if not stopped:
            raise DriverFailure("the servo loop does not answer; cut the power of the amplifier")
        return self.status()

    def estop(self) -> JsonDict:
        """Zero current in the next tick and a latched fault. Takes no lock."""
        self._estops += 1
        rig = self._rig
        rig.core.store(atomics.ESTOP, self._estops)
        rig.halt()
        if not (rig.wait(lambda: rig.state == w.FAULT, _ANSWER_S) and rig.wait_ticks(1)):
            raise DriverFailure("the servo loop does not answer; cut the power of the amplifier")
        return self.status()

    def clear(self) -> JsonDict:
        """Clear the latched fault; refused when it comes straight back."""
        with self._lock:
            if self._rig.state != w.FAULT:
                return self.status()
            self._experiments.cancel()
            before = self._rig.fault_number
            self._rig.ask(state=w.OFF, clear=self._rig.request.clear + 1, excitation_id=0, excitation_length=0)
            self._rig.wait(self._rig.applied, _ANSWER_S)
            self._rig.wait_ticks(int(self._rig.config.safety.missed_exchanges or 0) + 3)
            self._faults.cleared(before)
            log.info("fault cleared")
        return self.status()

    def set(self, settings: dict[str, Any], force: bool = False) -> JsonDict:
        """Change live settings, all together between two ticks."""
        with self._lock:
            config = apply_settings(self._rig.config, settings, source="settings")
            applied, judgement = self._apply_live(config, moves_origin="spring.origin" in settings, force=force)
            return {"applied": applied, "config_digest": config_digest(config), "guard": judgement}

    def release(self, deflection: float, duration_s: float | None, force: bool = False) -> JsonDict:
        """The Fig. 8 experiment."""
        with self._lock:
            return self._experiments.release(deflection, duration_s, force)

    def excite(self, name: str, options: dict[str, Any], force: bool = False) -> JsonDict:
        """Play an identification experiment."""
        with self._lock:
            return self._experiments.excite(name, options, force)

    def experiment(self) -> JsonDict:
        """The newest experiment."""
        return self._experiments.report()

    def record_start(self, path: str | None, trusted: bool = False) -> JsonDict:
        """Record to a path or to a new file of the run directory."""
        with self._lock:
            if path is not None and not (trusted and not is_service()):
                refuse_outside(Path(path), self._rig.recorder.directory)
            try:
                self._rig.recorder.start(path, "record")
            except RecordingError as error:
                raise Refused("recording", str(error)) from error
            self._auto_recording = False
            return self._rig.recorder.status()

    def record_stop(self) -> JsonDict:
        """Stop recording."""
        with self._lock:
            try:
                path = self._rig.recorder.stop()
            except RecordingError as error:
                raise Refused("recording", str(error)) from error
            if path is None:
                raise Refused("recording", "nothing is being recorded")
            return {**self._rig.recorder.status(), "path": str(path)}

    def reload(self, path: str | None, force: bool = False) -> JsonDict:
        """Read the config anew. Live keys change at once; others replace the rig, which must be off."""
        source = path or self._source
        config = load_config(source)
        with self._lock:
            fixed = sorted(key for key in changed_keys(self._rig.config, config) if not is_live(key))
            if not fixed:
                _, judgement = self._apply_live(config, moves_origin=False, force=force)
            else:
                judgement = self._replace_rig(config, fixed, force)
            self._source = source
        log.info("configuration %s reloaded", source or "re35 (built in)")
        return {**self.status(), "guard": judgement}

    def disable(self) -> None:
        """Zero current and amplifier off at once, and nobody can start it again: the first step of every end."""
        self._rig.halt(final=True)

    def shutdown(self) -> None:
        """Zero current, amplifier off, everything released. Safe to call twice."""
        self.disable()
        with self._lock:
            self._experiments.cancel()
            self._ending.set()
            self._faults.note()
            self._rig.close()
        self._supervisor.join(2.0)

    def _supervise(self) -> None:
        while not self._ending.wait(_BEAT_S):
            self._rig.servo.beat()
            self._watchdog.look(time.monotonic())
            try:
                self._faults.note()
                if not self._rig.servo.alive() and not self._ending.is_set() and self._lock.acquire(blocking=False):
                    try:
                        self._faults.servo_died()
                    finally:
                        self._lock.release()
            except Exception:
                log.exception("the supervisor goes on after an error")

    def _admit(
        self, config: Config, deflection: float | None, *, release: bool = False, force: bool = False
    ) -> JsonDict:
        """Ask the guard about a config, and a motion from rest at a deflection in coarse ticks; its answer as data.

        Raises:
            Refused: the motion would not die out.
        """
        latency_s = self._rig.driver.latency_s
        return self._enforce(judge(config, latency_s, deflection=deflection, release=release, force=force))

    def _enforce(self, judgement: Judgement) -> JsonDict:
        if judgement.verdict == "refused":
            raise Refused(
                "unstable",
                f"{judgement.reason}; nothing is started or changed\n{judgement.help}\n"
                "Render it all the same: --force (API: force)",
            )
        if judgement.verdict in ("forced", "warned"):
            log.warning("%s by the stability guard: %s", judgement.verdict, judgement.reason)
        return judgement.document

    def _admit_experiment(self, deflection: float, *, release: bool, force: bool) -> None:
        """Nothing in the way of an experiment that begins at rest at this deflection in coarse ticks."""
        self._faults.refuse()
        self._experiments.refuse_running()
        self._rig.guard = self._admit(self._rig.config, deflection, release=release, force=force)

    def _prepare_experiment(self) -> int:
        """Off, at rest as far as the loop is concerned, no recording of its own; returns a run token."""
        rig = self._rig
        token = rig.halt()
        rig.wait(lambda: rig.state == w.OFF, _ANSWER_S)
        self._end_recording()
        return token

    def _run_loop(self, token: int) -> None:
        """Ask for running and wait until the loop renders, or says why not."""
        rig = self._rig
        timeout = (rig.config.safety.enable_timeout_s or 60.0) + _ANSWER_S
        if rig.run(token):
            rig.wait(lambda: rig.state in (w.RUNNING, w.FAULT) or rig.is_revoked(token), timeout)
        if rig.is_revoked(token):
            raise Refused("stopped", "stopped before it began")
        if rig.state == w.FAULT:
            self._faults.note()
            self._faults.refuse()
        if rig.state != w.RUNNING:
            rig.halt()
            raise DriverFailure(f"the servo loop did not begin to render within {timeout:g} s")

    def _refuse_far_start(self) -> None:
        rig = self._rig
        limit = rig.config.safety.max_excursion
        unit = "m" if rig.config.is_linear else "rad"
        away = (rig.counts - rig.origin_counts) * rig.config.raw_resolution
        if limit and abs(away) > limit:
            here = rig.counts * rig.config.raw_resolution
            raise Refused(
                "excursion",
                f"the shaft is {away:.4g} {unit} from the spring's origin, beyond safety.max_excursion = {limit:g} {unit}; "
                f"bring it back, or move the origin to it: 'hapticd set spring.origin={here:.4g}'",
            )

    def _apply_live(self, config: Config, *, moves_origin: bool, force: bool) -> tuple[dict[str, Any], JsonDict | None]:
        """Put live settings into force; the changed keys, and what the guard says if the theory sees a change."""
        changed = changed_keys(self._rig.config, config)
        fixed = sorted(key for key in changed if not is_live(key))
        if fixed:
            raise Refused(
                "restart_needed",
                f"{', '.join(fixed)}: cannot change while the daemon runs; edit the config and restart",
            )
        if changed.keys() & {"servo.rate_hz", "encoder.decimation", "spring.origin"}:
            self._experiments.refuse_running()
        if "servo.rate_hz" in changed and (reason := self._rig.driver.check_rate(config.servo.rate_hz)):
            raise Refused("driver", f"servo.rate_hz = {config.servo.rate_hz:g} Hz: {reason}; the rate in force stays")
        moves_origin = moves_origin or "spring.origin" in changed
        judgement = self._admit_change(config, moves_origin, force)
        self._rig.ask(config, **({"origin_counts": None} if moves_origin else {}))
        self._rig.wait(self._rig.applied, _ANSWER_S)
        if changed:
            with contextlib.suppress(RecordingError):
                self._rig.recorder.annotate(
                    {"event": "set", "tick": self._rig.core.load(atomics.TICKS), "changed": changed, "guard": judgement}
                )
        return changed, judgement

    def _admit_change(self, config: Config, moves_origin: bool, force: bool) -> JsonDict | None:
        """Judge live settings: with the shaft where it is if the spring is rendered. None: the theory sees no change."""
        rig = self._rig
        latency_s, rendered = rig.driver.latency_s, rig.state in (w.READY, w.RUNNING)
        same_point = from_config(rig.config, latency_s) == from_config(config, latency_s)
        if same_point and not (rendered and moves_origin):
            return None
        origin = config.origin_counts if moves_origin else rig.origin_counts
        rig.guard = self._admit(config, deflection_of(rig, config, origin) if rendered else None, force=force)
        return rig.guard

    def _replace_rig(self, config: Config, fixed: list[str], force: bool) -> JsonDict:
        if self._rig.state in (w.READY, w.RUNNING):
            raise Refused(
                "restart_needed",
                f"{', '.join(fixed)}: cannot change while the spring is rendered; 'hapticd stop' first",
            )
        self._experiments.cancel()
        if any(key.startswith("api.") for key in fixed):
            raise Refused("restart_needed", f"{', '.join(fixed)}: cannot change without a restart of the daemon")
        try:
            latency_s = drivers.create(config).latency_s
        except DriverError as error:
            raise Refused("driver", f"{error}; the configuration in force stays") from error
        judgement = self._enforce(judge(config, latency_s, force=force))
        old, estops = self._rig, self._estops
        old.close()
        try:
            self._rig = Rig(config, old.fault_number, self.live, self._name)
        except Exception as error:
            log.error("the new configuration failed (%s); going back to the old one, with a latched fault", error)
            with self._faults.lock:
                self._faults.keep(faults.describe(faults.RELOAD_FAILED, 0.0, 0.0, is_linear=False, detail=str(error)))
                try:
                    self._rig = Rig(old.config, faults.RELOAD_FAILED, self.live, self._name)
                except Exception:
                    log.critical("the old configuration failed too; the daemon ends", exc_info=True)
                    self.dead = True
            raise DriverFailure(f"reload failed: {error}") from error
        if self._estops != estops:
            self._rig.core.store(atomics.ESTOP, self._estops)
        return judgement

    def _begin_recording(self, label: str) -> None:
        if not self._rig.config.record.enabled:
            return
        try:
            self._rig.recorder.start(None, label)
            self._auto_recording = True
        except RecordingError as error:
            log.warning("this run is not recorded: %s", error)

    def _end_recording(self) -> None:
        if self._auto_recording:
            self._auto_recording = False
            with contextlib.suppress(RecordingError):
                self._rig.recorder.stop()


def refuse_outside(path: Path, directory: Path) -> None:
    """Refuse a recording outside the directory that the config names, whatever links lead out of it.

    Raises:
        Refused: with both.
    """
    if not path.parent.resolve().is_relative_to(directory.resolve()):
        raise Refused(
            "outside",
            f"{path} is outside record.directory {directory}; only the daemon's own user may record elsewhere, and nobody "
            "with a daemon that is a service",
        )


def deflection_of(rig: Rig, config: Config, origin_counts: int) -> float:
    """How far the shaft is from an origin, in the coarse ticks of a config: the middle of its raw count."""
    return (rig.counts - origin_counts + 0.5) / config.encoder.decimation
