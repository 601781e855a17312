"""One daemon under soak: its device, its recordings in turn, its faults, and what its process holds."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self, TypeVar

from hapticd.client import DaemonUnreachable, RequestRefused
from hapticd.config import Config, parse_config
from hapticd.hil.daemon import DaemonProcess
from hapticd.hil.device import Device
from hapticd.hil.errors import HilError
from tests.soak.judge import Sample, SeenFault, Segment, Totals, kept_rows

DRIVERS: Final[dict[str, dict[str, Any]]] = {
    "loopback": {"name": "loopback"},
    "serial": {"name": "serial_dac", "port": "/dev/null"},
    "canopen": {"name": "canopen", "interface": "unix_seqpacket", "channel": "-"},
}
_TOLERATED_S: Final = 0.05
"""So long exchanges may fail in a row."""
_WATCHDOG_MS: Final = 100
_BACK_S: Final = 30.0

T = TypeVar("T")


def config_of(name: str, rate_hz: float) -> Config:
    """The testbed on one of `DRIVERS`.

    The two trips that judge how loaded the machine is would end the soak where it is to count. The board's watchdog time,
    20 ms where nobody says otherwise, is the drive's: what the daemon tolerates, the device must.
    """
    watchdog = {} if name == "loopback" else {"watchdog_ms": _WATCHDOG_MS}
    sections = {
        "driver": {**DRIVERS[name], **watchdog},
        "servo": {"rate_hz": rate_hz, "overrun": {"fault_after": None}},
        "safety": {"missed_exchanges": round(_TOLERATED_S * rate_hz), "heartbeat_timeout_s": 10},
        "record": {"enabled": False},
    }
    return parse_config(sections, "the soak's config")


class Rig:
    """A daemon and its device, from ``with`` to its end; renders and records.

    Args:
        name: of `DRIVERS`.
        rate_hz: of the servo.
        folder: takes everything; a short path, for the socket.
        environment: of the daemon's process, on top of ours.

    Attributes:
        segments: recordings so far.
        faults: those that were seen, in order.
        findings: what should not be, in words.
        ended_by_full_disk: recordings that a full disk ended, as the daemon said.
    """

    def __init__(self, name: str, rate_hz: float, folder: Path, environment: dict[str, str]) -> None:
        self.name, self.rate_hz = name, rate_hz
        self.config = config_of(name, rate_hz)
        self.folder = folder / name
        self._device = None if name == "loopback" else Device(self.config, self.folder / "device", log=False)
        options = {} if self._device is None else self._device.options
        self.daemon = DaemonProcess(self.config, self.folder, options)
        self.daemon.add_environment(environment)
        self.client = self.daemon.client
        self.samples: list[Sample] = []
        self.segments: list[Segment] = []
        self.faults: list[SeenFault] = []
        self.findings: list[str] = []
        self.ended_by_full_disk = 0
        self.settings = 0
        self.status: dict[str, Any] = {}
        self.totals: Totals | None = None
        self._began_s = time.monotonic()
        self._path: Path | None = None
        self._cleared = False
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            if self._device is not None:
                stack.enter_context(self._device)
                self._device.wait_ready()
            stack.enter_context(self.daemon)
            self.daemon.wait_ready()
            self.daemon.runs.mkdir(exist_ok=True)
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    @property
    def alive(self) -> bool:
        """Whether its daemon's process still runs."""
        return self.daemon.running

    @property
    def open_fault(self) -> SeenFault | None:
        """The fault after which the spring is not yet rendered again."""
        return self.faults[-1] if self.faults and self.faults[-1].over_s is None else None

    def now_s(self) -> float:
        """Since the soak began, s."""
        return time.monotonic() - self._began_s

    def begin(self, began_s: float) -> None:
        """Render and record; times count from here on."""
        self._began_s = began_s
        # The daemon's pools make their threads when these are first needed at once: now, or by chance hours later.
        with ThreadPoolExecutor(4) as together:
            list(together.map(lambda _: self.client.status(), range(100)))
        self.daemon.wait_until(self._left_fault, "it rendered", _BACK_S)
        if self._device is not None:
            self._fault_once(self._device)
        self._record(self.daemon.runs)

    def _fault_once(self, device: Device) -> None:
        """What a fault and the run file of the seconds before it need is loaded once: now, or by chance hours later."""
        device.signal(signal.SIGSTOP)
        time.sleep(1.5 * _TOLERATED_S)
        device.signal(signal.SIGCONT)
        self.daemon.wait_state("fault")
        self.daemon.wait_until(self._left_fault, "it rendered again", _BACK_S)

    def _left_fault(self) -> bool:
        self._leave_fault()
        return bool(self.client.status()["state"] == "running")

    def find(self, what: str) -> None:
        """Note what should not be, and say it."""
        self.findings.append(f"{self.now_s():.0f} s: {what}")
        print(f"{self.name}: {self.findings[-1]}", flush=True)

    def ask(self, what: str, question: Callable[[], T]) -> T | None:
        """Ask the daemon something that it must do; a refusal or no answer is a finding."""
        try:
            return question()
        except (RequestRefused, DaemonUnreachable, HilError) as error:
            self.find(f"{what}: {error}")
            return None

    @property
    def processes(self) -> list[int]:
        """Of daemon and device."""
        return [child.pid for child in (self.daemon, self._device) if child is not None]

    def look(self, others: float) -> None:
        """Ask how it is, note what its process holds, and start it again after a fault.

        Args:
            others: share of one processor that others take now.
        """
        status = self.ask("status", self.client.status)
        if status is None:
            return
        self.status = status
        self.ask("metrics", self.client.metrics)
        self.samples.append(Sample.of(self.now_s(), self.daemon.pid))
        self._follow_fault(status, others)

    def _follow_fault(self, status: dict[str, Any], others: float) -> None:
        fault, known = status["fault"], self.open_fault
        if fault is not None:
            if known is None or self._cleared:
                # A fault that came while the one before it was being left behind is another one.
                if known is not None:
                    known.over_s = self.now_s()
                self.faults.append(SeenFault(fault["code"], fault["cause"], self.now_s(), others))
            self._cleared = False
            self._leave_fault()
        elif status["state"] == "running":
            if known is not None:
                known.over_s = self.now_s()
            self._cleared = False
        elif known is None:
            self.find(f"state {status['state']} without a fault")
            self.ask("start", self.client.start)
        elif status["state"] == "off":
            self._leave_fault()

    def _leave_fault(self) -> None:
        """As a person would, who looks a second later whether it helped."""
        try:
            self.client.clear()
            self._cleared = True
            self.client.start()
        except (RequestRefused, DaemonUnreachable):
            pass
        for past in self.daemon.runs.glob("fault-*"):  # the 10 s before it, which are on the recording too
            past.unlink()

    def set(self, settings: dict[str, Any]) -> None:
        """Change settings."""
        if self.ask(f"set {settings}", lambda: self.client.set(settings)) is not None:
            self.settings += 1

    def rotate(self, folder: Path | None = None) -> None:
        """End the recording, go on with the next, there or where recordings go, and take account of the one that ended."""
        ended = self._path
        said = self.ask("record stop", self.client.record_stop)
        self._record(folder or self.daemon.runs)
        if said is not None and ended is not None:
            self._account(ended, said)

    def _record(self, folder: Path) -> None:
        path = folder / f"{self.name}-{time.monotonic_ns()}.arrow"
        begun = self.ask("record start", lambda: self.client.record_start(str(path)))
        self._path = None if begun is None else path

    def _account(self, path: Path, said: dict[str, Any]) -> None:
        if said["state"] == "failed":
            if kept_rows(said["error"]) == said["rows"]:
                self.ended_by_full_disk += 1
            else:
                self.find(f"a recording failed: {said['error']}")
        segment = Segment.read(path, said["rows"], said["dropped"])
        if segment is not None:
            self.segments.append(segment)
        path.unlink()

    def recording_failed(self) -> bool:
        """Whether the recording has ended by itself."""
        status = self.ask("status", self.client.status)
        return status is not None and status["recorder"]["state"] == "failed"

    def end(self) -> None:
        """End the daemon while it records, and take account of that, too."""
        self.daemon.end()
        words = self.daemon.log.read_text(errors="replace")
        self.totals = Totals.of(words)
        if self._path is not None:
            # Of the last recording the daemon tells no rows of its own, only all of them.
            claimed = self.totals.rows - sum(one.rows for one in self.segments)
            segment = Segment.read(self._path, claimed, self.totals.dropped - sum(one.dropped for one in self.segments))
            if segment is not None:
                self.segments.append(segment)
            self._path.unlink()
