"""The frame decoder against other decoders: canopen's with the EDS, an oracle with hypothesis, and the fuzz command's."""

from __future__ import annotations

import functools

import canopen
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.canopen import layout as w
from drivers.canopen.profile import FOLDER
from drivers.canopen.supervision import command, take_frame, verdict
from drivers.interface import X_COUNTS, X_CURRENT, X_CURRENT_MEASURED, X_ENABLE, new_exchange
from tests.drivers.fuzz import canopen as fuzz

NODE = 1


def block() -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    made = np.zeros(w.WORDS, np.int64)
    made[w.NODE] = NODE
    made.view(np.float64)[w.COMMAND_PER_AMPERE] = 500.0
    made.view(np.float64)[w.AMPERE_PER_ACTUAL] = 0.01
    return made


@functools.cache
def canopen_node() -> canopen.LocalNode:
    """A node whose PDOs are mapped as bring-up maps them, in canopen's own object model."""
    node = canopen.LocalNode(NODE, canopen.import_od(str(FOLDER / "copley.eds"), NODE))
    for pdo, names in (
        (node.tpdo[1], ("Statusword", "Position actual internal value", "Actual motor current")),
        (node.rpdo[1], ("Controlword", "Target torque")),
    ):
        pdo.clear()
        for name in names:
            pdo.add_variable(name)
        pdo.cob_id = (w.TPDO1 if pdo is node.tpdo[1] else w.RPDO1) + NODE
    return node


@settings(max_examples=200, deadline=None)
@given(st.integers(0, 0xFFFF), st.integers(-(2**31), 2**31 - 1), st.integers(-(2**15), 2**15 - 1))
def test_tpdo_as_canopen_encodes_it(statusword: int, position: int, actual: int) -> None:
    pdo = canopen_node().tpdo[1]
    pdo["Statusword"].raw, pdo["Position actual internal value"].raw = statusword, position
    pdo["Actual motor current"].raw = actual
    s, x = block(), new_exchange()
    take_frame(s, pdo.cob_id | len(pdo.data) << 32, int.from_bytes(pdo.data, "little", signed=True))
    verdict(s, x, 0)
    assert (s[w.STATUSWORD], x[X_COUNTS]) == (statusword, position)
    assert x.view(np.float64)[X_CURRENT_MEASURED] == pytest.approx(0.01 * actual)


@settings(max_examples=200, deadline=None)
@given(st.floats(-60.0, 60.0))
def test_rpdo_as_canopen_decodes_it(current: float) -> None:
    pdo = canopen_node().rpdo[1]
    s, x = block(), new_exchange()
    s[w.STATUSWORD], x[X_ENABLE], x.view(np.float64)[X_CURRENT] = 0x0237, 1, current
    command(s, x, 0)
    low, data = s[w.OUT : w.OUT + 2].tobytes()[:8], s[w.OUT : w.OUT + 2].tobytes()[8:]
    assert (int.from_bytes(low[:4], "little"), low[4]) == (pdo.cob_id, 4)
    pdo.data = bytearray(data[:4])
    assert pdo["Controlword"].raw == 0x0F
    assert pdo["Target torque"].raw == pytest.approx(500.0 * current, abs=0.5000001)


@settings(max_examples=300, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 2**64 - 1), st.integers(0, 2**64 - 1)), min_size=1, max_size=8))
def test_random_frames_change_what_the_oracle_says(words: list[tuple[int, int]]) -> None:
    frames = np.array(words, np.uint64).view(fuzz._WIRE)[:, 0]
    report = fuzz.FuzzReport(rejected={"not for this driver": 0, "another master": 0, "a lost node": 0})
    s = block()
    s[w.NODE], s[w.ERROR_CODE_ASKED] = fuzz._NODE, 1
    seen = np.zeros((len(frames), 5), np.int64)
    fuzz._feed(s, frames.view(np.int64).reshape(-1, 2), seen)
    fuzz._judge(report, frames, seen)
    assert report.violations == []


def test_fuzz_holds_and_notices_a_decoder_that_does_not(monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[int] = []
    report = fuzz.fuzz(50_000, 1, done.append)
    assert (report.inputs, report.failed, done[-1]) == (50_000, False, 50_000)
    assert report.accepted > 1000
    assert all(report.rejected.values())
    honest = fuzz.expected_effects
    monkeypatch.setattr(fuzz, "expected_effects", lambda frames: honest(frames) & ~fuzz._EMCY)
    assert fuzz.fuzz(1000, 1, done.append).failed
