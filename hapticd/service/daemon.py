"""The daemon's life: it owns the rig, beats the heart, latches faults, and answers the control API.

The supervisor thread touches the servo loop only through control words and the mailbox; the API's threads touch it only
through the methods below, one at a time, except :meth:`Daemon.estop` and :meth:`Daemon.status`, which never wait.
"""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import drivers
from drivers import DriverError
from hapticd.config import Config, apply_settings, config_digest, load_config
from hapticd.record import RecordingError
from hapticd.service import experiments, metrics, report
from hapticd.service.control import DriverFailure, JsonDict, Refused
from hapticd.service.experiments import Experiment
from hapticd.service.latch import FaultLatch
from hapticd.service.notify import Notifier, TickWatchdog
from hapticd.service.rig import Rig
from hapticd.service.settings import changed_keys, is_live
from hapticd.servo import excitation, faults
from hapticd.servo import layout as w

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
        self._latch = latch
        self._lock = threading.RLock()
        self._experiment: Experiment | None = None
        self._estops = 0
        self._fault_lock = threading.RLock()
        self._ending = threading.Event()
        self._auto_recording = False
        self._faults_latched: Counter[str] = Counter()
        self._fault = latch.load()
        self._rig = Rig(config, self._fault["number"] if self._fault else 0)
        self._watchdog = TickWatchdog(notifier or Notifier(None), lambda: self._rig.core.load(w.C_TICKS))
        self._supervisor = threading.Thread(target=self._supervise, name="hapticd-supervisor", daemon=True)
        self._supervisor.start()

    @property
    def rig(self) -> Rig:
        """The rig in force."""
        return self._rig

    def status(self) -> JsonDict:
        """State, fault, timing, operating point, motion, energies, recorder, experiment."""
        return report.status(self._rig, self._fault_now(), self.experiment())

    def config(self) -> JsonDict:
        """The config in force."""
        return self._rig.config.model_dump(mode="json")

    def metrics(self) -> bytes:
        """Numbers for Prometheus."""
        return metrics.exposition(self._rig, self.status(), dict(self._faults_latched))

    def start(self) -> JsonDict:
        """off → ready → running; refused while a fault is latched."""
        with self._lock:
            permit = self._rig.permit()
            self._refuse_fault()
            self._refuse_experiment()
            self._refuse_far_start()
            if self._rig.state != w.RUNNING:
                self._begin_recording("run")
                try:
                    self._run_loop(permit)
                except BaseException:
                    self._end_recording()
                    raise
        return self.status()

    def stop(self) -> JsonDict:
        """Zero current, then amplifier off; ends a running experiment. The motor is off before anything is waited for."""
        self._rig.halt()
        with self._lock:
            self._rig.halt()
            self._cancel_experiment()
            stopped = self._rig.wait(lambda: self._rig.state in (w.OFF, w.FAULT), _ANSWER_S) and self._rig.wait_ticks(2)
            self._end_recording()
        if not stopped:
            raise DriverFailure("the servo loop does not answer; cut the power of the amplifier")
        return self.status()

    def estop(self) -> JsonDict:
        """Zero current in the next tick and a latched fault. Takes no lock."""
        self._estops += 1
        rig = self._rig
        rig.core.store(w.C_ESTOP, self._estops)
        rig.halt()
        if not (rig.wait(lambda: rig.state == w.FAULT, _ANSWER_S) and rig.wait_ticks(1)):
            raise DriverFailure("the servo loop does not answer; cut the power of the amplifier")
        return self.status()

    def clear(self) -> JsonDict:
        """Clear the latched fault; refused when it comes straight back."""
        with self._lock:
            if self._rig.state != w.FAULT:
                return self.status()
            self._cancel_experiment()
            before = self._rig.fault_number
            self._rig.ask(state=w.OFF, clear=self._rig.request.clear + 1, excitation_id=0, excitation_length=0)
            self._rig.wait(self._rig.applied, _ANSWER_S)
            self._rig.wait_ticks(int(self._rig.config.safety.missed_exchanges or 0) + 3)
            if self._rig.state == w.FAULT:
                with self._fault_lock:
                    # It may be another one by now.
                    self._fault = None
                    self._note_fault()
                cause = self._fault["cause"] if self._fault else faults.KINDS[before].code
                raise Refused("fault_persists", f"the fault is still there: {cause}")
            with self._fault_lock:
                if self._rig.state != w.FAULT:
                    self._fault = None
                    self._latch.remove()
            log.info("fault cleared")
        return self.status()

    def set(self, settings: dict[str, Any]) -> JsonDict:
        """Change live settings, all together between two ticks."""
        with self._lock:
            config = apply_settings(self._rig.config, settings, source="settings")
            applied = self._apply_live(config, moves_origin="spring.origin" in settings)
            return {"applied": applied, "config_digest": config_digest(config)}

    def release(self, deflection: float, duration_s: float | None) -> JsonDict:
        """The Fig. 8 experiment: the origin is moved, never the shaft; from rest, at zero current."""
        with self._lock:
            rig = self._rig
            decimation = rig.config.encoder.decimation
            self._check_deflection(round(deflection * decimation))
            permit = self._prepare_experiment()
            counts = experiments.wait_for_rest(rig, permit)
            origin = counts - round(deflection * decimation)
            achieved = (counts - origin) / decimation
            experiment = Experiment("release", duration_s or experiments.RELEASE_DURATION_S)
            rig.ask(origin_counts=origin)
            path = experiments.start_recording(rig, "release")

            def conclude() -> dict[str, Any]:
                found = experiments.release_result(path, decimation, origin, rig.fault_number)
                return {"achieved_deflection": achieved, **found}

            self._launch(experiment, path, permit, lambda: experiment.elapsed_s() >= experiment.duration_s, conclude)
            return {
                "experiment": experiment.id,
                "achieved_deflection": achieved,
                "duration_s": experiment.duration_s,
                "run": str(path),
            }

    def excite(self, name: str, options: dict[str, Any]) -> JsonDict:
        """Play an identification experiment about the shaft's present position."""
        with self._lock:
            rig = self._rig
            table = excitation.build(rig.config, name, **options)
            ticks = table.shape[1]
            if ticks > rig.core.excitation.shape[1]:
                longest = rig.core.excitation.shape[1] / rig.config.servo.rate_hz
                raise excitation.ExcitationError(f"{name} would last too long at this rate: at most {longest:.0f} s")
            permit = self._prepare_experiment()
            counts = experiments.wait_for_rest(rig, permit)
            experiment = Experiment(f"excite {name}", ticks / rig.config.servo.rate_hz)
            rig.core.excitation[:, :ticks] = table
            rig.ask(origin_counts=counts, excitation_id=experiment.id, excitation_length=ticks)
            path = experiments.start_recording(rig, f"excite-{name}")

            def finished() -> bool:
                return rig.core.load(w.C_EXCITATION_DONE) == experiment.id

            self._launch(experiment, path, permit, finished, lambda: {"excitation": name, "ticks": ticks})
            return {"experiment": experiment.id, "duration_s": experiment.duration_s, "run": str(path)}

    def experiment(self) -> JsonDict:
        """The newest experiment."""
        experiment = self._experiment
        return experiment.report() if experiment else dict(experiments.IDLE)

    def record_start(self, path: str | None) -> JsonDict:
        """Record to a path or to a new file of the run directory."""
        with self._lock:
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

    def reload(self, path: str | None) -> JsonDict:
        """Read the config anew. Live keys change at once; others replace the rig, which must be off."""
        source = path or self._source
        config = load_config(source)
        with self._lock:
            fixed = sorted(key for key in changed_keys(self._rig.config, config) if not is_live(key))
            if not fixed:
                self._apply_live(config, moves_origin=False)
            else:
                self._replace_rig(config, fixed)
            self._source = source
        log.info("configuration %s reloaded", source or "re35 (built in)")
        return self.status()

    def quench(self) -> None:
        """Zero current and amplifier off at once, and nobody can start it again: the first step of every end."""
        self._rig.halt(for_good=True)

    def shutdown(self) -> None:
        """Zero current, amplifier off, everything released. Safe to call twice."""
        self.quench()
        with self._lock:
            self._cancel_experiment()
            self._ending.set()
            self._note_fault()
            self._rig.close()
        self._supervisor.join(2.0)

    def _fault_now(self) -> JsonDict | None:
        if self._rig.state != w.FAULT:
            return None
        fault = self._fault or self._described_fault()
        return {key: fault[key] for key in ("code", "cause", "help")}

    def _described_fault(self) -> JsonDict:
        rig = self._rig
        number = rig.fault_number or faults.ESTOP
        value, limit = float(rig.core.snapshot[w.S_FAULT_VALUE]), float(rig.core.snapshot[w.S_FAULT_LIMIT])
        return faults.describe(number, value, limit, is_linear=rig.config.is_linear, detail=rig.driver.error)

    def _supervise(self) -> None:
        while not self._ending.wait(_BEAT_S):
            self._rig.servo.beat()
            self._watchdog.look(time.monotonic())
            try:
                self._note_fault()
                if not self._rig.servo.alive() and not self._ending.is_set() and self._lock.acquire(blocking=False):
                    try:
                        self._servo_died()
                    finally:
                        self._lock.release()
            except Exception:
                log.exception("the supervisor goes on after an error")

    def _servo_died(self) -> None:
        rig = self._rig
        if rig.servo.alive() or rig.state == w.FAULT:
            return
        log.critical("the servo thread has ended by itself; closing the driver")
        rig.driver.close()
        with self._fault_lock:
            # The loop is gone, so its words are ours to write.
            rig.core.store(w.C_FAULT_CODE, faults.DRIVER_ERROR)
            rig.core.store(w.C_STATE, w.FAULT)
            detail = "the servo thread ended by itself; restart the daemon"
            self._latch_fault(faults.describe(faults.DRIVER_ERROR, -1, 0, is_linear=False, detail=detail))

    def _note_fault(self) -> None:
        """Latch a new fault on disk, say it once, keep the 10 s before it."""
        with self._fault_lock:
            if self._rig.state == w.FAULT and self._fault is None and self._rig.fault_number:
                self._latch_fault(self._described_fault())

    def _latch_fault(self, fault: JsonDict) -> None:
        self._fault = fault
        self._faults_latched[fault["code"]] += 1
        fields = {"fault": fault["code"], "cause": fault["cause"], "help": fault["help"]}
        log.error("fault %s: %s (%s)", fault["code"], fault["cause"], fault["help"], extra={"journal": fields})
        try:
            self._latch.store(fault)
        except OSError as error:
            log.error("the fault cannot be latched across a restart: %s: %s", self._latch.path, error.strerror)
        # Off the supervisor's thread, which must go on beating while the disk works.
        threading.Thread(target=self._keep_history, args=(fault["code"],), name="hapticd-history", daemon=True).start()

    def _keep_history(self, code: str) -> None:
        time.sleep(0.1)
        try:
            path = self._rig.recorder.dump_history(code)
            log.info("the 10 s before the fault are in %s", path)
        except RecordingError as error:
            log.error("the 10 s before the fault could not be kept: %s", error)
        finally:
            self._end_recording()

    def _refuse_fault(self) -> None:
        if self._rig.state == w.FAULT:
            fault = self._fault_now()
            cause = f"{fault['code']}: {fault['cause']}" if fault else "a fault"
            raise Refused("fault", f"a fault is latched ({cause}); look at the rig, then 'hapticd clear'")

    def _refuse_experiment(self) -> None:
        if self._experiment and self._experiment.state == "running":
            raise Refused(
                "busy", f"experiment {self._experiment.id} ({self._experiment.kind}) is running; 'hapticd stop' ends it"
            )

    def _prepare_experiment(self) -> int:
        """Off, at rest as far as the loop is concerned, no recording of its own; returns a permit to run."""
        self._refuse_fault()
        self._refuse_experiment()
        rig = self._rig
        permit = rig.halt()
        rig.wait(lambda: rig.state == w.OFF, _ANSWER_S)
        self._end_recording()
        return permit

    def _launch(
        self,
        experiment: Experiment,
        path: Path,
        permit: int,
        finished: Callable[[], bool],
        conclude: Callable[[], dict[str, Any]],
    ) -> None:
        try:
            self._run_loop(permit)
        except BaseException:
            self._rig.recorder.stop()
            raise
        experiment.begin()
        self._experiment = experiment
        experiment.thread = threading.Thread(
            target=experiments.run_job,
            args=(experiment, self._rig, path, finished, conclude),
            name="hapticd-experiment",
            daemon=True,
        )
        experiment.thread.start()

    def _run_loop(self, permit: int) -> None:
        """Ask for running and wait until the loop renders, or says why not."""
        rig = self._rig
        timeout = (rig.config.safety.enable_timeout_s or 60.0) + _ANSWER_S
        if rig.run(permit):
            rig.wait(lambda: rig.state in (w.RUNNING, w.FAULT) or rig.halted_since(permit), timeout)
        if rig.halted_since(permit):
            raise Refused("stopped", "stopped before it began")
        if rig.state == w.FAULT:
            self._note_fault()
            self._refuse_fault()
        if rig.state != w.RUNNING:
            rig.halt()
            raise DriverFailure(f"the servo loop did not begin to render within {timeout:g} s")

    def _cancel_experiment(self) -> None:
        experiment = self._experiment
        if experiment and experiment.thread and experiment.state == "running":
            experiment.cancelled.set()
            experiment.thread.join(5.0)

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

    def _check_deflection(self, counts: int) -> None:
        config = self._rig.config
        limit, unit = config.safety.max_excursion, "m" if config.is_linear else "rad"
        asked = abs(counts) * config.raw_resolution
        if limit and asked > limit:
            raise Refused(
                "excursion", f"a deflection of {asked:.4g} {unit} is beyond safety.max_excursion = {limit:g} {unit}"
            )

    def _apply_live(self, config: Config, *, moves_origin: bool) -> dict[str, Any]:
        changed = changed_keys(self._rig.config, config)
        fixed = sorted(key for key in changed if not is_live(key))
        if fixed:
            raise Refused(
                "restart_needed",
                f"{', '.join(fixed)}: cannot change while the daemon runs; edit the config and restart",
            )
        if changed.keys() & {"servo.rate_hz", "encoder.decimation", "spring.origin"}:
            self._refuse_experiment()
        if "servo.rate_hz" in changed and (reason := self._rig.driver.check_rate(config.servo.rate_hz)):
            raise Refused("driver", f"servo.rate_hz = {config.servo.rate_hz:g} Hz: {reason}; the rate in force stays")
        self._rig.ask(config, **({"origin_counts": None} if moves_origin or "spring.origin" in changed else {}))
        self._rig.wait(self._rig.applied, _ANSWER_S)
        if changed:
            with contextlib.suppress(RecordingError):
                self._rig.recorder.annotate(
                    {"event": "set", "tick": self._rig.core.load(w.C_TICKS), "changed": changed}
                )
        return changed

    def _replace_rig(self, config: Config, fixed: list[str]) -> None:
        if self._rig.state in (w.READY, w.RUNNING):
            raise Refused(
                "restart_needed",
                f"{', '.join(fixed)}: cannot change while the spring is rendered; 'hapticd stop' first",
            )
        self._cancel_experiment()
        if any(key.startswith("api.") for key in fixed):
            raise Refused("restart_needed", f"{', '.join(fixed)}: cannot change without a restart of the daemon")
        try:
            drivers.create(config)
        except DriverError as error:
            raise Refused("driver", f"{error}; the configuration in force stays") from error
        old, estops = self._rig, self._estops
        old.close()
        try:
            self._rig = Rig(config, old.fault_number)
        except Exception as error:
            log.error("the new configuration failed (%s); going back to the old one, with a latched fault", error)
            with self._fault_lock:
                self._latch_fault(faults.describe(faults.RELOAD_FAILED, 0.0, 0.0, is_linear=False, detail=str(error)))
                try:
                    self._rig = Rig(old.config, faults.RELOAD_FAILED)
                except Exception:
                    log.critical("the old configuration failed too; the daemon ends", exc_info=True)
                    self.dead = True
            raise DriverFailure(f"reload failed: {error}") from error
        if self._estops != estops:
            self._rig.core.store(w.C_ESTOP, self._estops)

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
