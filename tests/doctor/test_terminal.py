"""Bring-up of a board by a person at a terminal: what is asked, and that nothing is done without a yes."""

from __future__ import annotations

import os
import pty
import select
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from hapticd.cli.main import main
from hapticd.doctor import board
from tests.sim_hw.boards import rows, running_board

KNOB, LITTLE = "Turn the knob back and forth", "Turn the knob a little"
WATCHDOG, RAMP = "at zero current, to see the watchdog", "Raise the current to 0.4 A"
TURNED = "{hand: [{at_s: 0.0, force: 0.0022}]}"
PATIENCE_S = 30.0


class Terminal:
    """A pseudo-terminal with somebody who answers each question as told.

    Args:
        answers: what a question contains, to the keys pressed then.
    """

    def __init__(self, answers: dict[str, str]) -> None:
        self.answers, self.shown = answers, ""
        self.near, self.far = pty.openpty()
        self.end = threading.Event()
        self.person = threading.Thread(target=self._answer)

    def _answer(self) -> None:
        left, read = dict(self.answers), 0
        end = time.monotonic() + PATIENCE_S
        while not self.end.is_set() and time.monotonic() < end:
            if select.select([self.near], [], [], 0.05)[0]:
                self.shown += os.read(self.near, 4096).decode(errors="replace")
            for question, keys in left.items():
                if (at := self.shown.find(question, read)) >= 0:
                    read = at + len(question)
                    os.write(self.near, keys.encode() + b"\n")
                    del left[question]
                    break

    @contextmanager
    def attached(self, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
        """Standard input and standard error are this terminal."""
        with (
            monkeypatch.context() as patched,
            os.fdopen(os.dup(self.far)) as keys,
            os.fdopen(self.far, "w", 1) as screen,
        ):
            patched.setattr("sys.stdin", keys)
            patched.setattr("sys.stderr", screen)
            self.person.start()
            try:
                yield
            finally:
                self.end.set()
                self.person.join()
                os.close(self.near)


@pytest.mark.parametrize(
    ("watchdog", "ramp", "enabled"), [("n", "n", 0), ("y", "n", 1), ("y", "y", 2)], ids=["nothing", "watchdog", "both"]
)
def test_only_what_is_agreed_to(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    watchdog: str,
    ramp: str,
    enabled: int,
) -> None:
    monkeypatch.setattr(board, "EXCHANGES", 20)
    monkeypatch.setattr(board, "TURN_S", 0.4)
    terminal = Terminal({KNOB: "", LITTLE: "s", WATCHDOG: watchdog, RAMP: ramp})
    with running_board(tmp_path, TURNED) as device:
        config = tmp_path / "rig.yaml"
        config.write_text(
            f"driver: {{name: serial_dac, port: {device.link}, watchdog_ms: 50}}\nservo: {{rate_hz: 50}}\n"
        )
        with terminal.attached(monkeypatch):
            main(["doctor", "--device", str(config), "--current", "0.4"])
        log = device.stop()
    report = capsys.readouterr().out
    assert rows(log, "ENABLE").size == enabled
    assert (log["command_A"].max() > 0.0) == (ramp == "y")
    assert ("not tested: it needs current in the motor" in report) == (ramp == "n")
    assert "counts/s, at most" in terminal.shown  # the bar while the knob is turned
    assert "█" in terminal.shown
    assert [question in terminal.shown for question in terminal.answers] == [True] * 4
