"""Simulated devices as processes for the tests."""

import contextlib
import json
import select
import signal
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from sim_hw.log import EVENTS, read_log
from tests import forked
from tests.polling import PATIENCE_S, wait_until

ROOT = Path(__file__).resolve().parents[2]
START_S = 250.0


@dataclass
class Board:
    """A running board, powered up no earlier than ``started_ns`` (monotonic); ``stop`` ends it and gives its log."""

    started_ns: int
    process: forked.Forked
    link: Path
    log: Path
    ready: dict[str, Any]

    def stop(self, number: int = signal.SIGTERM) -> NDArray[Any]:
        self.process.send_signal(number)
        assert self.process.wait(PATIENCE_S) == 0
        return read_log(self.log)

    def wait_for_event(self, event: str, count: int = 1) -> None:
        """Wait until the log has so many rows of an event."""
        wait_until(lambda: len(rows(read_log(self.log), event)) >= count, f"{count} of {event} in the log")


def rows(log: NDArray[Any], *events: str) -> NDArray[Any]:
    """The rows of some events."""
    numbers = [EVENTS.index(event) for event in events]
    return log[[event in numbers for event in log["event"]]]


@contextlib.contextmanager
def running_board(
    folder: Path, script: str = "", plant: str = "", *options: str, device: tuple[str, ...] = ("serial",)
) -> Iterator[Board]:
    """What ``python -m sim_hw serial``, or another ``device`` with a port, runs, on a link in ``folder``."""
    link, log = folder / "board", folder / "truth.arrow"
    command = [*device, "--link", str(link), "--log", str(log), *options]
    for name, text in (("script", script), ("plant", plant)):
        if text:
            (folder / f"{name}.yaml").write_text(text)
            command += [f"--{name}", str(folder / f"{name}.yaml")]
    started_ns = time.monotonic_ns()
    process = forked.device(command, ROOT)
    try:
        assert select.select([process.stdout], [], [], START_S)[0]
        yield Board(started_ns, process, link, log, json.loads(process.stdout.readline()))
    finally:
        process.close()
