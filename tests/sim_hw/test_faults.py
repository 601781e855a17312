"""Each injected fault, as the host sees it on the line and as the log tells it."""

import contextlib
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from numpy.typing import NDArray

from sim_hw.kinds import COMMAND, KINDS, REPLY, REQUEST
from tests.polling import wait_until
from tests.sim_hw.boards import Board, rows, running_board
from tests.sim_hw.host import (
    AMPLIFIER_FAULT,
    BAD_FRAME,
    ENABLED,
    ENCODER_FAULT,
    EXTERNAL_STOP,
    MIDDLE,
    UNCONFIGURED,
    Host,
)

AT_S = 0.05
WATCHDOG_MS = 10_000


@contextlib.contextmanager
def enabled(folder: Path, fault: str) -> Iterator[tuple[Board, Host]]:
    """A board whose fault falls due when this returns; a host that has enabled it, with a long watchdog."""
    script = f"faults: [{{at_s: {AT_S}, from: enabled, {fault}}}]"
    with running_board(folder, script) as board:
        host = Host(board.link)
        host.begin(WATCHDOG_MS)
        host.sample()
        host.command(MIDDLE, 1)
        board.wait_for_event("ENABLE")
        time.sleep(AT_S)
        yield board, host
        with contextlib.suppress(OSError):
            host.close()


def injected(log: NDArray[Any], kind: str, *details: int) -> None:
    """The log has the fault's rows, with these details, none earlier than they may be."""
    found = rows(log, "FAULT_INJECTED")
    assert found["code"].tolist() == [KINDS[kind].number] * len(details)
    assert found["detail"].tolist() == list(details)
    assert (found["time_ns"] >= rows(log, "ENABLE")["time_ns"][0] + AT_S * 1e9).all()


def test_drop_reply(tmp_path: Path) -> None:
    with enabled(tmp_path, "kind: drop, frames: reply, count: 2") as (board, host):
        for _ in range(2):
            host.ask()
        assert host.sample().status == ENABLED  # the first reply that comes is the third's
        injected(board.stop(), "drop", REPLY, REPLY)


def test_drop_command(tmp_path: Path) -> None:
    with enabled(tmp_path, "kind: drop, frames: command") as (board, host):
        before = host.sample().command_seq
        host.command(MIDDLE + 5)
        assert host.sample().command_seq == before
        host.command(MIDDLE + 6)
        assert host.sample().command_seq == host.seq - 1
        log = board.stop()
    injected(log, "drop", COMMAND)
    assert MIDDLE + 5 not in rows(log, "COMMAND")["code"]


def test_corrupt_reply(tmp_path: Path) -> None:
    with enabled(tmp_path, "kind: corrupt, frames: reply, count: 20") as (board, host):
        for _ in range(20):
            host.ask()
        assert host.sample().status == ENABLED  # the first good reply is the last's
        assert host.bad >= 20
        injected(board.stop(), "corrupt", *[REPLY] * 20)


def test_corrupt_request(tmp_path: Path) -> None:
    with enabled(tmp_path, "kind: corrupt, frames: request") as (board, host):
        host.ask()
        assert host.sample().status == ENABLED | BAD_FRAME  # the first had no reply
        injected(board.stop(), "corrupt", REQUEST)


def test_duplicate_reply(tmp_path: Path) -> None:
    with enabled(tmp_path, "kind: duplicate, frames: reply") as (board, host):
        assert host.sample() == host.reply()
        injected(board.stop(), "duplicate", REPLY)


def test_delay_reply(tmp_path: Path) -> None:
    with enabled(tmp_path, "kind: delay, frames: reply, delay_s: 0.05") as (board, host):
        before = time.monotonic()
        host.sample()
        assert time.monotonic() - before >= 0.05
        injected(board.stop(), "delay", REPLY)


def test_delay_command(tmp_path: Path) -> None:
    with enabled(tmp_path, "kind: delay, frames: command, delay_s: 0.05") as (board, host):
        seq = host.sample().seq
        host.command(MIDDLE + 7)
        wait_until(lambda: host.sample().command_seq == seq, "the late command")
        log = board.stop()
    injected(log, "delay", COMMAND)
    applied = rows(log, "COMMAND")[-1]
    assert applied["code"] == MIDDLE + 7
    assert applied["time_ns"] - rows(log, "FAULT_INJECTED")["time_ns"][0] == 50_000_000


def test_reorder_replies(tmp_path: Path) -> None:
    with enabled(tmp_path, "kind: reorder, frames: reply") as (board, host):
        first, second = host.ask(), host.ask()
        answers = [host.reply(), host.reply()]
        assert [answer.seq for answer in answers if answer] == [second, first]
        injected(board.stop(), "reorder", REPLY)


