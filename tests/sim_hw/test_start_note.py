"""A person at a terminal is told why nothing happens at the first start; a pipe is told nothing."""

from __future__ import annotations

import argparse
import sys

import pytest

from sim_hw import __main__ as command


@pytest.mark.parametrize("terminal", [True, False])
def test_compiling_is_announced_on_a_terminal(
    terminal: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    seen: list[str] = []

    def run(_options: argparse.Namespace) -> None:
        seen.append(capsys.readouterr().err)

    parser = argparse.ArgumentParser()
    parser.set_defaults(device="serial_board", run=run)
    monkeypatch.setattr(command, "build_parser", lambda: parser)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal)
    assert command.main([]) == 0
    assert ("serial_board: starting (the first start compiles" in seen[0]) == terminal
