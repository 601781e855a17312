"""The simulated board's port: hosts that come and go. What it says to them: tests/firmware/test_protocol.py."""

import time
from pathlib import Path

from tests.sim_hw.boards import rows, running_board
from tests.sim_hw.host import MIDDLE, WATCHDOG, Host


def test_several_hosts_one_after_the_other(tmp_path: Path) -> None:
    with running_board(tmp_path) as board:
        for number in (1, 2):
            host = Host(board.link)
            host.begin(30)
            host.sample()
            host.command(MIDDLE + 100, 1)
            host.close()
            board.wait_for_event("WATCHDOG", number)
        host = Host(board.link)
        assert host.hello().version == 1
        assert host.sample().status == WATCHDOG
        host.close()
        used = sum(_cpu_s(board.process.pid))
        time.sleep(1.0)  # a port that nobody has open
        assert sum(_cpu_s(board.process.pid)) - used < 0.3
        log = board.stop()
    assert not board.link.is_symlink()
    trips = rows(log, "WATCHDOG")
    assert len(trips) == 2
    for trip in trips:
        commands = rows(log[log["time_ns"] < trip["time_ns"]], "COMMAND")
        assert trip["time_ns"] - commands["time_ns"][-1] == 30_000_000


def _cpu_s(pid: int) -> tuple[float, float]:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return int(fields[11]) / 100, int(fields[12]) / 100