def test_garbage(tmp_path: Path) -> None:
    with enabled(tmp_path, "kind: garbage, bytes: 600") as (board, host):
        first, second = host.ask(), host.ask()
        answer = host.reply()  # what was left of the garbage takes the first frame with it, or not
        assert answer is not None
        if answer.seq == first:
            answer = host.reply()
        assert answer is not None
        assert answer.seq == second
        assert host.bad > 0
        assert host.sample().status == ENABLED
        injected(board.stop(), "garbage", 0)


def test_freeze_counter(tmp_path: Path) -> None:
    with enabled(tmp_path, "kind: freeze_counter, duration_s: 0.5") as (board, host):
        shown = [host.sample().count]
        host.command(MIDDLE + 2000)
        while shown[-1] == 0:
            time.sleep(0.01)
            shown.append(host.sample().count)
        log = board.stop()
    injected(log, "freeze_counter", 0)
    end_ns = rows(log, "FAULT_INJECTED")["time_ns"][0] + 500_000_000
    sampled = rows(log, "SAMPLE")[-len(shown) :]
    frozen = sampled["time_ns"] < end_ns
    assert [count == 0 for count in shown] == frozen.tolist()
    assert sampled["counts"][frozen][-1] > 0
    assert shown[-1] == sampled["counts"][-1] > 100


def test_encoder_glitch(tmp_path: Path) -> None:
    with enabled(tmp_path, "kind: encoder_glitch, counts: -300, count: 2") as (board, host):
        assert [host.sample().count for _ in range(3)] == [2**32 - 300, 2**32 - 300, 0]
        log = board.stop()
    injected(log, "encoder_glitch", 0)
    assert (rows(log, "SAMPLE")["counts"] == 0).all()


def test_silent(tmp_path: Path) -> None:
    with enabled(tmp_path, "kind: silent, duration_s: 1.0") as (board, host):
        host.ask()
        assert host.reply(0.1) is None
        time.sleep(1.0)
        assert host.sample().status == ENABLED
        injected(board.stop(), "silent", 0)


def answers(host: Host) -> bool:
    """Whether the line takes a request."""
    try:
        host.ask()
    except OSError:
        return False
    return True


def test_unplug_and_plug_in(tmp_path: Path) -> None:
    with enabled(tmp_path, "kind: unplug, duration_s: 1.0") as (board, host):
        wait_until(lambda: not answers(host), "a line that is hung up")
        assert not board.link.is_symlink()
        with pytest.raises(OSError, match="Input/output error"):
            host.ask()
        wait_until(board.link.is_symlink, "the port's return")
        again = Host(board.link)
        assert again.hello().version == 1
        again.close()
        injected(board.stop(), "unplug", 0)


def test_reboot(tmp_path: Path) -> None:
    with enabled(tmp_path, "kind: reboot, off_s: 1.0") as (board, host):
        host.ask()  # lost: the next reply is that of the next request
        board.wait_for_event("REBOOT", 2)
        answer = host.sample()
        assert (answer.status, answer.command_seq, answer.count) == (UNCONFIGURED, 0, 0)
        log = board.stop()
    injected(log, "reboot", 0)
    down, up = rows(log, "REBOOT")
    assert up["time_ns"] - down["time_ns"] == 1_000_000_000
    sampled = rows(log, "SAMPLE")["time_ns"][-1]
    assert answer.time_us == (sampled - up["time_ns"]) // 1000
    assert rows(log, "DISABLE")["time_ns"][0] == down["time_ns"]


@pytest.mark.parametrize(
    ("kind", "bit"),
    [("encoder_fault", ENCODER_FAULT), ("amplifier_fault", AMPLIFIER_FAULT), ("external_stop", EXTERNAL_STOP)],
)
def test_faults_of_the_boards_own_are_latched(tmp_path: Path, kind: str, bit: int) -> None:
    with enabled(tmp_path, f"kind: {kind}, duration_s: 1.0") as (board, host):
        assert host.sample().status == bit
        host.command(MIDDLE, 0)
        assert host.sample().status == bit  # its cause is still there
        time.sleep(1.0)
        assert host.sample().status == bit
        host.command(MIDDLE, 0)
        assert host.sample().status == 0
        log = board.stop()
    injected(log, kind, 0)
    assert rows(log, "DISABLE")["time_ns"][0] == rows(log, "FAULT_INJECTED")["time_ns"][0]


def test_wrong_version(tmp_path: Path) -> None:
    with running_board(tmp_path, "faults: [{kind: wrong_version, version: 7}]") as board:
        host = Host(board.link)
        assert host.hello().version == 7
        host.close()
        assert rows(board.stop(), "FAULT_INJECTED")["code"].tolist() == [KINDS["wrong_version"].number]
