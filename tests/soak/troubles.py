"""The episodes of a loaded soak as they are acted out: each a context, entered when it begins and left when it ends."""

from __future__ import annotations

import random
import shutil
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any, Final

from hapticd.config import apply_settings, config_to_yaml
from hapticd.hil.clock import JumpingClock
from hapticd.hil.errors import HilError
from hapticd.hil.process import Child
from tests.soak.rigs import Rig
from tests.soak.schedule import BURSTS, KINDS, Episode

_STRESS: Final = {
    "cpu": ("--cpu", "2"),
    "vm": ("--vm", "2", "--vm-bytes", "256M"),
    "hdd": ("--hdd", "1", "--hdd-bytes", "64M"),
}
_SMALL_DISK: Final = 4 << 20
_LEFT: Final = 1 << 20
"""What a disk that is about to be full has left, bytes."""
_STEPS_S: Final = (-3600, -1, 1, 3600, 86_400 * 365)
_RELOAD_S: Final = 10.0


class NotDoneError(Exception):
    """This machine does not allow an episode; the text says what is missing and how to get it."""


def stress_ng() -> str:
    """The program that loads the machine.

    Raises:
        NotDoneError: it is not installed.
    """
    program = shutil.which("stress-ng")
    if program is None:
        raise NotDoneError("stress-ng is not installed: apt-get install stress-ng")
    return program


