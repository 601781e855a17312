"""What the reader of scripts says about wrong ones, and what it makes of right ones."""

import math
import re
from pathlib import Path

import pytest

from hapticd.config import ConfigError
from sim_hw import kinds
from sim_hw import layout as w
from sim_hw.script import load_script

WRONG = [
    ("hnd: []", "hnd: unknown key; did you mean hand?"),
    ("[]", "must be a mapping with the keys hand, start, faults"),
    ("", "is empty; write {} for a script without events"),
    ("hand: 3", "hand = 3: must be a list"),
    ("hand: [{at_s: 1}]", "hand[0].force: is missing"),
    ("hand: [{at_s: 1, force: .inf}]", "hand[0].force = .inf: must be finite"),
    ("hand: [{at_s: 1, force: 1}, {at_s: 0.5, force: 0}]", "hand: has steps that are not in the order of their at_s"),
    (
        "hand: [{at_s: 1, force: 1}, {at_s: 2, force: 0, from: enabled}]",
        "hand: has steps from start and steps from enabled; all must have the same origin",
    ),
    ("start: {position: left}", "start.position = left: must be a number"),
    ("start: {counts_ofset: 5}", "start.counts_ofset: unknown key; did you mean counts_offset?"),
    ("start: {counts_offset: 1.5}", "start.counts_offset = 1.5: must be a whole number"),
    ("faults: [drop]", "faults[0] = drop: must be a mapping with a kind, such as {kind: silent, at_s: 1.0}"),
    ("faults: [{kind: dorp, at_s: 1}]", "faults[0].kind = dorp: is not a kind of fault; did you mean drop?"),
    ("faults: [{kind: drop}]", "faults[0].at_s: is missing"),
    ("faults: [{kind: drop, at_s: -1}]", "faults[0].at_s = -1: must be between 0 and 1e+06 s"),
    ("faults: [{kind: drop, at_s: 1, cuont: 2}]", "faults[0].cuont: unknown key; did you mean count?"),
    ("faults: [{kind: drop, at_s: 1, count: 0}]", "faults[0].count = 0: must be between 1 and 1000000"),
    (
        "faults: [{kind: drop, at_s: 1, frames: replly}]",
        "faults[0].frames = replly: is not allowed; did you mean reply?",
    ),
    ("faults: [{kind: drop, at_s: 1, from: enable}]", "faults[0].from = enable: is not allowed; did you mean enabled?"),
    ("faults: [{kind: delay, at_s: 1}]", "faults[0].delay_s: is missing"),
    (
        "faults: [{kind: bus_off, at_s: 1}]",
        "faults[0].kind = bus_off: is a fault of canopen devices; this one is serial",
    ),
    ("faults: [{kind: silent, at_s: true}]", "faults[0].at_s = true: must be a number"),
]


