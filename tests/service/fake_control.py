"""A stand-in for the daemon: the real config, made-up motion, and a way to be slow."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hapticd.client import Client
from hapticd.config import LIVE_KEYS, apply_settings, config_digest, load_config
from hapticd.control.endpoints import Endpoints, JsonDict
from hapticd.service.api import ApiServer
from hapticd.service.live import LiveStream
from hapticd.service.refusals import DriverFailure, Refused
from hapticd.service.socket import bind
from hapticd.servo import excitation
from hapticd.servo.authority import Authority, Command
from tests.polling import PATIENCE_S

PERCENTILES = {"p50": 18.0, "p99": 40.0, "p999": 380.0, "max": 500.0}
PACE = {"ticks": 12345, "missed": 2, "exchanges_missed": 1, "wake_us": PERCENTILES, "exec_us": PERCENTILES}
LATELY = {
    "ticks": 9000,
    "missed": 0,
    "exchanges_missed": 0,
    "wake_us": PERCENTILES,
    "exec_us": PERCENTILES,
    "verdict": "keeps up: lateness and execution take 76 % of a period at p99.9",
    "span_s": 10.0,
}
CIRCUMSTANCES = {
    "remedy": "when the rig is safe, 'hapticd clear'",
    "time": "2026-01-02T03:04:05.678+00:00",
    "config": "rig.yaml",
    "config_digest": "0123456789ab",
    "not_latched": None,
    "from_before": True,
}
FAULT = {
    "code": "over_speed",
    "cause": "speed 401 rad/s is above 400 rad/s",
    "help": "hapticd help over_speed",
    **CIRCUMSTANCES,
}

ADMITTED = {
    "verdict": "admitted",
    "reason": "region A: globally stable",
    "region": "A",
    "force": False,
    "predicted": None,
}


@dataclass(frozen=True)
class Halted:
    """A stop that was obeyed at once."""

    answer: JsonDict

    def poll(self) -> JsonDict:
        return self.answer


class FakeControl(Endpoints):
    """Overrides every endpoint, as the daemon does."""

    def __init__(self) -> None:
        self.live = LiveStream()
        self.authority = Authority()
        self.reset()

    def reset(self) -> None:
        """As at its start."""
        self.resolved = load_config(None)
        self.state = "off"
        self.fault: JsonDict | None = None
        self.calls: list[tuple[Any, ...]] = []
        self.job: JsonDict = {"id": 0, "kind": None, "state": "idle", "progress": 0.0, "result": None}
        self.job_states: list[tuple[str, float]] = [("running", 0.5), ("done", 1.0)]
        self.job_result: JsonDict = {"outcome": "decaying"}
        self.velocity = 0.0
        self.gate = threading.Event()
        self.gate.set()
        self.waiting = threading.Event()
        self.fails_with: Exception | None = None

    def _enter(self, *call: Any) -> None:
        self.calls.append(call)
        if not self.gate.is_set():
            self.waiting.set()
            self.gate.wait(PATIENCE_S)
        if self.fails_with is not None:
            raise self.fails_with

    def metrics(self) -> str:
        return "hapticd_ticks_total 1.0\n"

    def status(self) -> JsonDict:
        return {
            "state": self.state,
            "fault": self.fault,
            "config_digest": config_digest(self.resolved),
            "timing": {
                "rate_hz": 1000.0,
                **PACE,
                "verdict": "does not keep up: 2 periods missed",
                "last_10_s": LATELY,
                "last_60_s": {**LATELY, "span_s": 60.0},
            },
            "operating_point": {"mu": 523.3, "beta": 0.75, "sigma": 1.0, "tau_d": 0.0, "region": "A"},
            "position": 0.0155,
            "enable": {"required": False, "held": None},
            "position_unknown": None,
            "limits_off": [],
            "log_lines_dropped": 0,
            "position_ticks": 20.25,
            "velocity": self.velocity,
            "current": 0.5,
            "current_measured": None,
            "force": 0.01,
            "passivity": {"mode": "off"}
            | dict.fromkeys(("put_out_J", "generated_J", "excess_J", "dissipated_J", "current")),
            "encoder_counts": 12,
            "origin_counts": 0,
            "settings_epoch": 0,
            "latency_s": 0.0,
            "units": {"position": "rad", "velocity": "rad/s", "current": "A", "force": "N m"},
            "energy": {
                "estimate": "through the model",
                **{
                    f"{name}_J": 1e-6
                    for name in ("stored", "stored_at_start", "dissipated", "generated", "settings", "unexplained")
                },
            },
            "recorder": {
                "path": None,
                "rows": 0,
                "dropped": 0,
                "state": "off",
                "error": None,
                "continued": None,
                "notes": [],
            },
            "self_check": [],
            "experiment": self.job,
        }

    def config(self) -> JsonDict:
        return self.resolved.model_dump(mode="json")

    def start(self, force: bool = False, *, command: Command | None = None) -> JsonDict:
        self._enter("start", *self._forced(force))
        if self.fault:
            raise Refused("fault", "a fault is latched (over_speed); check the rig, then 'hapticd clear'")
        self.state = "running"
        return {**self.status(), "guard": ADMITTED}

    def stop(self) -> JsonDict:
        self.calls.append(("stop",))
        self.state = "off"
        return self.status()

    def estop(self) -> JsonDict:
        self.calls.append(("estop",))
        self.state = "fault"
        self.fault = {"code": "estop", "cause": "software stop", "help": "hapticd help estop", **CIRCUMSTANCES}
        return self.status()

    def halt(self, name: str) -> Halted:
        self.authority.stop()
        return Halted(getattr(self, name)())

    def log_later(self, write: Callable[[], None]) -> None:
        write()

    def clear(self, *, command: Command | None = None) -> JsonDict:
        self._enter("clear")
        self.state, self.fault = "off", None
        return self.status()

    def set(self, settings: dict[str, Any], force: bool = False, *, command: Command | None = None) -> JsonDict:
        self._enter("set", settings, *self._forced(force))
        changed = apply_settings(self.resolved, settings, source="request")
        for key in settings:
            if not any(key == live or (live.endswith("*") and key.startswith(live[:-1])) for live in LIVE_KEYS):
                raise Refused(
                    "restart_needed", f"{key}: cannot change while the daemon runs; edit the config and restart"
                )
        self.resolved = changed
        return {"applied": settings, "config_digest": config_digest(changed), "guard": None}

    def origin(self, force: bool = False, *, command: Command | None = None) -> JsonDict:
        self._enter("origin", *self._forced(force))
        return {"applied": {"spring.origin": 0.5}, "config_digest": config_digest(self.resolved), "guard": None}

    def release(
        self, deflection: float, duration_s: float | None = None, force: bool = False, *, command: Command | None = None
    ) -> JsonDict:
        self._enter("release", deflection, duration_s, *self._forced(force))
        self._begin("release")
        return {
            "experiment": 1,
            "achieved_deflection": deflection,
            "soft_start_s": 0.0,
            "duration_s": duration_s or 3.0,
            "run": "/r/release.arrow",
            "guard": ADMITTED,
        }

    def excite(
        self, name: str = "all", *, force: bool = False, command: Command | None = None, **options: Any
    ) -> JsonDict:
        self._enter("excite", name, options, *self._forced(force))
        excitation.build(self.resolved, name, **options)
        self._begin(name)
        return {"experiment": 1, "duration_s": 20.0, "run": "/r/excite.arrow", "guard": ADMITTED}

    def sequence(
        self, steps: list[JsonDict], name: str = "sequence", force: bool = False, *, command: Command | None = None
    ) -> JsonDict:
        self._enter("sequence", steps, name, *self._forced(force))
        self._begin("sequence")
        job = {"experiment": 1, "duration_s": 3.0, "run": "/r/sequence-1.arrow", "guard": ADMITTED}
        return {**job, "sequence": name, "steps": len(steps)}

    def experiment(self) -> JsonDict:
        if self.job["state"] == "running":
            state, progress = self.job_states.pop(0)
            result = None if state == "running" else self.job_result
            self.job = {**self.job, "state": state, "progress": progress, "result": result}
        return self.job

    def record_start(self, path: str | None = None, *, trusted: bool = False) -> JsonDict:
        self._enter("record_start", path, *(("trusted",) if trusted else ()))
        return {"path": path or "/r/run.arrow", "rows": 0, "dropped": 0, "error": None, "continued": None, "notes": []}

    def record_stop(self) -> JsonDict:
        self._enter("record_stop")
        raise Refused("recording", "nothing is being recorded")

    def note(self, text: str) -> JsonDict:
        self._enter("note", text)
        return {"path": "/r/run.arrow", "event": "note", "tick": 7}

    def marker(self, name: str, value: Any = None) -> JsonDict:
        self._enter("marker", name, value)
        return {"path": "/r/run.arrow", "event": "marker", "tick": 8}

    def reload(
        self, path: str | None = None, force: bool = False, *, trusted: bool = False, command: Command | None = None
    ) -> JsonDict:
        self._enter("reload", path, *self._forced(force))
        if path is not None:
            self.resolved = load_config(path)
        if path == "omega":
            raise DriverFailure("reload failed: no board answers on /dev/ttyUSB0")
        return {**self.status(), "guard": None}

    @staticmethod
    def _forced(force: bool) -> tuple[str, ...]:
        return ("force",) if force else ()

    def _begin(self, kind: str) -> None:
        self.state = "running"
        self.job = {"id": 1, "kind": kind, "state": "running", "progress": 0.0, "result": None}


def renew(control: FakeControl, client: Client) -> None:
    """A control that is served goes to the next test as at its start; what the last one left hanging has ended."""
    control.fails_with = None
    control.gate.set()
    client.clear()  # commands are answered one after another
    control.reset()


@contextlib.contextmanager
def serve(control: FakeControl, path: Path) -> Iterator[Client]:
    """The API of ``control`` on a socket, and a client of it."""
    server = ApiServer(control, bind(path))
    server.start()
    try:
        yield Client(path)
    finally:
        control.gate.set()
        server.stop()