class SmallDisk:
    """A file system of a few megabytes in memory, from ``with`` to its end, where this machine allows one.

    Attributes:
        refusal: why there is none; None where there is.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.refusal: str | None = None

    def __enter__(self) -> SmallDisk:
        self.folder.mkdir()
        command = ["mount", "-t", "tmpfs", "-o", f"size={_SMALL_DISK}", "small", str(self.folder)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            self.refusal = f"no small disk can be mounted, which asks for root: {done.stderr.strip()}"
        return self

    def __exit__(self, *exception: object) -> None:
        if self.refusal is None:
            subprocess.run(["umount", "--lazy", str(self.folder)], check=False)


def fresh_settings(chance: random.Random, stiffness: float) -> dict[str, Any]:
    """A change of settings that does no harm: a softer spring, or limits that nothing comes near."""
    return chance.choice(
        (
            {"spring.stiffness": round(chance.uniform(0.25, 1.0) * stiffness, 6)},
            {"safety.max_velocity": round(chance.uniform(300.0, 400.0), 3)},
            {"safety.max_excursion": round(chance.uniform(8.0, 10.0), 3)},
        )
    )


class Troubles:
    """Acts out a schedule.

    Args:
        planned: the episodes, in order.
        rigs: the daemons that they are for.
        folder: for their files.
        clock: the daemons' wall clock; None where there is no such.
        disk: the small disk.
        chance: draws what an episode leaves open.

    Attributes:
        done: what was acted out, with the times at which it really was.
        not_done: what was not, with the reason.
    """

    def __init__(
        self,
        planned: Sequence[Episode],
        rigs: Sequence[Rig],
        folder: Path,
        clock: JumpingClock | None,
        disk: SmallDisk,
        chance: random.Random,
    ) -> None:
        self._planned = list(planned)
        self._rigs, self._folder, self._clock, self._disk, self._chance = rigs, folder, clock, disk, chance
        self._running: list[tuple[Episode, float, ExitStack]] = []
        self._cut_short = False
        self.done: list[Episode] = []
        self.not_done: list[tuple[Episode, str]] = []
        self._acts: dict[str, Callable[[], AbstractContextManager[None]]] = {
            **{kind: partial(self._burst, kind) for kind in BURSTS},
            "disk_full": self._disk_full,
            "clock_step": self._clock_step,
            "deaf_reader": partial(self._connections, b"GET /stream HTTP/1.1\r\nHost: hapticd\r\n\r\n"),
            "mute_client": partial(self._connections, b""),
            "reload": self._reload,
            "bad_reload": self._bad_reload,
        }

    @property
    def now(self) -> str:
        """What goes on."""
        return ", ".join(episode.kind for episode, _, _ in self._running)

    def act(self, now_s: float) -> None:
        """Begin and end what is due; ``now_s`` since the beginning of the soak."""
        for entry in [entry for entry in self._running if now_s >= entry[0].end_s]:
            self._end(entry, now_s)
        while self._planned and now_s >= self._planned[0].begin_s:
            episode = self._planned.pop(0)
            stack = ExitStack()
            try:
                stack.enter_context(self._acts[episode.kind]())
            except (NotDoneError, HilError, OSError) as error:
                self._not_done(episode, str(error))
                continue
            self._running.append((episode, now_s, stack))

    def _not_done(self, episode: Episode, reason: str) -> None:
        self.not_done.append((episode, reason))

    def _end(self, entry: tuple[Episode, float, ExitStack], now_s: float) -> None:
        episode, begun_s, stack = entry
        self._running.remove(entry)
        try:
            stack.close()
        except (NotDoneError, HilError, OSError) as error:
            self._not_done(episode, str(error))
        else:
            self.done.append(Episode(episode.kind, begun_s, now_s))

    def end(self, now_s: float) -> None:
        """End what goes on, before its time."""
        self._cut_short = True
        for entry in list(self._running):
            self._end(entry, now_s)

    def acted(self) -> list[Episode]:
        """What was acted out, and what goes on."""
        return [*self.done, *(Episode(episode.kind, begun_s, float("inf")) for episode, begun_s, _ in self._running)]

    def _alive(self) -> list[Rig]:
        return [rig for rig in self._rigs if rig.alive]

    @contextmanager
    def _burst(self, kind: str) -> Iterator[None]:
        seconds = KINDS[kind].lasts_s
        command = [stress_ng(), *_STRESS[kind], "--temp-path", str(self._folder), "--timeout", f"{seconds + 10:.0f}s"]
        with Child("stress-ng", command, self._folder / "stress-ng.out") as child:
            yield
            if not child.running:
                raise NotDoneError(f"stress-ng --{kind} ended with code {child.code}: {child.last_output()}")

    @contextmanager
    def _disk_full(self) -> Iterator[None]:
        if self._disk.refusal is not None:
            raise NotDoneError(self._disk.refusal)
        rigs = self._alive()
        filler = self._disk.folder / "filler"
        try:
            for rig in rigs:  # first, since a recording does not begin on a disk that is full
                rig.rotate(self._disk.folder)
            with suppress(OSError):
                filler.write_bytes(bytes(_SMALL_DISK - _LEFT))
            yield
        finally:
            for rig in rigs:
                if rig.alive:
                    if not rig.recording_failed() and not self._cut_short:
                        rig.find("it recorded on, on a disk that is full")
                    rig.rotate()
            filler.unlink(missing_ok=True)

    @contextmanager
    def _clock_step(self) -> Iterator[None]:
        if self._clock is None:
            raise NotDoneError("no wall clock that jumps: apt-get install gcc libc6-dev")
        self._clock.jump(self._chance.choice(_STEPS_S))
        try:
            yield
        finally:
            self._clock.jump(0)

    @contextmanager
    def _connections(self, sent: bytes) -> Iterator[None]:
        """A client of each daemon that sends this and never reads what comes."""
        with ExitStack() as stack:
            for rig in self._alive():
                client = stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
                client.settimeout(5.0)
                client.connect(str(rig.client.socket_path))
                client.sendall(sent)
            yield

    @contextmanager
    def _reload(self) -> Iterator[None]:
        """A config with other live settings is in force after SIGHUP, or on request."""
        for rig in self._alive():
            _reload_one(rig, self._chance)
        yield

    @contextmanager
    def _bad_reload(self) -> Iterator[None]:
        """A config that is wrong is refused on SIGHUP, and what is in force stays."""
        for rig in self._alive():
            _reload_wrong(rig)
        yield


def _reload_one(rig: Rig, chance: random.Random) -> None:
    wanted = round(chance.uniform(0.25, 1.0) * rig.config.spring.stiffness, 6)
    config = apply_settings(rig.daemon.config, {"spring.stiffness": wanted}, source="the soak's reload")
    _config_file(rig).write_text(config_to_yaml(config))
    if chance.random() < 0.5:
        rig.daemon.signal(signal.SIGHUP)
    else:
        rig.ask("reload", rig.client.reload)
    if not _comes_true(lambda: _stiffness(rig) == wanted):
        rig.find(f"reloaded, but spring.stiffness = {_stiffness(rig)} instead of {wanted}")


def _reload_wrong(rig: Rig) -> None:
    file, before, refusals = _config_file(rig), rig.ask("config", rig.client.config), _refusals(rig)
    good = file.read_text()
    file.write_text("servo: {rate_hz: -5}\n")
    rig.daemon.signal(signal.SIGHUP)
    refused = _comes_true(lambda: _refusals(rig) > refusals)
    file.write_text(good)
    if not refused or rig.ask("config", rig.client.config) != before:
        rig.find("a wrong config was not refused, or changed something")


def _config_file(rig: Rig) -> Path:
    return rig.daemon.folder / "config.yaml"


def _stiffness(rig: Rig) -> float | None:
    config = rig.ask("config", rig.client.config)
    return None if config is None else float(config["spring"]["stiffness"])


def _refusals(rig: Rig) -> int:
    return rig.daemon.log.read_text(errors="replace").count("reload refused")


def _comes_true(condition: Callable[[], bool]) -> bool:
    deadline = time.monotonic() + _RELOAD_S
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.05)
    return True
