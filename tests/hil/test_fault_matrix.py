"""The fault matrix, repeated: which trials count, and what the page says of them. The faults are played in tests/hil."""

from __future__ import annotations

import os
import signal
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from hapticd.hil.daemon import DaemonProcess
from hapticd.hil.injections import INJECTIONS
from hapticd.hil.matrix import Row
from hapticd.hil.witness import LOOK_S, Witness
from tests.hil.fault_matrix import DEVICES, HEADER, Tally, markdown, marks, replace_rows
from tests.polling import wait_until

SIGKILL, SIGTERM = (next(one for one in INJECTIONS if one.name == name) for name in ("sigkill", "sigterm"))
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


@pytest.mark.parametrize(
    ("driver", "options", "asleep_s"), [("serial_dac", {}, 0.06), ("canopen", {"watchdog_ms": 400}, 1.2)]
)
def test_a_stalled_daemon_outlasts_every_watchdog(
    monkeypatch: pytest.MonkeyPatch, driver: str, options: dict[str, int], asleep_s: float
) -> None:
    done: list[float] = []
    monkeypatch.setattr("hapticd.hil.injections.time.sleep", done.append)
    config = SimpleNamespace(driver=SimpleNamespace(name=driver, options=options))
    act = next(one for one in INJECTIONS if one.name == "stall").act
    assert act is not None
    act(cast("DaemonProcess", SimpleNamespace(config=config, signal=done.append)))
    assert done == [signal.SIGSTOP, pytest.approx(asleep_s), signal.SIGCONT]


def test_the_witness_watches() -> None:
    with Witness() as witness:
        begin = time.monotonic_ns()
        os.kill(witness.pid, signal.SIGSTOP)
        wait_until(lambda: _state(witness.pid) == "T", "the witness stood still")
        stood = time.monotonic_ns()
        time.sleep(0.1)
        end = time.monotonic_ns()
        os.kill(witness.pid, signal.SIGCONT)
        assert witness.latest_s(begin, time.monotonic_ns()) >= 1e-9 * (end - stood) - LOOK_S
        after = time.monotonic_ns() + 10**9
        assert witness.latest_s(after, after) < 1.0  # of another span


def _state(pid: int) -> str:
    return Path(f"/proc/{pid}/stat").read_text().rpartition(") ")[2][0]


def test_the_page_keeps_what_is_around_the_table_and_rows_that_did_not_run(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    lost, twice = (one for one in INJECTIONS if one.name in ("drop_one_reply", "duplicate"))
    stale = f"| {SIGKILL.what} (4ae0cbc) | `none` | 9.00 | 102 | 20/20 |\n| gone | a \\| b | 1 | 2 | 1/1 |"
    old = (
        "Undisturbed trials of each fault: 20; commit 4ae0cbc, 2026-11-23. Disturbed and repeated: 3.\n\n"
        f"| {' | '.join(HEADER)} |\n|---|---|---|---|---|\n| {SIGTERM.what} | `none` | 3.66 | 1000 | 20/20 |\n{stale}\n\n"
        f"The loop goes on, or refuses to start, in every trial: {lost.what};\n{twice.what}."
    )
    tables = "\n".join(f"before\n\n{first}\n\n{old}\n\n{last}" for device in DEVICES for first, last in [marks(device)])
    page.write_text(f"{tables}\nafter\n")
    others = page.read_text().replace(old, "")
    failed = Tally("canopen", lost, None, [replace(GOOD, injection=lost, problems=("3 rows lost",))])
    replace_rows(page, "canopen", [Tally("canopen", SIGKILL, 0.102, [GOOD]), failed], 1)
    text = page.read_text()
    assert text.count(old) == len(DEVICES) - 1
    begin, end = marks("canopen")
    table = text.partition(begin)[2].partition(end)[0]
    assert text.replace(old, "").replace(table, "\n\n\n\n") == others
    head, titles, rule, *rows, _, going = table.strip().splitlines()[:1] + table.strip().splitlines()[2:]
    assert "20; commit 4ae0cbc, 2026-11-23" in head
    assert (titles, rule) == (f"| {' | '.join(HEADER)} |", "|---|---|---|---|---|")
    kinds = [row.split(" | ") for row in rows]
    assert [row[0].removeprefix("| ").rpartition(" (")[0] for row in kinds[:2]] == [lost.what, SIGKILL.what]
    assert "4ae0cbc" not in kinds[1][0]
    assert kinds[1][2] == "19.70"
    assert rows[2:] == [f"| {SIGTERM.what} | `none` | 3.66 | 1000 | 20/20 |"]
    assert going == f"The loop goes on, or refuses to start, in every trial: {twice.what}."


def test_a_table_whose_rows_all_ran_has_their_commit_in_its_head(tmp_path: Path) -> None:
    once = markdown([Tally("serial", SIGKILL, 0.022, [GOOD])], 1)
    assert markdown([Tally("serial", SIGKILL, 0.022, [GOOD])], 1, once) == once
    assert f"| {SIGKILL.what} | " in once
    page = tmp_path / "page.md"
    page.write_text("no marks\n")
    with pytest.raises(ValueError, match="has no lines"):
        replace_rows(page, "serial", [], 1)