@pytest.mark.parametrize(("text", "message"), WRONG)
def test_says_what_is_wrong(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "script.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError) as raised:
        load_script(path, "serial")
    lines = str(raised.value).splitlines()
    assert len(lines) == 1
    assert lines[0] == f"{path}: {message}"


def test_says_everything_at_once(tmp_path: Path) -> None:
    path = tmp_path / "script.yaml"
    path.write_text("{hand: 1, start: 2, faults: [{kind: x}, {kind: drop}]}")
    with pytest.raises(ConfigError) as raised:
        load_script(path, "serial")
    assert [problem.key for problem in raised.value.problems] == ["hand", "start", "faults[0].kind", "faults[1].at_s"]


def test_a_binary_has_the_watchdog_that_it_has(tmp_path: Path) -> None:
    path = tmp_path / "script.yaml"
    path.write_text("{start: {watchdog: 0}, faults: [{kind: silent, at_s: 1}]}")
    assert load_script(path, "serial").watchdog == 0
    with pytest.raises(
        ConfigError, match=r"start\.watchdog: unknown key; keys: position, counts_offset, current_gain$"
    ):
        load_script(path, "firmware")


def test_no_such_file(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"gone\.yaml: no such file"):
        load_script(tmp_path / "gone.yaml", "serial")


def test_table_of_faults(tmp_path: Path) -> None:
    path = tmp_path / "script.yaml"
    path.write_text(
        "faults:\n"
        "- {kind: delay, at_s: 0.25, from: enabled, frames: reply, count: 3, delay_s: 0.002}\n"
        "- {kind: silent, at_s: 1, duration_s: forever}\n"
        "- {kind: wrong_version}\n"
        "- {kind: reboot, at_s: 2}\n"
        "- {kind: unplug, at_s: 0.5, from: signal}\n"
    )
    script = load_script(path, "serial")
    delay, silent, reboot, signalled = script.faults
    assert (delay[w.FAULT_KIND], delay[w.FAULT_FROM], delay[w.FAULT_FRAMES]) == (kinds.DELAY, 1, kinds.REPLY)
    assert (delay[w.FAULT_AT_NS], delay[w.FAULT_LEFT], delay[w.FAULT_DELAY_NS]) == (250_000_000, 3, 2_000_000)
    assert silent[w.FAULT_DURATION_NS] == w.FAR_NS == kinds.to_ns(math.inf)
    assert silent[w.FAULT_FROM] == 0
    assert reboot[w.FAULT_DURATION_NS] == 100_000_000
    assert (reboot[w.FAULT_STATE], signalled[w.FAULT_STATE], signalled[w.FAULT_FROM]) == (w.WAITING, w.UNSIGNALLED, 0)
    assert script.wrong_version == 0xFF


def test_table_of_faults_of_a_drive(tmp_path: Path) -> None:
    path = tmp_path / "script.yaml"
    path.write_text(
        "faults:\n"
        "- {kind: foreign_sdo, at_s: 1, object: '0x1018:2', value: -1, size: 4}\n"
        "- {kind: measured_current, at_s: 2, factor: -0.5, current: 3.25, duration_s: 0.1}\n"
        "- {kind: second_node, at_s: 3, counts: -400, count: 7}\n"
    )
    written, measured, second = load_script(path, "canopen").faults
    assert (written[w.FAULT_OBJECT], written[w.FAULT_VALUE], written[w.FAULT_SIZE]) == (0x21018, -1, 4)
    assert (measured[w.FAULT_FACTOR_PPM], measured[w.FAULT_CURRENT_UA]) == (-500_000, 3_250_000)
    assert measured[w.FAULT_DURATION_NS] == 100_000_000
    assert (second[w.FAULT_COUNTS], second[w.FAULT_COUNT]) == (-400, 7)
    for wrong, message in (
        ("{kind: foreign_sdo, at_s: 1, value: 1}", "faults[0].object: is missing"),
        (
            "{kind: foreign_sdo, at_s: 1, object: 1, value: 1}",
            "faults[0].object = 1: must be an object of the dictionary",
        ),
        (
            "{kind: foreign_sdo, at_s: 1, object: 0x6060, value: 1, size: 5}",
            "faults[0].size = 5: must be between 1 and 4",
        ),
    ):
        path.write_text(f"faults: [{wrong}]")
        with pytest.raises(ConfigError, match=re.escape(message)):
            load_script(path, "canopen")


@pytest.mark.parametrize("device", ["serial", "canopen"])
def test_every_kind_is_read_with_its_required_keys_alone(tmp_path: Path, device: str) -> None:
    path = tmp_path / "script.yaml"
    for name, kind in kinds.KINDS.items():
        keys = "".join(f", {key}: {0x6060 if key == 'object' else 1}" for key in kind.required)
        path.write_text(f"faults: [{{kind: {name}{keys}}}]")
        if device in kind.devices:
            script = load_script(path, device)
            assert script.wrong_version == 255 if name == "wrong_version" else script.faults[0, 0] == kind.number
        else:
            with pytest.raises(ConfigError, match="this one is"):
                load_script(path, device)
