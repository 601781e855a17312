"""What the steps work on: the config, the device by the driver or by a daemon, who is there, what is known so far."""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from drivers import DriverError, declared_latency
from hapticd.commission import bench
from hapticd.commission.step import Result, StepError
from hapticd.hil.daemon import DaemonProcess
from hapticd.hil.errors import HilError
from hapticd.hil.suite import patient
from hapticd.hil.witness import Witness

if TYPE_CHECKING:
    from hapticd.commission.bench import Bench
    from hapticd.config import Config
    from hapticd.doctor.board import Operator

IDENTIFIED: Final = "identified.yaml"

Bar = Callable[[str], AbstractContextManager[Callable[[float], None]]]


@dataclass(frozen=True)
class Given:
    """What only a person can know.

    Attributes:
        load: torque or force that a hanging weight or a drawn spring puts on the shaft, against positive motion, N m or N.
        inertia: of all that moves, kg m² or kg.
    """

    load: float | None = None
    inertia: float | None = None


class Rig:
    """A rig on its first day.

    Args:
        config: of the rig. folder: takes the recordings and what was identified.
        operator: who stands at it. say: takes a line about what is going on. bar: makes a progress bar.
        given: what only a person can know. virtual: time of the bench is the simulation's own (driver loopback alone).
    """

    def __init__(
        self,
        config: Config,
        folder: Path,
        operator: Operator,
        say: Callable[[str], None],
        bar: Bar,
        given: Given | None = None,
        *,
        virtual: bool = False,
    ) -> None:
        self.config, self.folder, self.operator, self.say, self.bar, self.given = (
            config,
            folder,
            operator,
            say,
            bar,
            given or Given(),
        )
        self.virtual = virtual
        self.results: dict[str, Result] = {}
        self.seconds = 0.0
        """How long the device has been used."""
        self.missed = 0
        """Failed exchanges and missed periods; one for a driver or a daemon that cannot be started."""
        self._witness: Witness | None = None
        self._daemon: DaemonProcess | None = None
        self._wanted = config
        self._open = ExitStack()

    def __enter__(self) -> Rig:
        return self

    def __exit__(self, *exception: object) -> None:
        self.release()
        if self._witness is not None:
            self._witness.__exit__()
            self._witness = None

    @property
    def rated(self) -> float:
        """The rated current, A.

        Raises:
            StepError: nobody knows it.
        """
        if not self.config.amplifier.continuous_current:
            raise StepError("amplifier.continuous_current is not known: no current can be said to be small")
        return self.config.amplifier.continuous_current

    @property
    def declared_delay_s(self) -> float:
        """From sample to motor current, as the driver and the amplifier's model say, s."""
        return declared_latency(self.config)[0] + self.config.amplifier.delay

    @property
    def sliding_current(self) -> float:
        """What overcomes friction, A: as measured by the step ``sign``."""
        return float(self.results["sign"].figures["friction_A"])

    @property
    def identified(self) -> Path:
        """The config with the plant that was found."""
        return self.folder / IDENTIFIED

    @property
    def runs(self) -> Path:
        """Recordings that are kept."""
        return self.folder / "runs"

    @contextmanager
    def bench(self) -> Iterator[Bench]:
        """The driver in our hands; a daemon that holds it ends first.

        Raises:
            DriverError: the device cannot be opened. StepError: it does not do what it must.
        """
        self.release()
        if not self.virtual:
            self._watch()
        try:
            with bench.opened(self.config, virtual=self.virtual) as opened:
                try:
                    yield opened
                finally:
                    self.seconds += opened.seconds
                    self.missed += opened.failed
        except DriverError:
            self.missed += 1
            raise

    @contextmanager
    def daemon(self, config: Config | None = None) -> Iterator[DaemonProcess]:
        """A daemon on the device, kept until somebody else needs the device; stopped and without a fault afterwards.

        Args:
            config: other than the rig's.

        Raises:
            HilError: it does not come up.
        """
        config = patient(config or self.config)
        if self._daemon is None or self._wanted != config:
            self.release()
            # A socket's name is short: the folder that is kept may be anywhere.
            scratch = Path(self._open.enter_context(tempfile.TemporaryDirectory(prefix="hapticd-commission-")))
            self._watch()
            self._daemon = self._open.enter_context(DaemonProcess(config, scratch, {}))
            self._wanted = config
            try:
                self._daemon.wait_ready()
            except HilError:
                self.missed += 1
                raise
        begun = time.monotonic()
        daemon = self._daemon
        before = daemon.client.status()
        try:
            if before["fault"]:
                daemon.client.clear()
            yield daemon
        finally:
            self.seconds += time.monotonic() - begun
            if daemon.running:
                self.missed += _missed(daemon.client.stop()) - _missed(before)

    def late_s(self, begin_ns: int) -> float:
        """The most that ordinary threads of this machine waited since then, s; 0 where nothing depended on them."""
        return self._witness.latest_s(begin_ns, time.monotonic_ns()) if self._witness is not None else 0.0

    def _watch(self) -> None:
        self._witness = self._witness or Witness().__enter__()

    def keep(self, recording: str | Path) -> Path:
        """Copy a recording to those that are kept; its new path."""
        self.runs.mkdir(parents=True, exist_ok=True)
        return Path(shutil.copy2(recording, self.runs / Path(recording).name))

    def release(self) -> None:
        """End the daemon, if one runs: zero current, amplifier off."""
        self._daemon = None
        self._open.close()
        self._open = ExitStack()

    def document(self, step: str) -> dict[str, Any]:
        """Figures of an earlier step."""
        return dict(self.results[step].figures)


def _missed(status: Mapping[str, Any]) -> int:
    """Failed exchanges and missed periods since the daemon's start."""
    return int(status["exchanges_missed"]) + int(status["timing"]["missed"])
