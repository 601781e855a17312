"""The fault matrix, repeated: which trials count, and what the page says of them. The faults are played in tests/hil."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import pytest

from hapticd.hil.injections import INJECTIONS
from hapticd.hil.matrix import Row
from tests.hil.fault_matrix import DEVICES, HEADER, Tally, Witness, markdown, marks, replace_table

SIGKILL = next(one for one in INJECTIONS if one.name == "sigkill")
GOOD = Row(SIGKILL, "serial_dac", None, "", 0.0197, 0, 0, 0, None, (), 1)


def test_a_table_of_trials() -> None:
    late = replace(GOOD, zero_after_s=0.0231, problems=("zero current after 23.1 ms, 22 ms allowed",))
    cells = Tally("serial", SIGKILL, 0.022, [GOOD, late, replace(GOOD, zero_after_s=0.0150)], disturbed=4).cells()
    assert cells == [
        "SIGKILL of the daemon",
        "`none`",
        "23.10",
        "22",
        "2/3: 1 × zero current after 23.1 ms, 22 ms allowed",
    ]
    assert len(cells) == len(HEADER)


def test_what_goes_on_as_it_must_is_one_sentence_and_no_row() -> None:
    lost = next(one for one in INJECTIONS if one.what == "one reply lost")
    row = replace(GOOD, injection=lost, zero_after_s=None)
    fine = Tally("serial", lost, None, [row, row], disturbed=1)
    failed = Tally("serial", lost, None, [row, replace(row, problems=("3 rows lost",))])
    assert (
        markdown([fine], 2).splitlines()[-1] == f"The loop goes on, or refuses to start, in every trial: {lost.what}."
    )
    assert "Disturbed and repeated: 1." in markdown([fine], 2)
    assert "| 1/2: 1 × 3 rows lost |" in markdown([failed], 2)


def test_the_witness_sees_a_late_wake_only_in_its_span() -> None:
    witness = Witness()
    witness._late.append((1_000_000_000, 5_000_000))
    assert witness.latest_s(900_000_000, 1_100_000_000) == pytest.approx(5e-3)
    assert witness.latest_s(1_004_000_000, 1_100_000_000) == pytest.approx(5e-3)
    assert witness.latest_s(1_006_000_000, 1_100_000_000) == 0.0


def test_the_witness_watches() -> None:
    begin = time.monotonic_ns()
    with Witness() as witness:
        deaf = sum(range(3_000_000))  # the interpreter's lock is handed over every 5 ms
    assert deaf > 0
    assert witness.latest_s(begin, time.monotonic_ns()) > 1e-3


def test_the_page_keeps_what_is_around_the_table(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    tables = "\n".join(
        f"before\n\n{first}\nold {device}\n{last}" for device in DEVICES for first, last in [marks(device)]
    )
    page.write_text(f"{tables}\nafter\n")
    replace_table(page, "canopen", markdown([Tally("canopen", SIGKILL, 0.102, [GOOD])], 1))
    text = page.read_text()
    assert "old serial" in text
    assert "old firmware" in text
    assert "old canopen" not in text
    assert text.count("before") == len(DEVICES)
    assert text.endswith("after\n")
    assert f"{marks('canopen')[0]}\n\nUndisturbed trials of each fault: 1" in text
    page.write_text("no marks\n")
    with pytest.raises(ValueError, match="has no lines"):
        replace_table(page, "serial", "")
