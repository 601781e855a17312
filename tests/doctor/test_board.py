"""Bring-up of a serial board, against the simulated one: each step's finding, and that nothing moves without a yes."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import pytest

from hapticd.cli.main import main
from hapticd.config import Config, parse_config
from hapticd.doctor import Level, board
from hapticd.doctor.board import BringUp, bring_up, histogram, percentile
from tests.sim_hw.boards import Board, rows, running_board

PUSHED_S = 3.0
PUSHED = f"{{hand: [{{at_s: 0.0, force: 0.0022}}, {{at_s: {PUSHED_S}, force: 0.0}}]}}"
"""Somewhat more than friction, then nothing."""


class Operator:
    """Answers as told, and remembers."""

    def __init__(self, agrees: bool = True, does: bool = True) -> None:
        self.answer, self.hands = agrees, does
        self.questions: list[str] = []
        self.shown: list[tuple[int, float, float]] = []
        self.agrees_from = 0.0

    def agrees(self, question: str) -> bool:
        time.sleep(max(0.0, self.agrees_from - time.monotonic()))
        self.questions.append(question)
        return self.answer

    def does(self, request: str) -> bool:
        return self.hands

    def shows(self, counts: int, rate: float, fastest: float) -> None:
        self.shown.append((counts, rate, fastest))


@pytest.fixture(autouse=True)
def _soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(board, "EXCHANGES", 20)
    monkeypatch.setattr(board, "TURN_S", 0.4)


def config(link: Path, **sections: Any) -> Config:
    document = {"driver": {"name": "serial_dac", "port": str(link), "watchdog_ms": 50}, "servo": {"rate_hz": 50.0}}
    return parse_config({**document, **sections}, "test")


def levels(found: BringUp) -> dict[str, Level]:
    return {finding.name: finding.level for finding in found.findings}


def text(found: BringUp, name: str) -> str:
    (finding,) = (finding for finding in found.findings if finding.name == name)
    return " ".join((finding.found, finding.matters, finding.fix))


def test_a_good_board(tmp_path: Path) -> None:
    with running_board(tmp_path, PUSHED) as device:
        operator = Operator()
        operator.agrees_from = time.monotonic() + PUSHED_S + 0.5
        found = bring_up(config(device.link), operator, current=0.4)
        log = device.stop()
    assert [one for one in found.findings if one.level is not Level.GOOD] == []
    assert found.fit
    assert len(found.round_trip_us) == 20
    assert "firmware 1.2" in text(found, "board")
    assert "within 5" in text(found, "watchdog")
    assert len(operator.questions) == 2
    assert "0.4 A" in operator.questions[1]
    assert operator.shown[-1][0] > 0
    assert rows(log, "WATCHDOG").size == 1
    assert 0.05 < log["command_A"].max() <= 0.4  # an eighth of a turn ends it
    assert log["command_A"].min() == 0.0
    assert log["command_A"][-1] == 0.0


def test_nothing_is_enabled_without_a_yes(tmp_path: Path) -> None:
    with running_board(tmp_path) as device:
        found = bring_up(config(device.link), Operator(agrees=False, does=False))
        log = device.stop()
    assert rows(log, "ENABLE").size == 0
    assert found.fit
    assert [name for name, level in levels(found).items() if level is Level.NOTE] == ["encoder", "watchdog", "polarity"]


def test_what_is_bad_keeps_the_output_off(tmp_path: Path) -> None:
    with running_board(tmp_path, PUSHED) as device:
        operator = Operator()
        found = bring_up(config(device.link, amplifier={"dac_bits": 12, "dac_full_scale": 4.0}), operator)
        log = device.stop()
    assert not found.fit
    assert "14 bits, the config says 12 bits" in text(found, "dac_bits")
    assert "6 A, the config says 4.0 A" in text(found, "dac_full_scale")
    assert operator.questions == []
    assert rows(log, "ENABLE").size == 0


def test_a_counter_that_stands_still(tmp_path: Path) -> None:
    with running_board(tmp_path) as device:
        found = bring_up(config(device.link), Operator())
    assert "the counter did not move" in text(found, "encoder")
    assert levels(found)["encoder"] is Level.BAD


def test_fault_inputs(tmp_path: Path) -> None:
    with running_board(
        tmp_path, "{faults: [{kind: external_stop, at_s: 0.0}, {kind: encoder_fault, at_s: 0}]}"
    ) as device:
        found = bring_up(config(device.link), Operator(does=False))
    assert "ENCODER_FAULT, EXTERNAL_STOP" in text(found, "fault inputs")
    assert not found.fit


def test_wrong_polarity(tmp_path: Path) -> None:
    script = "{hand: [{at_s: 0.0, force: 0.0, from: enabled}, {at_s: 0.05, force: -0.03, from: enabled}]}"
    with running_board(tmp_path, script) as device:
        found = bring_up(config(device.link), Operator(does=False), current=0.5)
        log = device.stop()
    assert levels(found)["polarity"] is Level.BAD
    assert "run away" in text(found, "polarity")
    assert log["command_A"][-1] == 0.0


def test_inverted_encoder_turns_the_direction_round() -> None:
    straight, inverted = (parse_config({"encoder": {"invert": invert}}, "test") for invert in (False, True))
    assert board.direction_of(100, straight).level is Level.GOOD
    assert board.direction_of(-100, inverted).level is Level.GOOD
    assert "encoder.invert: false" in board.direction_of(100, inverted).fix
    assert board.direction_of(0, straight).level is Level.NOTE


def test_a_board_that_falls_silent(tmp_path: Path) -> None:
    with running_board(tmp_path, "{faults: [{kind: silent, at_s: 0.0, from: enabled}]}") as device:
        found = bring_up(config(device.link), Operator(does=False))
    assert "a SAMPLE was not answered within 250 ms" in text(found, "answers")
    assert not found.fit


def test_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with running_board(tmp_path) as device:
        path = _written(tmp_path, device)
        assert main(["doctor", "--device", str(path), "--json"]) == 0
        document = json.loads(capsys.readouterr().out)
        assert document["fit"] is True
        assert document["round_trip_us"]["exchanges"] == 20
        assert main(["doctor", "--device", str(path)]) == 0
        report = capsys.readouterr().out
        assert "not tested: it needs the output stage on" in report
        assert "█" in report
    assert main(["doctor", "--device", str(path)]) == 4
    assert main(["doctor", "--device"]) == 2
    assert main(["doctor", "--current", "1"]) == 2


def _written(folder: Path, device: Board) -> Path:
    path = folder / "rig.yaml"
    path.write_text(f"driver: {{name: serial_dac, port: {device.link}, watchdog_ms: 50}}\nservo: {{rate_hz: 50}}\n")
    return path


def test_histogram_and_percentiles() -> None:
    assert percentile([3.0, 1.0, 2.0], 0.5) == 2.0
    assert percentile([], 0.5) is None
    lines = histogram([100.0] * 9 + [200.0])
    assert lines[0].endswith(" 9")
    assert lines[-1].endswith(" 1")
    assert histogram([]) == []
